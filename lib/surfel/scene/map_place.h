#pragma once

#include <optional>
#include <string>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/coordinate_system.h>

namespace surfel {

/// Where the pixels of a map lie: x goes with the columns, y against the rows.
struct MapPlace {
  double pixel = 1;                             ///< Side of a pixel, scene units.
  double left = 0;                              ///< x of the left border.
  double top = 0;                               ///< y of the upper border.
  std::optional<CoordinateSystem> system = {};  ///< What coordinates mean, where it is known.
};

/// The orthographic camera that sees the box from above, north (y) up, by pixels of this side,
/// whose borders lie at multiples of it, so that maps of neighbours fit together. Throws
/// Error(kUsage) where the picture would have more than Camera::kMostSide pixels either way.
SURFEL_API Camera map_camera(const Bounds& box, double pixel);

/// Where the pixels of such a camera's picture lie.
SURFEL_API MapPlace map_place(const Camera& camera);

/// The text of a world file (ESRI): the pixel's size, and the middle of the first pixel.
SURFEL_API std::string world_file(const MapPlace& place);

/// Name of a picture's world file: out.pgw for out.png, out.tfw for out.tif, out.jgw for out.jpg,
/// out.exrw for others.
SURFEL_API std::string world_file_name(const std::string& picture);

}  // namespace surfel
