#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/elementary.h>
#include <surfel/base/output_file.h>
#include <surfel/base/whole_file.h>
#include <surfel/chart/chart_judge.h>
#include <surfel/chart/chart_report.h>
#include <surfel/chart/plot.h>
#include <surfel/chart/tool_chain.h>
#include <surfel/io/image_io.h>
#include <surfel/report/page.h>

namespace surfel {
namespace {

using Json = nlohmann::json;

/// Pictures of differences are so many times brighter, for errors of a few levels of 8 bits to
/// show.
constexpr double kDifferenceScale = 10;

/// JSON knows no infinity: the PSNR of equal pictures is null.
Json finite(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

std::string psnr_text(double psnr) {
  return std::isfinite(psnr) ? fmt::format("{:.2f}", psnr) : "equal";
}

std::string milliseconds(double ms) {
  return ms >= 100  ? fmt::format("{:.0f}", ms)
         : ms >= 10 ? fmt::format("{:.1f}", ms)
                    : fmt::format("{:.2f}", ms);
}

/// PSNR for a plot, which does not tell errors apart that rounding to 8 bits alone makes.
double plotted_psnr(const ChartPoint& p) {
  return -20 * portable::log10(std::max(p.error.rmse, kRoundingError));
}

Plot plot_of(const ChartSweep& sweep) {
  Plot plot{sweep.time, {}};
  for (const ChartPoint& p : sweep.points) {
    if (!p.refused.empty()) continue;
    plot.points.push_back(
        {valid_utf8(p.label), p.time.median, plotted_psnr(p), p.front, p.standard});
  }
  return plot;
}

Json to_json(const TimeSpread& t) {
  return {{"median", t.median}, {"least", t.least}, {"most", t.most}};
}

Json to_json(const ChartPoint& p) {
  Json out = {{"label", valid_utf8(p.label)}, {"default", p.standard}, {"commands", Json::array()}};
  for (const std::string& command : p.commands) out["commands"].push_back(valid_utf8(command));
  if (!p.refused.empty()) {
    out["refused"] = valid_utf8(p.refused);
    return out;
  }
  Json stages = Json::object();
  for (const auto& [name, ms] : p.stages) stages[name] = ms;
  out["front"] = p.front;
  out["time_ms"] = to_json(p.time);
  out["render_ms"] = to_json(p.render);
  out["prepare_ms"] = p.prepare_ms;
  out["stages_ms"] = stages;
  out["memory_bytes"] = p.memory;
  out["surfels"] = p.surfels;
  out["groups"] = p.groups;
  out["psnr"] = finite(p.error.psnr);
  out["rmse"] = p.error.rmse;
  out["maximum"] = p.error.maximum;
  out["holes"] = p.error.holes;
  out["alpha_psnr"] = finite(p.error.alpha_psnr);
  if (p.flicker) out["flicker"] = *p.flicker;
  return out;
}

/// Pictures of the page.
class Pictures {
 public:
  /// A reference to a picture's file; EXR is made a PNG first.
  std::string file(const std::string& path) {
    if (path.ends_with(".png")) return page_.add(whole_file(path), read_image(path));
    return page_.add(read_premultiplied_image(path));
  }

  std::string difference(const std::string& tested, const std::string& truth) {
    return page_.add(difference_image(read_premultiplied_image(tested),
                                      read_premultiplied_image(truth), {}, kDifferenceScale));
  }

 private:
  PagePictures page_;
};

/// The points whose pictures are shown: the default, the fastest, the most and the least accurate.
std::vector<std::pair<std::string, const ChartPoint*>> shown_points(const ChartSweep& sweep) {
  std::vector<const ChartPoint*> measured;
  for (const ChartPoint& p : sweep.points) {
    if (p.refused.empty()) measured.push_back(&p);
  }
  const auto best = [&](auto less) {
    return *std::min_element(measured.begin(), measured.end(), less);
  };
  std::vector<std::pair<std::string, const ChartPoint*>> shown;
  const auto show = [&](const std::string& what, const ChartPoint* p) {
    for (auto& [name, other] : shown) {
      if (other != p) continue;
      name += ", " + what;
      return;
    }
    shown.emplace_back(what, p);
  };
  show("default", best([](auto* a, auto* b) { return a->standard > b->standard; }));
  show("fastest", best([](auto* a, auto* b) { return a->time.median < b->time.median; }));
  show("most accurate", best([](auto* a, auto* b) { return a->error.rmse < b->error.rmse; }));
  show("least accurate", best([](auto* a, auto* b) { return a->error.rmse > b->error.rmse; }));
  return shown;
}

std::string pictures_html(const ChartSweep& sweep, Pictures& pictures) {
  const auto shown = shown_points(sweep);
  std::string first = figure_html("", pictures.file(sweep.truth), "Truth");
  std::string second = "<div></div>\n";
  for (const auto& [what, p] : shown) {
    first += figure_html("", pictures.file(p->picture),
                         fmt::format("{} ({})", escape_html(p->label), what));
    second += figure_html("difference", pictures.difference(p->picture, sweep.truth),
                          fmt::format("its difference, times {:g}; {} dB", kDifferenceScale,
                                      psnr_text(p->error.psnr)));
  }
  return fmt::format(
      "<div class=\"pictures\" style=\"grid-template-columns:repeat({}, 1fr)\">\n{}{}</div>\n",
      shown.size() + 1, first, second);
}

std::string table_html(const ChartSweep& sweep) {
  const bool flicker = std::any_of(sweep.points.begin(), sweep.points.end(),
                                   [](const ChartPoint& p) { return p.flicker.has_value(); });
  const bool groups = std::any_of(sweep.points.begin(), sweep.points.end(),
                                  [](const ChartPoint& p) { return p.groups > 0; });
  std::string out = "<div class=\"wide\"><table class=\"points\"><tr><th>setting</th>";
  const auto head = [&](const char* name, const char* unit) {
    out += fmt::format("<th>{}<small>{}</small></th>", name, unit);
  };
  head("time", "median, ms");
  head("range", "ms");
  head("prepare", "ms");
  head("picture", "ms");
  head("memory", "MB");
  head("surfels", "");
  if (groups) head("K", "");
  head("PSNR", "dB");
  head("RMSE", "of 1");
  head("max", "of 1");
  head("holes", "%");
  if (flicker) head("flicker", "of 1");
  out += "</tr>\n";
  for (const ChartPoint& p : sweep.points) {
    out += fmt::format("<tr{}><td>{}{}{}</td>", p.standard ? " class=\"standard\"" : "",
                       escape_html(p.label),
                       p.standard ? "<span class=\"tag default\">default</span>" : "",
                       p.front ? "<span class=\"tag front\">front</span>" : "");
    if (!p.refused.empty()) {
      out += fmt::format("<td class=\"refused\" colspan=\"{}\">{}</td></tr>\n",
                         10 + (groups ? 1 : 0) + (flicker ? 1 : 0),
                         "not for this input: " + escape_html(p.refused));
      continue;
    }
    const auto cell = [&](const std::string& text) { out += "<td>" + text + "</td>"; };
    cell(milliseconds(p.time.median));
    cell(milliseconds(p.time.least) + "–" + milliseconds(p.time.most));
    cell(milliseconds(p.prepare_ms));
    cell(milliseconds(p.render.median));
    cell(fmt::format("{:.0f}", static_cast<double>(p.memory) / 1e6));
    cell(fmt::format("{}", p.surfels));
    if (groups) cell(p.groups > 0 ? fmt::format("{}", p.groups) : "");
    cell(psnr_text(p.error.psnr));
    cell(fmt::format("{:.4f}", p.error.rmse));
    cell(fmt::format("{:.3f}", p.error.maximum));
    cell(fmt::format("{:.3f}", 100 * p.error.holes));
    if (flicker) cell(p.flicker ? fmt::format("{:.4f}", *p.flicker) : "");
    out += "</tr>\n";
  }
  return out + "</table></div>\n";
}

std::string stages_html(const ChartSweep& sweep) {
  std::string out = "<details><summary>Times of the stages</summary><pre>";
  for (const ChartPoint& p : sweep.points) {
    if (!p.refused.empty()) continue;
    out += "<b>" + escape_html(p.label) + "</b>\n";
    for (const auto& [name, ms] : p.stages) {
      out += fmt::format("  {:32} {:>8} ms\n", escape_html(name), milliseconds(ms));
    }
  }
  return out + "</pre></details>\n";
}

std::string commands_html(const ChartSweep& sweep) {
  std::string out = "<details><summary>Commands that repeat each point</summary><pre>";
  for (const ChartPoint& p : sweep.points) {
    out += "<b># " + escape_html(p.label) + "</b>\n";
    for (const std::string& command : p.commands) out += escape_html(command) + "\n";
  }
  return out + "</pre></details>\n";
}

std::string sweep_html(const ChartSweep& sweep, Pictures& pictures, const std::string& folder) {
  std::string out =
      fmt::format("<h2 id=\"{0}\">{1}<code>{0}</code></h2>\n<p>{2}</p>\n", escape_html(sweep.name),
                  escape_html(sweep.title), escape_html(sweep.about));
  out += fmt::format("<p class=\"verdict{}\">{}</p>\n", sweep.standard_off ? " off" : "",
                     escape_html(sweep.verdict));
  out += fmt::format(
      "<img class=\"plot\" alt=\"Error against time: {}\" "
      "src=\"data:image/svg+xml;base64,{}\">\n",
      escape_html(sweep.title), base64(plot_svg(plot_of(sweep), folder)));
  return out + table_html(sweep) + pictures_html(sweep, pictures) + stages_html(sweep) +
         commands_html(sweep);
}

}  // namespace

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string report_csv(const ChartReport& report) {
  std::string out =
      "sweep,setting,default,front,time_ms,time_least_ms,time_most_ms,prepare_ms,render_ms,"
      "memory_bytes,surfels,groups,psnr_db,rmse,maximum,holes,alpha_psnr_db,flicker,refused,"
      "commands\r\n";
  const auto db = [](double psnr) {
    return std::isfinite(psnr) ? fmt::format("{:.6g}", psnr) : "inf";
  };
  for (const ChartSweep& sweep : report.sweeps) {
    for (const ChartPoint& p : sweep.points) {
      out += fmt::format("{},{},{:d},{:d},", csv_field(sweep.name), csv_field(p.label), p.standard,
                         p.front);
      if (p.refused.empty()) {
        out += fmt::format(
            "{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{},{},{},{},{:.6g},{:.6g},{:.6g},{},{},,",
            p.time.median, p.time.least, p.time.most, p.prepare_ms, p.render.median, p.memory,
            p.surfels, p.groups, db(p.error.psnr), p.error.rmse, p.error.maximum, p.error.holes,
            db(p.error.alpha_psnr), p.flicker ? fmt::format("{:.6g}", *p.flicker) : "");
      } else {
        out += std::string(14, ',') + csv_field(p.refused) + ",";
      }
      out += csv_field(fmt::format("{}", fmt::join(p.commands, " && "))) + "\r\n";
    }
  }
  return out;
}

std::string report_json(const ChartReport& report) {
  Json out = {
      {"summary", Json::object()}, {"truth_commands", Json::array()}, {"sweeps", Json::array()}};
  for (const auto& [key, value] : report.summary) out["summary"][key] = valid_utf8(value);
  for (const std::string& command : report.truth_commands) {
    out["truth_commands"].push_back(valid_utf8(command));
  }
  if (!report.camera_path.empty()) out["camera_path"] = report.camera_path;
  for (const ChartSweep& sweep : report.sweeps) {
    Json points = Json::array();
    for (const ChartPoint& p : sweep.points) points.push_back(to_json(p));
    out["sweeps"].push_back({{"name", sweep.name},
                             {"title", sweep.title},
                             {"time", sweep.time},
                             {"verdict", valid_utf8(sweep.verdict)},
                             {"default_off_front", sweep.standard_off},
                             {"default_time_factor", sweep.standard.time},
                             {"default_error_factor", sweep.standard.error},
                             {"points", points}});
  }
  return out.dump(2);
}

std::string report_html(const ChartReport& report, const std::string& command,
                        const std::string& folder) {
  Pictures pictures;
  std::string sweeps;
  std::string links;
  std::string off;
  for (const ChartSweep& sweep : report.sweeps) {
    sweeps += sweep_html(sweep, pictures, folder);
    links += fmt::format("<a href=\"#{0}\">{0}</a>\n", escape_html(sweep.name));
    if (!sweep.standard_off) continue;
    off += fmt::format("<p class=\"verdict off\"><b>{}</b>: {}</p>\n", escape_html(sweep.name),
                       escape_html(sweep.verdict));
  }
  if (off.empty()) {
    off = "<p class=\"verdict\">No default is off its Pareto front by more than 20 %.</p>\n";
  }
  std::string truth;
  for (const std::string& line : report.truth_commands) truth += line + "\n";
  if (!report.camera_path.empty()) {
    truth += "\n# path.toml, the cameras of the flicker's frames (--camera path.toml)\n" +
             report.camera_path;
  }
  const std::string input = report.summary.empty() ? "" : report.summary.front().second;
  const std::string name = input.substr(input.rfind('/') + 1);
  return page_html(
      {.title = "Speed against accuracy: " + name,
       .heading = "Speed against accuracy",
       .subtitle = name + ", by surfel-chart",
       .body_html = facts_html(report.summary) + "<h2>Defaults</h2>\n" + off + "<nav>" + links +
                    "</nav>\n" + sweeps + "<h2>To repeat it</h2>\n<p>The whole report:</p>" +
                    pre_html(command) + "<p>The truth, and the path:</p>" + pre_html(truth),
       .script = ""});
}

void write_report(const ChartReport& report, const std::string& command,
                  const std::string& work_folder, const std::string& folder, bool no_clobber) {
  OutputFile html(folder + "/report.html", no_clobber);
  OutputFile csv(folder + "/report.csv", no_clobber);
  OutputFile json(folder + "/report.json", no_clobber);
  html.write(report_html(report, command, work_folder));
  csv.write(report_csv(report));
  json.write(report_json(report) + "\n");
  html.commit();
  csv.commit();
  json.commit();
}

}  // namespace surfel
