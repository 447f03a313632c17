#pragma once

#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

struct SurfelCloud;

/// A coordinate reference system of the register of EPSG.
struct CoordinateSystem {
  int epsg = 0;             ///< Its code, 1024..32766.
  bool geographic = false;  ///< Coordinates are degrees of longitude and latitude.

  bool operator==(const CoordinateSystem&) const = default;
  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// The system that a code alone stands for: geographic are the codes 4000 to 4999.
SURFEL_API CoordinateSystem coordinate_system_of_code(int epsg);

/// The line among a file's comments that names a system, `surfel_crs EPSG:25832`.
SURFEL_API std::string coordinate_system_comment(const CoordinateSystem& system);

/// The system that comments name; unset where they name none, or several.
SURFEL_API std::optional<CoordinateSystem> coordinate_system(
    const std::vector<std::string>& comments);

/// Gives a cloud another system, or none: its comment, and no other blocks of LAS about systems.
SURFEL_API void set_coordinate_system(SurfelCloud& cloud,
                                      const std::optional<CoordinateSystem>& system);

}  // namespace surfel
