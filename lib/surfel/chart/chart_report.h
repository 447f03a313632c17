#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/chart/chart_result.h>

namespace surfel {

/// Text as a field of CSV (RFC 4180): quoted where it holds a comma, a quote or a line's end.
SURFEL_API std::string csv_field(const std::string& text);

/// The report as CSV: a row for every point.
SURFEL_API std::string report_csv(const ChartReport& report);

/// The whole report as JSON in UTF-8, without pictures.
SURFEL_API std::string report_json(const ChartReport& report);

/// One page that needs nothing else: tables, plots (SVG, drawn in `folder` by gnuplot), pictures
/// with their differences from the truth, the commands of every point. `command` is the one that
/// made the report. Throws Error(kIo) without gnuplot.
SURFEL_API std::string report_html(const ChartReport& report, const std::string& command,
                                   const std::string& folder);

/// Writes report.html, report.csv and report.json to a folder, all or none. Throws Error(kIo).
SURFEL_API void write_report(const ChartReport& report, const std::string& command,
                             const std::string& work_folder, const std::string& folder,
                             bool no_clobber);

}  // namespace surfel
