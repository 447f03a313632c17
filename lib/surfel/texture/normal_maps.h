#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// What an image tells about the surface's relief.
enum class ReliefKind : std::uint8_t {
  kNone,
  kNormals,  ///< Normals in tangent space: x along u, y along v, z along the surface's normal.
  kHeights,  ///< Heights above the surface (Blinn, "Simulation of wrinkled surfaces", 1978).
};

/// Maps that bend the surface's normals, and how they are read.
struct SURFEL_API NormalMapOptions {
  /// Image of normals in tangent space for all surfels, 0 and 1 standing for -1 and 1; empty: by
  /// the mesh's materials.
  std::string normal_map{};
  /// Image of heights for all surfels, or the name of a procedural texture as load_texture_image()
  /// takes it; the mean of R, G and B where it is not grey. Not together with `normal_map`.
  std::string bump{};
  /// Height of white above black, scene units; negative ones are dents. Unset: the materials' own,
  /// 1 with `bump`.
  std::optional<double> bump_scale{};
  /// Green of normal maps points to the image's bottom, as Direct3D has it, not to its top.
  bool y_down = false;
  std::optional<WrapMode> wrap{};  ///< As TextureSourceOptions::wrap.
  bool charts = true;              ///< Keep kernels within the mesh's charts.

  bool empty() const { return normal_map.empty() && bump.empty(); }
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// The reliefs of surfels, ready to be averaged: linear in what is averaged. Both sets have a map
/// for each image, at the same place, and share `map_of_material`.
struct SURFEL_API NormalMaps {
  std::vector<ReliefKind> kind;  ///< By map.
  /// Of normals: unit x, y, z. Of heights: h_x, h_y, h_x^2, with h_x the height's derivative along
  /// the image's rows, from left to right, and h_y along its columns, downwards; scene units by
  /// texels. Of nothing: 0, 0, 1.
  TextureSet first;
  TextureSet second;  ///< Of heights: h_y^2, h_x h_y, 0.

  /// There is no relief at all.
  bool empty() const;
};

/// The maps that the options name, or those of the mesh's materials: MTL's norm, else its bump.
/// Images are in memory as a whole, 16 bytes a texel (heights 32), and a third more for a pyramid.
/// \param options    The image for all materials, or none, and how it is read.
/// \param mesh       May be null where the options name an image. It must outlive the result.
/// \param mesh_name  Starts messages about the mesh.
///
/// Throws Error: kUsage for options that are not usable, kInput where the mesh has no texture
/// coordinates or an image not the channels that it needs, kIo and kInput for the images.
SURFEL_API NormalMaps load_normal_maps(const NormalMapOptions& options, const TriangleMesh* mesh,
                                       const std::string& mesh_name);

/// Means of the height's derivatives under a kernel, as NormalMaps has them.
struct HeightSlopes {
  Vec2d mean{0, 0};                  ///< h_x, h_y.
  Mat2d covariance = Mat2d::Zero();  ///< Positive semi-definite but for rounding.
};

/// The surface that a relief lies on.
struct ReliefBase {
  Vec3d normal;      ///< Unit.
  Vec3d dpdu, dpdv;  ///< Derivatives by the image's sides, v upwards.
};

/// A normal of tangent space in the scene, as long as it was. The axes are perpendicular to one
/// another: x is the part of dpdu across the normal, y lies on the side of dpdv, which may be
/// mirrored. Nullopt where the derivatives span no area.
SURFEL_API std::optional<Vec3d> normal_in_scene(const ReliefBase& base, const Vec3d& normal);

/// The mean of the unit normals of a surface raised by heights, whose gradient in the scene is
/// T^-T (h_x, h_y), T being the surface's derivative by texels, and varies as a Gaussian of the
/// slopes' mean and covariance. The moments carry the variance through all levels of a pyramid, as
/// Olano and Baker have them ("LEAN mapping", 2010). By Gauss and Hermite's rule of 5 x 5 points.
/// \param base           The surface's normal and its derivatives by texture coordinates.
/// \param slopes         Mean and covariance of the slopes of the heights.
/// \param width, height  Of the image, texels.
/// \return Nullopt where the derivatives span no area.
SURFEL_API std::optional<Vec3d> raised_normal(const ReliefBase& base, const HeightSlopes& slopes,
                                              int width, int height);

}  // namespace surfel
