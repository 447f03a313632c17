#include <fmt/format.h>
#include <surfel/report/info_page.h>
#include <surfel/report/page.h>

namespace surfel {
namespace {

std::string findings_html(const std::vector<InfoFinding>& findings) {
  if (findings.empty()) return "<p class=\"verdict\">Nothing is missing or wrong.</p>\n";
  std::string out;
  for (const InfoFinding& finding : findings) {
    out += fmt::format("<div class=\"verdict off\"><b>{}</b>: {}{}</div>\n",
                       escape_html(finding.topic), escape_html(finding.measure),
                       finding.command.empty() ? "" : pre_html(finding.command));
  }
  return out;
}

std::string pictures_html(const InfoPage& page) {
  std::string out;
  PagePictures pictures;
  for (const Preview& preview : page.pictures) {
    out += figure_html("sheer", pictures.add(preview.image), escape_html(preview.caption));
  }
  if (!page.pictures.empty()) out = "<div class=\"gallery\">\n" + out + "</div>\n";
  if (!page.no_pictures.empty()) out += "<p>" + escape_html(page.no_pictures) + "</p>\n";
  return out;
}

std::string charts_html(const std::vector<InfoChart>& charts) {
  std::string out;
  for (const InfoChart& chart : charts) {
    out += figure_html("chart", chart.svg,
                       fmt::format("<b>{}</b>{}{}", escape_html(chart.title),
                                   chart.note.empty() ? "" : "; ", escape_html(chart.note)));
  }
  return "<div class=\"charts\">\n" + out + "</div>\n";
}

}  // namespace

std::string info_page_html(const InfoPage& page) {
  const std::string name = page.file.substr(page.file.rfind('/') + 1);
  std::string body;
  if (!page.figures.empty()) body += facts_html(page.figures);
  body += pictures_html(page);
  if (page.findings) {
    body += "<h2>What is wrong, and what to do</h2>\n" + findings_html(*page.findings);
  }
  if (!page.next.empty()) body += "<p>The command to run next:</p>" + pre_html(page.next);
  if (!page.charts.empty()) body += "<h2>Values</h2>\n" + charts_html(page.charts);
  body += "<h2>All figures</h2>\n" + facts_html(page.facts);
  body += "<h2>To repeat it</h2>\n" + pre_html(page.command);
  return page_html({.title = name + ": " + page.kind,
                    .heading = name,
                    .subtitle = page.kind + ", by surfel-info",
                    .body_html = body,
                    .script = ""});
}

}  // namespace surfel
