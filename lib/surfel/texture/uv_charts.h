#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/group_by_key.h>
#include <surfel/base/types.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Part of a texel grid: texel (i, j) of width x height from (first_x, first_y) on has weight
/// [j * width + i].
struct CoverageRaster {
  int first_x = 0;
  int first_y = 0;
  int width = 0;
  int height = 0;
  Array<float> weight;
};

/// The charts of a mesh's texture coordinates: parts of faces of one material that hang together
/// by edges whose ends have the same uv on both sides. Charts that cover the same triangles of the
/// image, as mirrored and repeated parts do, are one. Faces without area in uv are in no chart.
class SURFEL_API UvCharts {
 public:
  using Triangle = std::array<Vec2f, 3>;  ///< uv of the corners.

  /// Throws Error(kInput) where the mesh has no uv. The mesh must outlive the charts.
  explicit UvCharts(const TriangleMesh& mesh);

  std::size_t count() const { return faces_.begin.size() - 1; }

  /// The chart of the point of the surface at `uv` that is nearest to `position` (world
  /// coordinates): where charts lie on one another, the position tells them apart.
  /// \param uv         Texture coordinates of the point.
  /// \param position   A place near the point, world coordinates.
  /// \param material   Material of the surfel; nullopt: any.
  /// \param tolerance  How far, along u and v, `uv` may lie outside of a face.
  /// \return Nullopt if no face is there.
  std::optional<std::uint32_t> find(const Vec2f& uv, const Vec3d& position,
                                    std::optional<std::uint16_t> material,
                                    const Vec2f& tolerance) const;

  /// uv of the chart's faces.
  std::vector<Triangle> triangles(std::uint32_t chart) const;

 private:
  struct Tree;

  void find_charts();
  void merge_equal_charts();
  /// Sets faces_ by chart_of_face_.
  void group_faces(std::size_t charts);

  const TriangleMesh* mesh_;
  Array<std::uint32_t> chart_of_face_;
  Grouped<std::uint32_t> faces_;      ///< Faces by chart.
  std::shared_ptr<const Tree> tree_;  ///< Over the charts' faces in uv.
};

/// Texel box of uv triangles on an image of width x height texels, without weights; nullopt where
/// it would have more than `max_texels`.
SURFEL_API std::optional<CoverageRaster> coverage_box(
    const std::vector<UvCharts::Triangle>& triangles, int width, int height, double max_texels);

/// Fills in the weights: 1 where a texel's centre is in a triangle, kPartialCoverage where a
/// triangle touches the texel elsewhere, else 0. A texel stands for the colour at its centre, so
/// one whose centre is outside counts only where the chart is too thin to hold any centre.
inline constexpr float kPartialCoverage = 1e-4F;
SURFEL_API void rasterize_coverage(const std::vector<UvCharts::Triangle>& triangles, int width,
                                   int height, CoverageRaster& raster);

}  // namespace surfel
