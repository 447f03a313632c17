#include "tools/render/coloring.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/measure/terrain.h>
#include <surfel/measure/view_guess.h>
#include <surfel/store/attribute_values.h>
#include <surfel/store/cloud_stream.h>
#include <surfel/store/colored_source.h>

namespace surfel::render_tool {
namespace {

constexpr const char* kElevation = "elevation";
constexpr const char* kIntensity = "intensity";

/// An attribute to show, and the upward direction.
struct Choice {
  std::string attribute;  ///< Empty: none.
  Vec3d up{0, 0, 1};
};

/// The attribute that the settings name, or that suits surfels without colours.
Choice choose(const Settings& s, const std::optional<Vec3d>& given_up, const CloudFacts& facts,
              bool colored) {
  const bool automatic = s.color_by == "auto";
  // Materials of a scene file are colours, too.
  if (s.color_by == "none" || (automatic && (colored || !s.scene_file.empty()))) return {};
  if (!automatic && s.color_by != kElevation) return {s.color_by};
  const SurfaceSample sample = facts.sample();
  const std::optional<Vec3d> up = given_up ? given_up : facts.up;
  const ViewGuess guess = guess_view(sample, {.up = up, .viewpoint = facts.viewpoint});
  if (!automatic || is_terrain(sample, guess)) return {kElevation, guess.up};
  return {AttributeValues::find(facts.source, kIntensity).value_or("")};
}

ColorMap map_of(const Settings& s, const std::string& attribute, const SurfelSource& source) {
  switch (s.color_map) {
    case MapChoice::kViridis:
      return ColorMap::kViridis;
    case MapChoice::kTurbo:
      return ColorMap::kTurbo;
    case MapChoice::kTerrain:
      return ColorMap::kTerrain;
    case MapChoice::kGrey:
      return ColorMap::kGrey;
    case MapChoice::kAuto:
    case MapChoice::kClasses:
      break;
  }
  if (attribute == kElevation) return ColorMap::kTerrain;
  return attribute == AttributeValues::find(source, kIntensity) ? ColorMap::kGrey
                                                                : ColorMap::kViridis;
}

/// Takes the values for what the settings make of them: numbers with a map, or categories.
void apply_kind(const Settings& s, AttributeValues& values) {
  if (values.kind() == AttributeKind::kNormal) return;
  const bool number = values.kind() == AttributeKind::kNumber;
  const bool classes = s.color_map == MapChoice::kClasses;
  const bool map = s.color_map != MapChoice::kAuto || s.color_range;
  if (classes && number) values.take_for(AttributeKind::kCategory);
  if (!classes && map) values.take_for(AttributeKind::kNumber);
}

/// A value as people write it: "0.25", "403.1", "5403551".
std::string shown(double value, double size) {
  const double scale = size > 0 ? size : std::abs(value);
  const int decimals =
      scale > 0 ? std::clamp(3 - static_cast<int>(std::ceil(portable::log10(scale))), 0, 9) : 0;
  return std::abs(value) < 1e9 ? fmt::format("{:.{}f}", value, decimals)
                               : fmt::format("{:.6g}", value);
}

std::vector<Legend::Entry> entries_of(const AttributeSummary& summary, AttributeKind kind) {
  std::vector<Legend::Entry> entries;
  for (const auto& [number, surfels] : summary.categories) {
    entries.push_back(
        {category_color(kind, number),
         kind == AttributeKind::kLasClass ? las_class_name(number) : fmt::to_string(number),
         surfels});
  }
  return entries;
}

}  // namespace

std::unique_ptr<SurfelSource> Coloring::wrap(tool::Tool& tool, const Settings& s,
                                             const CloudFacts& facts) {
  const bool black = s.color_by == "auto" && CloudStream::all_black(facts.source);
  const Choice choice = choose(s, up, facts, facts.source.attributes().color && !black);
  const auto own_colors = [&]() -> std::unique_ptr<SurfelSource> {
    if (!black) return nullptr;
    tool.note(
        fmt::format("{}: all colours are black, as some programs write them where there are "
                    "none; drawn grey, and --color-by none draws them black",
                    file));
    return std::make_unique<UncoloredSource>(facts.source);
  };
  if (choice.attribute.empty()) return own_colors();
  AttributeValues values(facts.source, choice.attribute, choice.up, file);
  for (const auto& [lacking, column] : filled) {
    if (column != values.name()) continue;
    if (s.color_by == "auto") return own_colors();
    throw_input(lacking, fmt::format("there is no {}, which other files have; colour by something "
                                     "that all have, or draw them apart",
                                     column));
  }
  colored = true;
  apply_kind(s, values);
  tool::Json& report = tool.report()["color_by"];
  report["attribute"] = values.name();
  const std::string why =
      s.color_by != "auto" ? ""
      : black              ? "; all colours are black, and --color-by none draws them so"
                           : "; the surfels have no colours, and --color-by none leaves them grey";
  const AttributeColors plain;
  if (values.kind() == AttributeKind::kNormal) {
    tool.note(fmt::format("{}: coloured by normal{}", file, why));
    return std::make_unique<ColoredSource>(facts.source, values, plain);
  }
  const AttributeSummary summary = values.summary(facts.first_finest, facts.source.size());
  if (summary.count == 0) {
    throw_input(file, fmt::format("none of the {} surfels has a finite number as {}; colour by "
                                  "something else",
                                  summary.missing, values.name()));
  }
  const auto tell = [&](const std::string& what) {
    tool.note(
        fmt::format("{}: coloured by {}{}{}{}", file, values.name(), what,
                    summary.missing == 0
                        ? ""
                        : fmt::format("; {} surfels without a value are grey", summary.missing),
                    why));
  };
  report["missing"] = summary.missing;
  if (values.kind() != AttributeKind::kNumber) {
    legend.emplace();
    legend->title = values.name();
    legend->entries = entries_of(summary, values.kind());
    report["categories"] = summary.categories.size();
    const std::size_t classes = summary.categories.size();
    tell(classes == 1 ? ", one class" : fmt::format(", {} classes", classes));
    return std::make_unique<ColoredSource>(facts.source, values, plain);
  }
  AttributeColors colors{.map = map_of(s, values.name(), facts.source)};
  std::tie(colors.min, colors.max) =
      s.color_range ? std::pair((*s.color_range)[0], (*s.color_range)[1]) : summary.robust_range();
  legend.emplace();
  legend->title = values.name();
  legend->map = colors.map;
  legend->min = colors.min;
  legend->max = colors.max;
  report["map"] = color_map_name(colors.map);
  report["range"] = {colors.min, colors.max};
  const double size = colors.max - colors.min;
  if (size > 0) {
    tell(fmt::format(", {} to {}{}", shown(colors.min, size), shown(colors.max, size),
                     s.color_range ? "" : " (98 % lie between; --color-range sets it)"));
  } else {
    tell(fmt::format(", {} everywhere", shown(colors.min, size)));
  }
  return std::make_unique<ColoredSource>(facts.source, values, colors);
}

void require_room(const std::vector<View>& views) {
  for (const View& one : views) {
    const Camera& view = one.camera;
    if (std::min(view.width, view.height) >= Legend::kLeastPixels) continue;
    throw_usage(
        fmt::format("--legend on needs pictures of {0}x{0} pixels at least, not {1}x{2}; "
                    "leave it out, or enlarge --size",
                    Legend::kLeastPixels, view.width, view.height));
  }
}

}  // namespace surfel::render_tool
