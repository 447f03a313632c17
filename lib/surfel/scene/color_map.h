#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Colours for numbers in [0, 1], dark to light but for kTurbo.
enum class ColorMap : std::uint8_t {
  /// Perceptually uniform (van der Walt, Smith 2015; CC0): every eighth entry of its published
  /// table and cubic pieces between them; halfway within 0.0022 of the published sRGB values.
  kViridis,
  /// A rainbow with more detail (Mikhailov, "Turbo", Google 2019), made alike, within 0.0016.
  kTurbo,
  kTerrain,  ///< Heights as atlases show them: green, olive, tan, white; this library's own.
  kGrey,     ///< Black to white, linear in the sRGB code.
};

/// "viridis", "turbo", "terrain", "grey".
SURFEL_API const std::string& color_map_name(ColorMap map);

/// Linear colour of a number; numbers outside [0, 1] have the colour of the nearer end. The map is
/// interpolated in sRGB, where it is defined. The number is finite.
SURFEL_API Vec3f map_color(ColorMap map, double t);

/// map_color() by a table: faster, and within 1e-5 of it in linear light, exact at 0, 1/2 and 1.
class SURFEL_API ColorTable {
 public:
  explicit ColorTable(ColorMap map);
  Vec3f operator()(double t) const;

 private:
  std::vector<Vec3f> color_;
};

/// Linear colour of a category: the same for the same number, and unlike the colours of the numbers
/// next to it.
SURFEL_API Vec3f category_color(std::int64_t category);

/// Point classes of ASPRS LAS 1.4 (0 to 18): colours as maps have them, category_color() for other
/// numbers.
SURFEL_API Vec3f las_class_color(std::int64_t number);
/// "2 ground"; the number alone where the standard has no name for it.
SURFEL_API std::string las_class_name(std::int64_t number);

/// Linear colour of what has no value: a neutral grey.
inline Vec3f missing_color() { return {0.2F, 0.2F, 0.2F}; }

}  // namespace surfel
