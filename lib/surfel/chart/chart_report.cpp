#include <algorithm>
#include <cmath>
#include <map>

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
#include <surfel/scene/image.h>

namespace surfel {
namespace {

using Json = nlohmann::json;

/// Pictures of differences are so many times brighter, for errors of a few levels of 8 bits to
/// show.
constexpr double kDifferenceScale = 10;

const char* const kStyle = R"(
:root { color-scheme: light; }
body { font: 15px/1.5 "Helvetica Neue", Helvetica, Arial, sans-serif; color: #222; background: #fff;
  max-width: 960px; margin: 0 auto; padding: 24px 20px 60px; }
h1 { font-size: 27px; font-weight: 600; margin: 0 0 2px; }
h2 { font-size: 20px; font-weight: 600; margin: 46px 0 4px; padding-top: 14px;
  border-top: 1px solid #d8d8d8; }
h2 code { font-size: 14px; color: #666; font-weight: 400; margin-left: 8px; }
p { margin: 4px 0 10px; }
.sub { color: #666; margin-bottom: 18px; }
table { border-collapse: collapse; font-size: 13px; }
.facts th { text-align: left; font-weight: 600; color: #555; padding: 2px 18px 2px 0;
  vertical-align: top; white-space: nowrap; }
.facts td { padding: 2px 0; overflow-wrap: anywhere; }
.wide { overflow-x: auto; margin: 10px 0 14px; }
.points { width: 100%; font-variant-numeric: tabular-nums; }
.points th { text-align: right; font-weight: 600; color: #555; border-bottom: 1.5px solid #999;
  padding: 3px 7px; vertical-align: bottom; line-height: 1.25; }
.points th small { font-weight: 400; color: #888; display: block; font-size: 11px; }
.points td { text-align: right; border-bottom: 1px solid #ececec; padding: 3px 7px;
  white-space: nowrap; }
.points th:first-child, .points td:first-child { text-align: left; padding-left: 0; }
.points td.refused { text-align: left; color: #888; white-space: normal; }
.points tr.standard td { background: #fdf1ea; }
.tag { font-size: 11px; border-radius: 3px; padding: 0 5px; margin-left: 6px; }
.front { background: #dbe9f6; color: #174f82; }
.default { background: #f6d9cb; color: #97310e; }
.verdict { border-left: 4px solid #5d9f6b; background: #f1f7f2; padding: 6px 12px; }
.verdict.off { border-color: #d1491b; background: #fdf1ea; }
.plot { width: 100%; max-width: 800px; display: block; margin: 6px 0; }
.pictures { display: grid; gap: 8px; margin: 12px 0; }
figure { margin: 0; min-width: 0; }
figure svg { width: 100%; height: auto; display: block; background: #f4f4f4; }
figure.difference svg { background: #000; }
figcaption { font-size: 12px; color: #555; padding: 2px 0 4px; line-height: 1.3; }
details { margin: 8px 0; }
summary { cursor: pointer; color: #174f82; }
pre { font: 12px/1.45 "DejaVu Sans Mono", Menlo, Consolas, monospace; background: #f6f6f6;
  padding: 8px 10px; white-space: pre-wrap; overflow-wrap: anywhere; margin: 6px 0; }
pre b { font-weight: 600; color: #555; }
nav a { margin-right: 12px; color: #174f82; text-decoration: none; }
)";

/// Bytes that are not UTF-8 replaced, so that the text can stand in a page and in JSON.
std::string utf8(const std::string& text) {
  return Json::parse(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace))
      .get<std::string>();
}

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
    plot.points.push_back({utf8(p.label), p.time.median, plotted_psnr(p), p.front, p.standard});
  }
  return plot;
}

Json to_json(const TimeSpread& t) {
  return {{"median", t.median}, {"least", t.least}, {"most", t.most}};
}

Json to_json(const ChartPoint& p) {
  Json out = {{"label", utf8(p.label)}, {"default", p.standard}, {"commands", Json::array()}};
  for (const std::string& command : p.commands) out["commands"].push_back(utf8(command));
  if (!p.refused.empty()) {
    out["refused"] = utf8(p.refused);
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

/// Pictures of a page, each of them in it once.
class Pictures {
 public:
  explicit Pictures(std::string folder) : folder_(std::move(folder)) {}

  /// A reference to a picture's file; EXR is made a PNG first.
  std::string file(const std::string& path) {
    if (path.ends_with(".png")) return use(whole_file(path), read_image(path));
    const Image image = read_premultiplied_image(path);
    return use(png(image), image);
  }

  std::string difference(const std::string& tested, const std::string& truth) {
    const Image image = difference_image(read_premultiplied_image(tested),
                                         read_premultiplied_image(truth), {}, kDifferenceScale);
    return use(png(image), image);
  }

 private:
  std::string png(const Image& image) const {
    const std::string path = folder_ + "/page.png";
    write_image(image, path);
    return whole_file(path);
  }

  /// The first use holds the picture, later ones refer to it.
  std::string use(const std::string& bytes, const Image& image) {
    const std::string id = "p" + text_hash(bytes);
    const std::string open = fmt::format(R"(<svg viewBox="0 0 {0} {1}" width="{0}" height="{1}">)",
                                         image.width, image.height);
    if (!known_.emplace(id, true).second)
      return open + fmt::format(R"(<use href="#{}"/></svg>)", id);
    return open + fmt::format(R"(<image id="{}" width="{}" height="{}" )"
                              R"(href="data:image/png;base64,{}"/></svg>)",
                              id, image.width, image.height, base64(bytes));
  }

  std::string folder_;
  std::map<std::string, bool> known_;
};

std::string figure(const std::string& kind, const std::string& picture,
                   const std::string& caption) {
  return fmt::format("<figure class=\"{}\">{}<figcaption>{}</figcaption></figure>\n", kind, picture,
                     caption);
}

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
  std::string first = figure("", pictures.file(sweep.truth), "Truth");
  std::string second = "<div></div>\n";
  for (const auto& [what, p] : shown) {
    first +=
        figure("", pictures.file(p->picture), fmt::format("{} ({})", escape_html(p->label), what));
    second += figure("difference", pictures.difference(p->picture, sweep.truth),
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

std::string escape_html(const std::string& text) {
  static const std::map<char, std::string> kEntities{
      {'<', "&lt;"}, {'>', "&gt;"}, {'&', "&amp;"}, {'"', "&quot;"}, {'\'', "&#39;"}};
  std::string out;
  for (const char c : utf8(text)) {
    const auto entity = kEntities.find(c);
    out += entity == kEntities.end() ? std::string(1, c) : entity->second;
  }
  return out;
}

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string base64(const std::string& bytes) {
  static const char* const kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const auto byte = [&](std::size_t k) {
      return i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U;
    };
    const unsigned word = byte(0) << 16 | byte(1) << 8 | byte(2);
    out += kDigits[word >> 18];
    out += kDigits[word >> 12 & 63];
    out += i + 1 < bytes.size() ? kDigits[word >> 6 & 63] : '=';
    out += i + 2 < bytes.size() ? kDigits[word & 63] : '=';
  }
  return out;
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
  for (const auto& [key, value] : report.summary) out["summary"][key] = utf8(value);
  for (const std::string& command : report.truth_commands) {
    out["truth_commands"].push_back(utf8(command));
  }
  if (!report.camera_path.empty()) out["camera_path"] = report.camera_path;
  for (const ChartSweep& sweep : report.sweeps) {
    Json points = Json::array();
    for (const ChartPoint& p : sweep.points) points.push_back(to_json(p));
    out["sweeps"].push_back({{"name", sweep.name},
                             {"title", sweep.title},
                             {"time", sweep.time},
                             {"verdict", utf8(sweep.verdict)},
                             {"default_off_front", sweep.standard_off},
                             {"default_time_factor", sweep.standard.time},
                             {"default_error_factor", sweep.standard.error},
                             {"points", points}});
  }
  return out.dump(2);
}

std::string report_html(const ChartReport& report, const std::string& command,
                        const std::string& folder) {
  Pictures pictures(folder);
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
  std::string facts;
  for (const auto& [key, value] : report.summary) {
    facts += fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", escape_html(key), escape_html(value));
  }
  std::string truth;
  for (const std::string& line : report.truth_commands) truth += escape_html(line) + "\n";
  if (!report.camera_path.empty()) {
    truth += "\n# path.toml, the cameras of the flicker's frames (--camera path.toml)\n" +
             escape_html(report.camera_path);
  }
  const std::string input = report.summary.empty() ? "" : report.summary.front().second;
  const std::string name = escape_html(input.substr(input.rfind('/') + 1));
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<title>Speed against accuracy: {0}</title>\n<style>{1}</style></head><body>\n"
      "<h1>Speed against accuracy</h1>\n<p class=\"sub\">{0}, by surfel-chart</p>\n"
      "<table class=\"facts\">\n{2}</table>\n<h2>Defaults</h2>\n{3}<nav>{4}</nav>\n{5}"
      "<h2>To repeat it</h2>\n<p>The whole report:</p><pre>{6}</pre>\n<p>The truth, and the path:"
      "</p><pre>{7}</pre>\n</body></html>\n",
      name, kStyle, facts, off, links, sweeps, escape_html(command), truth);
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
