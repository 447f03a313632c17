#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/io/png_writer.h>
#include <surfel/report/page.h>

namespace surfel {
namespace {

using Json = nlohmann::json;

const char* const kStyle = R"(
:root { color-scheme: light dark; --text: #222; --page: #fff; --soft: #666; --name: #555;
  --faint: #888; --line: #d8d8d8; --thin: #ececec; --rule: #999; --link: #174f82; --box: #f6f6f6;
  --mat: #f4f4f4; --bar: #4a7fb5; --good: #f1f7f2; --good-line: #5d9f6b; --bad: #fdf1ea;
  --bad-line: #d1491b; --front: #dbe9f6; --front-text: #174f82; --default: #f6d9cb;
  --default-text: #97310e; --check: #e9e9e9; }
@media (prefers-color-scheme: dark) {
  :root { --text: #ddd; --page: #16181b; --soft: #a0a4a8; --name: #b4b8bc; --faint: #8a8e92;
    --line: #3a3d41; --thin: #292c30; --rule: #6a6e72; --link: #82b7ea; --box: #212429;
    --mat: #212429; --bar: #6a9fd6; --good: #1b2a20; --bad: #33211a; --front: #1d3a55;
    --front-text: #a9d0f5; --default: #4d2a1c; --default-text: #f3b79c; --check: #2b2e33; }
}
* { box-sizing: border-box; }
body { font: 15px/1.5 "Helvetica Neue", Helvetica, Arial, sans-serif; color: var(--text);
  background: var(--page); max-width: 960px; margin: 0 auto; padding: 24px 20px 60px; }
h1 { font-size: 27px; font-weight: 600; margin: 0 0 2px; overflow-wrap: anywhere; }
h2 { font-size: 20px; font-weight: 600; margin: 46px 0 4px; padding-top: 14px;
  border-top: 1px solid var(--line); }
h2 code { font-size: 14px; color: var(--soft); font-weight: 400; margin-left: 8px; }
p { margin: 4px 0 10px; }
.sub { color: var(--soft); margin-bottom: 18px; overflow-wrap: anywhere; }
table { border-collapse: collapse; font-size: 13px; }
.facts th { text-align: left; font-weight: 600; color: var(--name); padding: 2px 18px 2px 0;
  vertical-align: top; white-space: nowrap; }
.facts td { padding: 2px 0; overflow-wrap: anywhere; }
.wide { overflow-x: auto; margin: 10px 0 14px; }
.points { width: 100%; font-variant-numeric: tabular-nums; }
.points th { text-align: right; font-weight: 600; color: var(--name);
  border-bottom: 1.5px solid var(--rule); padding: 3px 7px; vertical-align: bottom;
  line-height: 1.25; }
.points th small { font-weight: 400; color: var(--faint); display: block; font-size: 11px; }
.points td { text-align: right; border-bottom: 1px solid var(--thin); padding: 3px 7px;
  white-space: nowrap; }
.points th:first-child, .points td:first-child { text-align: left; padding-left: 0; }
.points td.refused { text-align: left; color: var(--faint); white-space: normal; }
.points tr.standard td { background: var(--bad); }
.tag { font-size: 11px; border-radius: 3px; padding: 0 5px; margin-left: 6px; }
.front { background: var(--front); color: var(--front-text); }
.default { background: var(--default); color: var(--default-text); }
.verdict { border-left: 4px solid var(--good-line); background: var(--good); padding: 6px 12px;
  overflow-wrap: anywhere; }
.verdict.off { border-color: var(--bad-line); background: var(--bad); }
.verdict pre { background: none; padding: 4px 0 0; margin: 0; }
.plot { width: 100%; max-width: 800px; display: block; margin: 6px 0; background: #fff; }
.pictures { display: grid; gap: 8px; margin: 12px 0; }
.gallery { display: grid; gap: 12px; margin: 12px 0;
  grid-template-columns: repeat(2, minmax(0, 1fr)); }
.charts { display: grid; gap: 18px 22px; margin: 12px 0;
  grid-template-columns: repeat(auto-fill, minmax(min(270px, 100%), 1fr)); }
figure { margin: 0; min-width: 0; }
figure svg { width: 100%; height: auto; display: block; background: var(--mat); }
figure.difference svg { background: #000; }
figure.chart svg { background: none; overflow: visible; }
figure.sheer svg, .compare { background-color: var(--mat); background-size: 16px 16px;
  background-image: conic-gradient(var(--check) 25%, transparent 0 50%, var(--check) 0 75%,
  transparent 0); }
.chart text { font-size: 10px; fill: var(--soft); }
.chart .bar { fill: var(--bar); }
.chart .axis { stroke: var(--rule); stroke-width: 1; }
figcaption { font-size: 12px; color: var(--name); padding: 2px 0 4px; line-height: 1.3;
  overflow-wrap: anywhere; }
details { margin: 8px 0; }
summary { cursor: pointer; color: var(--link); }
pre { font: 12px/1.45 "DejaVu Sans Mono", Menlo, Consolas, monospace; background: var(--box);
  padding: 8px 10px; white-space: pre-wrap; overflow-wrap: anywhere; margin: 6px 0; }
pre b { font-weight: 600; color: var(--name); }
nav a { margin-right: 12px; color: var(--link); text-decoration: none; }
.compare { --at: 50%; position: relative; overflow: hidden; line-height: 0; }
.compare svg { width: 100%; height: auto; display: block; }
.compare .over { position: absolute; inset: 0; clip-path: inset(0 calc(100% - var(--at)) 0 0); }
.compare .edge { position: absolute; inset: 0 auto 0 var(--at); width: 2px; margin-left: -1px;
  background: #fff; box-shadow: 0 0 3px #000; pointer-events: none; }
.compare span { position: absolute; top: 8px; font-size: 12px; line-height: 1.3; color: #fff;
  background: #000a; padding: 1px 7px; border-radius: 3px; pointer-events: none; }
.compare .first { left: 8px; } .compare .second { right: 8px; }
.slide { width: 100%; margin: 8px 0 0; accent-color: var(--bar); }
@media (max-width: 560px) {
  body { padding: 16px 12px 40px; }
  .facts th { white-space: normal; padding-right: 10px; }
}
)";

}  // namespace

std::string valid_utf8(const std::string& text) {
  return Json::parse(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace))
      .get<std::string>();
}

std::string escape_html(const std::string& text) {
  static const std::map<char, std::string> kEntities{
      {'<', "&lt;"}, {'>', "&gt;"}, {'&', "&amp;"}, {'"', "&quot;"}, {'\'', "&#39;"}};
  std::string out;
  for (const char c : valid_utf8(text)) {
    const auto entity = kEntities.find(c);
    out += entity == kEntities.end() ? std::string(1, c) : entity->second;
  }
  return out;
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

std::string page_html(const Page& page) {
  const std::string script =
      page.script.empty() ? "" : fmt::format("<script>\n{}</script>\n", page.script);
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<title>{}</title>\n<style>{}</style></head><body>\n"
      "<h1>{}</h1>\n<p class=\"sub\">{}</p>\n{}{}</body></html>\n",
      escape_html(page.title), kStyle, escape_html(page.heading), escape_html(page.subtitle),
      page.body_html, script);
}

std::string facts_html(const std::vector<std::pair<std::string, std::string>>& facts) {
  std::string rows;
  for (const auto& [name, value] : facts) {
    rows += fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", escape_html(name), escape_html(value));
  }
  return "<table class=\"facts\">\n" + rows + "</table>\n";
}

std::string figure_html(const std::string& kind, const std::string& content_html,
                        const std::string& caption_html) {
  return fmt::format("<figure class=\"{}\">{}<figcaption>{}</figcaption></figure>\n", kind,
                     content_html, caption_html);
}

std::string pre_html(const std::string& text) { return "<pre>" + escape_html(text) + "</pre>\n"; }

std::string PagePictures::add(const Image& image) {
  const std::vector<unsigned char> png = encode_png(image, {});
  return add(std::string(png.begin(), png.end()), image);
}

/// The first use holds the picture, later ones refer to it.
std::string PagePictures::add(const std::string& png, const Image& image) {
  const std::string open = fmt::format(R"(<svg viewBox="0 0 {0} {1}" width="{0}" height="{1}">)",
                                       image.width, image.height);
  const auto [place, is_new] = known_.emplace(png, fmt::format("p{}", known_.size()));
  if (!is_new) return open + fmt::format(R"(<use href="#{}"/></svg>)", place->second);
  return open + fmt::format(R"(<image id="{}" width="{}" height="{}" )"
                            R"(href="data:image/png;base64,{}"/></svg>)",
                            place->second, image.width, image.height, base64(png));
}

}  // namespace surfel
