#include <algorithm>
#include <cctype>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/scene/keep_columns.h>

namespace surfel {
namespace {

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

/// Columns that stay or go together.
struct ColumnGroup {
  std::vector<std::string_view> names;
  bool (*is_there)(const SurfelCloud& cloud);
  void (*drop)(SurfelCloud& cloud);
};

/// The group that is one array of the cloud.
template <auto kColumn>
ColumnGroup group_of(std::vector<std::string_view> names) {
  return {std::move(names), [](const SurfelCloud& cloud) { return !(cloud.*kColumn).empty(); },
          [](SurfelCloud& cloud) { cloud.*kColumn = {}; }};
}

std::vector<ColumnGroup> groups() {
  ColumnGroup size{
      {"size", "radius", "variance", "variance_u", "variance_v", "tx", "ty", "tz", "area"},
      [](const SurfelCloud& cloud) {
        return !cloud.variance.empty() || !cloud.tangent.empty() || !cloud.area.empty();
      },
      [](SurfelCloud& cloud) {
        cloud.variance = {};
        cloud.tangent = {};
        cloud.variance_u = {};
        cloud.variance_v = {};
        cloud.area = {};
      }};
  ColumnGroup clips{{"clip", "clip1_x", "clip1_y", "clip1_z", "clip1_d", "clip2_x", "clip2_y",
                     "clip2_z", "clip2_d"},
                    [](const SurfelCloud& cloud) { return !cloud.clip1.empty(); },
                    [](SurfelCloud& cloud) {
                      cloud.clip1 = {};
                      cloud.clip1_distance = {};
                      cloud.clip2 = {};
                      cloud.clip2_distance = {};
                    }};
  ColumnGroup level{{"level"},
                    [](const SurfelCloud& cloud) { return !cloud.level.empty(); },
                    [](SurfelCloud& cloud) {
                      cloud.level = {};
                      cloud.tree = {};
                    }};
  return {std::move(size),
          std::move(clips),
          std::move(level),
          group_of<&SurfelCloud::normal>({"normal", "nx", "ny", "nz"}),
          group_of<&SurfelCloud::shading_normal>({"shading_nx", "shading_ny", "shading_nz"}),
          group_of<&SurfelCloud::color>({"color", "red", "green", "blue"}),
          group_of<&SurfelCloud::alpha>({"alpha"}),
          group_of<&SurfelCloud::coefficient>({"w_red", "w_green", "w_blue"}),
          group_of<&SurfelCloud::uv>({"u", "v"}),
          group_of<&SurfelCloud::dpdu>({"dpdu_x", "dpdu_y", "dpdu_z"}),
          group_of<&SurfelCloud::dpdv>({"dpdv_x", "dpdv_y", "dpdv_z"}),
          group_of<&SurfelCloud::material>({"material"}),
          group_of<&SurfelCloud::group>({"group"}),
          group_of<&SurfelCloud::group_radius>({"group_radius"}),
          group_of<&SurfelCloud::source>({"source"})};
}

/// All names by which columns of the cloud can be kept.
std::vector<std::string> known_names(const SurfelCloud& cloud) {
  std::vector<std::string> known{"x", "y", "z"};
  for (const ColumnGroup& group : groups()) {
    if (group.is_there(cloud)) known.insert(known.end(), group.names.begin(), group.names.end());
  }
  for (const ExtraProperty& property : cloud.extra) known.push_back(property.name);
  return known;
}

}  // namespace

void keep_columns(SurfelCloud& cloud, const std::vector<std::string>& names,
                  const std::string& name) {
  std::vector<std::string> kept;
  for (const std::string& wanted : names) kept.push_back(lower(wanted));
  const auto is_kept = [&](std::string_view column) {
    return std::find(kept.begin(), kept.end(), lower(std::string(column))) != kept.end();
  };
  const std::vector<std::string> known = known_names(cloud);
  for (const std::string& wanted : kept) {
    const bool found = std::any_of(known.begin(), known.end(), [&](const std::string& column) {
      return lower(column) == wanted;
    });
    if (found) continue;
    throw_input(
        name, fmt::format("has no column '{}' to keep; it has {}", wanted, fmt::join(known, ", ")));
  }
  for (const ColumnGroup& group : groups()) {
    if (std::none_of(group.names.begin(), group.names.end(), is_kept)) group.drop(cloud);
  }
  std::erase_if(cloud.extra,
                [&](const ExtraProperty& property) { return !is_kept(property.name); });
}

}  // namespace surfel
