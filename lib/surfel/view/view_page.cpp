#include <algorithm>
#include <array>
#include <filesystem>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/scene/color_map.h>
#include <surfel/view/page_files.h>
#include <surfel/view/view_page.h>
#include <zlib.h>

namespace surfel {
namespace {

std::string_view page_file(std::string_view name) {
  const auto& files = page_files();
  const auto found = std::find_if(files.begin(), files.end(),
                                  [&](const PageFile& file) { return file.name == name; });
  return found->text;
}

std::string base64(std::string_view bytes) {
  std::string text;
  append_base64(bytes, text);
  return text;
}

/// The modules' texts by their names, as JSON, in the format of zlib.
std::string packed_modules() {
  nlohmann::json modules;
  for (const PageFile& file : page_files()) {
    if (file.name.ends_with(".js")) modules[std::string(file.name)] = file.text;
  }
  const std::string text = modules.dump();
  uLongf size = compressBound(text.size());
  std::string packed(size, '\0');
  compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
            reinterpret_cast<const Bytef*>(text.data()), text.size(), Z_BEST_COMPRESSION);
  packed.resize(size);
  return packed;
}

std::vector<double> numbers(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }

/// Text between tags of HTML.
std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '&') {
      out += "&amp;";
    } else if (c == '"') {
      out += "&quot;";
    } else {
      out += c;
    }
  }
  return out;
}

/// JSON that may stand in an element of HTML.
std::string json_in_html(const nlohmann::json& json) {
  std::string text = json.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) {
    text.replace(at, 1, "\\u003c");
  }
  return text;
}

/// sRGB codes of the colour map that attributes are shown by.
std::string map_codes() {
  std::string codes;
  for (int i = 0; i < 256; ++i) {
    const Vec3f color = map_color(ColorMap::kViridis, i / 255.0);
    for (int c = 0; c < 3; ++c) codes += static_cast<char>(linear_to_srgb8(color[c]));
  }
  return codes;
}

std::string short_name(const std::string& path) {
  const std::filesystem::path whole(path);
  return whole.has_filename() ? whole.filename().string()
                              : whole.parent_path().filename().string() + "/";
}

nlohmann::json described(const ViewCloud& cloud) {
  const LoadedCloud& loaded = cloud.loaded();
  const RenderCloud& surfels = loaded.surfels();
  const std::size_t finest = surfels.size() - surfels.first_finest();
  const int levels = cloud.has_levels() ? surfels.tree().front().level + 1 : 1;
  std::string facts = fmt::format("{} surfels", finest);
  if (levels > 1) facts += fmt::format(" in {} levels", levels);
  const SceneExtent extent = surfels.extent();
  nlohmann::json json{
      {"name", short_name(cloud.path())},
      {"path", shell_file(cloud.path())},
      {"facts", facts},
      {"surfels", finest},
      {"levels", levels},
      {"clusters", cloud.clusters()},
      {"colored", cloud.colored()},
      {"recorded", loaded.color_light() == ColorLight::kRecorded},
      {"opaque", !surfels.transparent()},
      {"hidden", cloud.not_shown()},
      {"shading", surfels.has_shading()},
      {"clips", surfels.has_clips()},
      {"origin", numbers(surfels.origin())},
      {"min", numbers(extent.box.min)},
      {"max", numbers(extent.box.max)},
      {"attribute", cloud.attribute()},
      {"attributeWord", shell_quoted(cloud.attribute())},
      {"range", {cloud.attribute_range().first, cloud.attribute_range().second}},
  };
  return json;
}

/// All that the page is told.
nlohmann::json page_facts(const std::vector<const ViewCloud*>& clouds,
                          const ViewPageOptions& options, bool served) {
  nlohmann::json json{{"served", served}, {"map", base64(map_codes())}};
  json["camera"] = {{"eye", numbers(options.eye)},
                    {"target", numbers(options.target)},
                    {"up", numbers(options.up.normalized())},
                    {"fov", options.fov},
                    {"ortho", options.ortho.value_or(0)}};
  Bounds bounds;
  for (const ViewCloud* cloud : clouds) {
    json["files"].push_back(described(*cloud));
    const Bounds box = cloud->loaded().surfels().extent().box;
    bounds.add(box.min);
    bounds.add(box.max);
  }
  json["bounds"] = {{"min", numbers(bounds.min)}, {"max", numbers(bounds.max)}};
  return json;
}

using PageValues = std::array<std::pair<std::string_view, std::string>, 6>;

/// A template whose placeholders are replaced by their values. Values are not searched for
/// placeholders: a file's name in a value may look like one.
std::string filled(std::string_view text, const PageValues& values) {
  std::string out;
  while (!text.empty()) {
    const auto* const value = std::find_if(values.begin(), values.end(), [&](const auto& each) {
      return text.starts_with(each.first);
    });
    out += value == values.end() ? text.substr(0, 1) : std::string_view(value->second);
    text.remove_prefix(value == values.end() ? 1 : value->first.size());
  }
  return out;
}

/// The parts of the page before and after the surfels.
std::pair<std::string, std::string> frame_of(const std::vector<const ViewCloud*>& clouds,
                                             const ViewPageOptions& options, bool served) {
  std::string title;
  for (const ViewCloud* cloud : clouds) {
    title += (title.empty() ? "" : ", ") + short_name(cloud->path());
  }
  const PageValues values{{
      {"@generator@", escaped(options.generator)},
      {"@connect@", served ? "'self'" : "'none'"},
      {"@title@", escaped(title)},
      {"@style@", std::string(page_file("view.css"))},
      {"@modules@", base64(packed_modules())},
      {"@page@", json_in_html(page_facts(clouds, options, served))},
  }};
  const std::string_view text = page_file("view.html");
  constexpr std::string_view kData = "@data@\n";
  const std::size_t data = text.find(kData);
  return {filled(text.substr(0, data), values), filled(text.substr(data + kData.size()), values)};
}

void require_size(const std::vector<const ViewCloud*>& clouds, const ViewPageOptions& options) {
  std::uint64_t bytes = 0;
  for (const ViewCloud* cloud : clouds) bytes += cloud->most_bytes();
  if (bytes <= options.most_bytes) return;
  const ViewCloud& first = *clouds.front();
  const std::string levels = first.has_levels() ? first.path() : "levels.ply";
  const std::string make =
      first.has_levels() ? ""
                         : fmt::format("surfel-lod {} -o {} && ", shell_file(first.path()), levels);
  throw_input(first.path(),
              fmt::format("would make a page of {} MB, and browsers take {} MB; {}surfel-view {} "
                          "--serve shows what a view needs",
                          bytes >> 20, options.most_bytes >> 20, make, shell_file(levels)));
}

/// Bytes of packed clusters in one element of the page, a multiple of what base64 encodes at once.
constexpr std::size_t kElement = std::size_t{3} << 20;

void write_element(const std::string& id, std::string_view bytes,
                   FunctionRef<void(std::string_view)> write) {
  write(fmt::format("<script type=\"text/plain\" id=\"{}\">", id));
  write(base64(bytes));
  write("</script>\n");
}

void write_surfels(const ViewCloud& cloud, std::size_t number,
                   FunctionRef<void(std::string_view)> write) {
  std::string bytes;
  cloud.append_records(0, cloud.clusters(), bytes);
  write_element(fmt::format("records-{}", number), bytes, write);
  bytes.clear();
  std::size_t part = 0;
  std::vector<std::uint32_t> some;
  constexpr std::size_t kSome = 256;
  for (std::size_t first = 0; first < cloud.clusters(); first += kSome) {
    some.clear();
    for (std::size_t c = first; c < std::min(first + kSome, cloud.clusters()); ++c) {
      some.push_back(static_cast<std::uint32_t>(c));
    }
    cloud.append_clusters(some, bytes);
    if (bytes.size() < kElement && first + kSome < cloud.clusters()) continue;
    write_element(fmt::format("clusters-{}-{}", number, part++), bytes, write);
    bytes.clear();
  }
}

}  // namespace

void write_view_page(const std::vector<const ViewCloud*>& clouds, const ViewPageOptions& options,
                     FunctionRef<void(std::string_view text)> write) {
  require_size(clouds, options);
  const auto [before, after] = frame_of(clouds, options, false);
  write(before);
  for (std::size_t i = 0; i < clouds.size(); ++i) write_surfels(*clouds[i], i, write);
  write(after);
}

std::string served_view_page(const std::vector<const ViewCloud*>& clouds,
                             const ViewPageOptions& options) {
  const auto [before, after] = frame_of(clouds, options, true);
  return before + after;
}

void append_base64(std::string_view bytes, std::string& to) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  to.reserve(to.size() + (bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto byte = k < left ? static_cast<unsigned char>(bytes[i + k]) : 0U;
      group = group << 8 | byte;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      to += k <= left ? kDigits[group >> (18 - 6 * k) & 63] : '=';
    }
  }
}

}  // namespace surfel
