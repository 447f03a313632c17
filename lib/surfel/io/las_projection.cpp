// ASPRS, LAS specification 1.4 R15, 2.4 (georeferencing); Open Geospatial Consortium, "OGC GeoTIFF
// Standard", version 1.1, 2019; ISO 19162:2019 (well-known text).

#include <array>
#include <charconv>
#include <cstring>
#include <string_view>

#include <surfel/io/las_projection.h>

namespace surfel {
namespace {

constexpr const char* kProjectionUser = "LASF_Projection";
constexpr std::uint16_t kGeoKeys = 34735;
constexpr std::uint16_t kWellKnownText = 2112;

// GeoTIFF's keys, and values of the first.
constexpr std::uint16_t kModelType = 1024;
constexpr std::uint16_t kProjectedModel = 1;
constexpr std::uint16_t kGeographicModel = 2;
constexpr std::uint16_t kRasterType = 1025;
constexpr std::uint16_t kPixelIsArea = 1;
constexpr std::uint16_t kGeographicSystem = 2048;
constexpr std::uint16_t kProjectedSystem = 3072;

std::optional<CoordinateSystem> usable(int epsg, bool geographic) {
  const CoordinateSystem system{.epsg = epsg, .geographic = geographic};
  if (!system.problems().empty()) return std::nullopt;
  return system;
}

/// The system that GeoTIFF's keys name: four numbers, then four for each key.
std::optional<CoordinateSystem> system_of_keys(std::string_view bytes) {
  std::vector<std::uint16_t> numbers(bytes.size() / 2);
  if (numbers.size() < 4) return std::nullopt;
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * 2);
  int model = 0;
  int projected = 0;
  int geographic = 0;
  for (std::size_t k = 4; k + 4 <= numbers.size() && k < 4 + 4 * std::size_t{numbers[3]}; k += 4) {
    if (numbers[k + 1] != 0) continue;  // The value stands in another block, and is no code.
    if (numbers[k] == kModelType) model = numbers[k + 3];
    if (numbers[k] == kProjectedSystem) projected = numbers[k + 3];
    if (numbers[k] == kGeographicSystem) geographic = numbers[k + 3];
  }
  if (projected != 0) return usable(projected, false);
  // A projection without a code has a geographic system below it.
  return model == kGeographicModel ? usable(geographic, true) : std::nullopt;
}

/// Where a node of well-known text ends: behind its closing bracket, or at the text's end.
std::size_t node_end(std::string_view text, std::size_t begin) {
  int depth = 0;
  bool quoted = false;
  for (std::size_t i = begin; i < text.size(); ++i) {
    if (text[i] == '"') quoted = !quoted;
    if (quoted) continue;
    if (text[i] == '[') ++depth;
    if (text[i] == ']' && --depth == 0) return i + 1;
  }
  return text.size();
}

/// The code among the children of a node: AUTHORITY["EPSG","25832"] or ID["EPSG",25832].
std::optional<int> code_of(std::string_view node) {
  int depth = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < node.size(); ++i) {
    const char c = node[i];
    if (c == '"') quoted = !quoted;
    if (quoted) continue;
    if (c == '[') ++depth;
    if (c == ']') --depth;
    if (depth != 1) continue;
    for (const std::string_view start : {"AUTHORITY[\"EPSG\",", "ID[\"EPSG\","}) {
      if (!node.substr(i).starts_with(start)) continue;
      std::string_view digits = node.substr(i + start.size());
      if (digits.starts_with('"')) digits.remove_prefix(1);
      int code = 0;
      const auto [stop, error] =
          std::from_chars(digits.data(), digits.data() + digits.size(), code);
      if (error == std::errc{}) return code;
    }
  }
  return std::nullopt;
}

std::optional<CoordinateSystem> system_of_text(std::string_view text) {
  struct Kind {
    std::string_view name;
    bool geographic;
  };
  // A projection has a geographic system below it, which is not the one that is asked for.
  constexpr std::array<Kind, 5> kKinds{{{"PROJCS[", false},
                                        {"PROJCRS[", false},
                                        {"GEOGCS[", true},
                                        {"GEOGCRS[", true},
                                        {"GEODCRS[", true}}};
  for (const Kind& kind : kKinds) {
    const std::size_t begin = text.find(kind.name);
    if (begin == std::string_view::npos) continue;
    const std::optional<int> code = code_of(text.substr(begin, node_end(text, begin) - begin));
    return code ? usable(*code, kind.geographic) : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

std::optional<CoordinateSystem> las_projection(const std::vector<LasRecord>& records) {
  std::optional<CoordinateSystem> found;
  for (const LasRecord& record : records) {
    if (record.user != kProjectionUser || found) continue;
    if (record.id == kGeoKeys) found = system_of_keys(record.bytes);
    if (record.id == kWellKnownText) found = system_of_text(record.bytes);
  }
  return found;
}

std::vector<std::uint16_t> geo_keys(const std::optional<CoordinateSystem>& system) {
  std::vector<std::uint16_t> keys{1, 1, 1, 0};  // Version 1.1.1, and the number of keys.
  const auto add = [&](std::uint16_t key, int value) {
    keys.insert(keys.end(), {key, 0, 1, static_cast<std::uint16_t>(value)});
    ++keys[3];
  };
  if (system) add(kModelType, system->geographic ? kGeographicModel : kProjectedModel);
  add(kRasterType, kPixelIsArea);
  if (system) add(system->geographic ? kGeographicSystem : kProjectedSystem, system->epsg);
  return keys;
}

LasRecord las_projection_record(const CoordinateSystem& system) {
  const std::vector<std::uint16_t> keys = geo_keys(system);
  return {.user = kProjectionUser,
          .id = kGeoKeys,
          .description = "GeoTIFF keys",
          .bytes = {reinterpret_cast<const char*>(keys.data()), keys.size() * sizeof(keys[0])}};
}

}  // namespace surfel
