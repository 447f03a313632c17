#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Rows of a picture: the first, and one past the last.
struct RowRange {
  int begin, end;
};

/// Rows of pixels that renderers draw together, from the first one on: parts of pictures are made
/// of as many, or of a multiple.
inline constexpr int kRowsTogether = 16;

/// Pinhole or orthographic camera without distortion. Camera space: x right, y down, z forward.
/// A point p in camera space is seen at pixel coordinates (focal_x p.x / p.z + center_x,
/// focal_y p.y / p.z + center_y), orthographic without the division; (0, 0) is the corner of the
/// top left pixel, whose centre is (0.5, 0.5).
struct Camera {
  Eigen::Matrix3d camera_from_world = Eigen::Matrix3d::Identity();  ///< Rotation.
  Vec3d eye{0, 0, 0};                                               ///< World coordinates.
  int width = 512;
  int height = 512;
  double focal_x = 512;  ///< Pixels; orthographic: pixels per scene unit.
  double focal_y = 512;
  double center_x = 256;  ///< Principal point, pixels.
  double center_y = 256;
  bool orthographic = false;
  double near = 0;  ///< Nothing nearer along z is drawn; scene units, >= 0.

  static constexpr int kMostSide = 65536;  ///< Pixels: places in a picture fit 32 bits.

  /// The rows of the picture to be drawn, for parts of pictures that are joined later; `end` may be
  /// beyond the last. Drawn rows have the bytes that they have in the whole picture; renderers
  /// return all rows, and do not set the others, which take no memory then.
  RowRange rows{0, kMostSide};
  /// These rows, all within the picture.
  RowRange drawn_rows() const { return {rows.begin, rows.end < height ? rows.end : height}; }

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Row-major 4x4 world-to-camera matrix.
SURFEL_API std::vector<float> world_to_camera_matrix(const Camera& camera);

}  // namespace surfel
