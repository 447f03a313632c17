#include "tools/render/pixel_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/render/renderer.h>
#include <surfel/store/colored_source.h>

namespace surfel::render_tool {
namespace {

/// Rows of the table of splats, at most, of what has a share of the pixel and of what has none: the
/// ones with the largest shares and weights.
constexpr std::size_t kMostShared = 40;
constexpr std::size_t kMostOthers = 10;

struct FateWords {
  const char* name;    ///< In reports.
  const char* reason;  ///< After "3 splats: ".
};

FateWords words_of(SplatFate fate) {
  switch (fate) {
    case SplatFate::kBlended:
      return {"blended", "blended"};
    case SplatFate::kFilledUp:
      return {"filled up",
              "came after their surface had been merged, and fill what the merged ones leave open"};
    case SplatFate::kOutside:
      return {"outside", "end before the pixel (cutoff, or a line that cuts them)"};
    case SplatFate::kHidden:
      return {
          "hidden",
          "lie behind what covers the pixel, by more than the depth tolerance, and are not seen"};
    case SplatFate::kTooLate:
      return {"too late",
              "came after their surface had been merged for want of layers, and are left out"};
    case SplatFate::kTooLittle:
      return {"too little", "find no free layer, and are too little to merge others for"};
    case SplatFate::kReplaced:
      return {"replaced", "lie behind the surface that has the pixel's only layer"};
    case SplatFate::kUnused:
      return {"unused", "are not what the method blends here: another fragment is their layer's"};
  }
  return {"", ""};
}

/// Numbers as people read them: four figures.
std::string figures(double value) { return fmt::format("{:.4g}", value); }

std::string color_text(const Vec3f& color) {
  return fmt::format("{:.4g} {:.4g} {:.4g}", color.x(), color.y(), color.z());
}

/// A table whose columns are as wide as they need to be.
class Table {
 public:
  explicit Table(std::vector<std::string> head) { rows_.push_back(std::move(head)); }
  void add(std::vector<std::string> row) { rows_.push_back(std::move(row)); }
  std::string text() const {
    std::vector<std::size_t> width(rows_.front().size(), 0);
    for (const auto& row : rows_) {
      for (std::size_t i = 0; i < row.size(); ++i) width[i] = std::max(width[i], row[i].size());
    }
    std::string out;
    for (const auto& row : rows_) {
      std::string line = "  ";
      for (std::size_t i = 0; i < row.size(); ++i) {
        line += fmt::format("  {:<{}}", row[i], width[i]);
      }
      out += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
    }
    return out;
  }

 private:
  std::vector<std::vector<std::string>> rows_;
};

std::string layers_text(const PixelExplanation& pixel) {
  if (pixel.layers.empty()) return {};
  Table table({"layer", "share", "depth", "weight", "splats", "side", "colour"});
  for (std::size_t i = 0; i < pixel.layers.size(); ++i) {
    const ExplainedLayer& layer = pixel.layers[i];
    table.add({std::to_string(i), figures(layer.share), figures(layer.depth),
               layer.merged ? "merged" : figures(layer.weight), std::to_string(layer.splats),
               layer.front ? "front" : "back", color_text(layer.color)});
  }
  return "  layers, nearest first:\n" + table.text();
}

/// The splats to be shown, in the order in which they were drawn.
std::vector<std::size_t> shown_splats(const PixelExplanation& pixel) {
  std::vector<std::size_t> shared;
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < pixel.splats.size(); ++i) {
    const ExplainedSplat& splat = pixel.splats[i];
    if (splat.fate == SplatFate::kOutside) continue;
    (splat.share > 0 ? shared : others).push_back(i);
  }
  const auto keep = [](std::vector<std::size_t>& from, std::size_t most, const auto& value_of) {
    std::stable_sort(from.begin(), from.end(),
                     [&](std::size_t a, std::size_t b) { return value_of(a) > value_of(b); });
    from.resize(std::min(from.size(), most));
  };
  keep(shared, kMostShared, [&](std::size_t i) { return pixel.splats[i].share; });
  keep(others, kMostOthers, [&](std::size_t i) { return pixel.splats[i].weight; });
  shared.insert(shared.end(), others.begin(), others.end());
  std::sort(shared.begin(), shared.end());
  return shared;
}

/// What the colours of a pixel's splats stand for, by a legend.
class LegendValues {
 public:
  explicit LegendValues(const Legend& legend) : legend_(legend) {}

  /// The value of a splat, a number or the name of a category; null: it has none.
  tool::Json of(const ExplainedSplat& splat) const {
    if (legend_.entries.empty()) {
      const std::optional<double> value = colors().value_of(splat.color);
      return value ? tool::Json(*value) : tool::Json();
    }
    const auto entry = std::find_if(
        legend_.entries.begin(), legend_.entries.end(),
        [&](const Legend::Entry& e) { return (e.color - splat.color).norm() < kSameColor; });
    return entry == legend_.entries.end() ? tool::Json() : tool::Json(entry->text);
  }

  /// Of a pixel the mean of the splats' numbers by their shares, or the categories' shares; null
  /// where no splat with a value has a share.
  tool::Json of(const PixelExplanation& pixel) const {
    double sum = 0;
    double shares = 0;
    tool::Json categories = tool::Json::object();
    for (const ExplainedSplat& splat : pixel.splats) {
      const tool::Json value = of(splat);
      if (!(splat.share > 0) || value.is_null()) continue;
      shares += splat.share;
      if (value.is_number()) {
        sum += splat.share * value.number();
      } else {
        tool::Json& share = categories[value.text()];
        share = share.number() + splat.share;
      }
    }
    if (!(shares > 0)) return {};
    return legend_.entries.empty() ? tool::Json(sum / shares) : categories;
  }

  std::string text(const tool::Json& value) const {
    if (value.is_null()) return "-";
    return value.is_number() ? figures(value.number()) : value.text();
  }

  /// A line about a pixel; empty where it has no value.
  std::string line(const PixelExplanation& pixel) const {
    const tool::Json value = of(pixel);
    if (value.is_null()) return {};
    if (value.is_number()) {
      return fmt::format("  {} by the legend: {} (mean of the splats' values by their shares)\n",
                         legend_.title, text(value));
    }
    std::map<std::string, double> categories;
    auto key = value.keys().begin();
    for (const tool::Json& share : value.items()) categories[*key++] = share.number();
    std::string out;
    for (const auto& [name, share] : categories) {
      out += fmt::format("{}{} ({} of the pixel)", out.empty() ? "" : ", ", name, figures(share));
    }
    return fmt::format("  {} by the legend: {}\n", legend_.title, out);
  }

 private:
  /// Colours of categories differ by more.
  static constexpr float kSameColor = 1e-4F;

  AttributeColors colors() const { return {legend_.map, legend_.min, legend_.max}; }

  const Legend& legend_;
};

std::string splats_text(const PixelExplanation& pixel, const Legend* legend) {
  const std::vector<std::size_t> shown = shown_splats(pixel);
  if (shown.empty()) return {};
  const bool groups = pixel.splats.front().group.has_value();
  std::vector<std::string> head{"surfel",      "share", "weight", "=",    "kernel",
                                "coefficient", "clip",  "depth",  "layer"};
  if (groups) head.emplace_back("group");
  if (legend) head.push_back(legend->title);
  head.insert(head.end(), {"kind", "colour", "alpha", "fate"});
  Table table(head);
  double left = 0;
  for (const ExplainedSplat& splat : pixel.splats) left += splat.share;
  for (const std::size_t i : shown) {
    const ExplainedSplat& splat = pixel.splats[i];
    left -= splat.share;
    std::vector<std::string> row{std::to_string(splat.surfel),
                                 figures(splat.share),
                                 figures(splat.weight),
                                 "",
                                 figures(splat.kernel),
                                 figures(splat.coefficient),
                                 figures(splat.clip),
                                 figures(splat.depth),
                                 splat.layer < 0 ? "-" : std::to_string(splat.layer)};
    if (groups) row.push_back(splat.group ? std::to_string(*splat.group) : "-");
    if (legend) {
      const LegendValues values(*legend);
      row.push_back(values.text(values.of(splat)));
    }
    row.insert(row.end(), {splat.exact ? "exact" : "affine", color_text(splat.color),
                           figures(splat.alpha), words_of(splat.fate).name});
    table.add(std::move(row));
  }
  std::string out = "  splats, in the order in which they are drawn:\n" + table.text();
  const auto all = static_cast<std::size_t>(
      std::count_if(pixel.splats.begin(), pixel.splats.end(),
                    [](const ExplainedSplat& s) { return s.fate != SplatFate::kOutside; }));
  if (all > shown.size()) {
    out += fmt::format("  and {} more, with a share of {:.4g} together; --stats lists all\n",
                       all - shown.size(), std::max(0.0, left));
  }
  return out;
}

/// How many splats are not blended, and why.
std::string fates_text(const PixelExplanation& pixel) {
  std::map<SplatFate, std::size_t> counts;
  for (const ExplainedSplat& splat : pixel.splats) ++counts[splat.fate];
  std::string out;
  for (const auto& [fate, count] : counts) {
    if (fate == SplatFate::kBlended) continue;
    out += fmt::format("  {} splat{}: {}\n", count, count == 1 ? "" : "s", words_of(fate).reason);
  }
  return out;
}

tool::Json json_of(const Vec3f& color) { return {color.x(), color.y(), color.z()}; }

}  // namespace

void require_pixels(const Settings& s, const std::vector<View>& views) {
  if (s.explained_pixels.empty()) return;
  for (const View& view : views) {
    if (view.lens) {
      throw_usage("--explain-pixel is of cameras without distortion; see colmap image_undistorter");
    }
    for (const auto& [x, y] : s.explained_pixels) require_in_picture(view.camera, x, y);
  }
}

std::vector<PixelExplanation> explain_pixels(const Settings& s, const LoadedCloud& surfels,
                                             const Scene& scene, const Camera& camera) {
  if (s.explained_pixels.empty()) return {};
  return Renderer(surfels.store(), scene, s.render).explain(camera, s.explained_pixels);
}

tool::Json to_json(const PixelExplanation& pixel, const Legend* legend) {
  tool::Json splats = tool::Json::array();
  for (const ExplainedSplat& splat : pixel.splats) {
    tool::Json one = {{"surfel", splat.surfel},
                      {"fate", words_of(splat.fate).name},
                      {"share", splat.share},
                      {"weight", splat.weight},
                      {"kernel", splat.kernel},
                      {"coefficient", splat.coefficient},
                      {"clip", splat.clip},
                      {"depth", splat.depth},
                      {"kind", splat.exact ? "exact" : "affine"},
                      {"side", splat.front ? "front" : "back"},
                      {"in_sheet", splat.in_sheet},
                      {"color", json_of(splat.color)},
                      {"alpha", splat.alpha}};
    if (splat.layer >= 0) one["layer"] = splat.layer;
    if (splat.group) one["group"] = *splat.group;
    if (legend) one["value"] = LegendValues(*legend).of(splat);
    splats.push_back(std::move(one));
  }
  tool::Json layers = tool::Json::array();
  for (const ExplainedLayer& layer : pixel.layers) {
    layers.push_back({{"share", layer.share},
                      {"depth", layer.depth},
                      {"merged", layer.merged},
                      {"weight", layer.weight},
                      {"splats", layer.splats},
                      {"side", layer.front ? "front" : "back"},
                      {"color", json_of(layer.color)}});
  }
  tool::Json out = {{"x", pixel.x},
                    {"y", pixel.y},
                    {"pixel", pixel.pixel},
                    {"surfaces", json_of(pixel.surfaces)},
                    {"alpha", pixel.alpha},
                    {"background", pixel.background},
                    {"edge", pixel.edge},
                    {"filled", pixel.filled},
                    {"relief", pixel.relief},
                    {"environment", json_of(pixel.environment)},
                    {"colors", pixel.display ? "sRGB" : "linear"},
                    {"splats_add_up", pixel.splats_add_up},
                    {"layers", std::move(layers)},
                    {"splats", std::move(splats)}};
  if (legend) {
    out["legend"] = {{"title", legend->title}, {"value", LegendValues(*legend).of(pixel)}};
  }
  return out;
}

std::string to_text(const PixelExplanation& pixel, const std::string& picture,
                    const Legend* legend) {
  const std::array<float, 4>& p = pixel.pixel;
  std::array<int, 3> codes{};
  for (std::size_t c = 0; c < 3; ++c) {
    const float straight = p[3] > 0 ? p[c] / p[3] : 0;
    codes[c] = static_cast<int>(
        std::lround(255 * std::clamp(static_cast<double>(linear_to_srgb(straight)), 0.0, 1.0)));
  }
  std::string out = fmt::format(
      "{}, pixel {},{}: {:.4g} {:.4g} {:.4g}, alpha {:.4g} (linear, premultiplied; sRGB {} {} "
      "{})\n",
      picture, pixel.x, pixel.y, p[0], p[1], p[2], p[3], codes[0], codes[1], codes[2]);
  if (pixel.display) out += "  colours below are sRGB, and are blended so\n";
  if (legend) out += LegendValues(*legend).line(pixel);
  out += layers_text(pixel);
  if (!pixel.layers.empty() || !pixel.splats.empty()) {
    out += fmt::format("  together: {}, alpha {:.4g}; the background has {:.4g} of the pixel\n",
                       color_text(pixel.surfaces), pixel.alpha, 1 - pixel.alpha);
  }
  if (pixel.filled) {
    out += "  no kernel reaches the pixel: it has the mean colour around it at the edge\n";
  }
  if (std::abs(pixel.edge - 1) > 1e-6) {
    out += fmt::format(
        "  the filter of edges multiplies opacity by {:.4g}, which is in the shares\n", pixel.edge);
  }
  if (std::abs(pixel.relief - 1) > 1e-6) {
    out += fmt::format("  relief multiplies colour by {:.4g}\n", pixel.relief);
  }
  if (!pixel.environment.isZero(0)) {
    out += fmt::format("  of the environment: {}\n", color_text(pixel.environment));
  }
  if (!pixel.splats_add_up && !pixel.layers.empty()) {
    out += "  layers are shaded as a whole; colours of splats are not lit\n";
  }
  return out + splats_text(pixel, legend) + fates_text(pixel);
}

}  // namespace surfel::render_tool
