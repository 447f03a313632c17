#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/report/previews.h>

namespace surfel {

/// A chart with its title.
struct InfoChart {
  std::string title;
  std::string note;  ///< Below it.
  std::string svg;
};

/// What is wrong, and what to do.
struct InfoFinding {
  std::string topic, measure, command;
};

/// What a page tells of a file. All but `InfoChart::svg` is plain text.
struct InfoPage {
  std::string file;
  std::string kind;                                          ///< "surfels", "mesh", ...
  std::vector<std::pair<std::string, std::string>> figures;  ///< The most telling ones.
  std::vector<std::pair<std::string, std::string>> facts;    ///< All.
  std::optional<std::vector<InfoFinding>> findings;          ///< Unset: nothing is judged.
  std::vector<Preview> pictures;
  std::string no_pictures;  ///< Why there are none; empty: there are some.
  std::vector<InfoChart> charts;
  std::string next;     ///< The command to run next.
  std::string command;  ///< The command that made the page.
};

/// One page that needs nothing else. The same for the same input.
SURFEL_API std::string info_page_html(const InfoPage& page);

}  // namespace surfel
