#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// A few thousand points of a surface, enough to judge its shape as a whole.
struct SurfaceSample {
  /// A place of the surface and its normal.
  struct Point {
    Vec3f position;  ///< Relative to the sample's origin.
    Vec3f normal;    ///< Unit; zero = unknown.
    float area;      ///< Surface that the point stands for, or 1 for all points; >= 0.
  };
  Vec3d origin{0, 0, 0};      ///< World position = origin + position.
  std::vector<Point> points;  ///< Their order follows from their values alone.
};

/// Chooses points by a hash of their coordinates, so that the choice depends neither on the order
/// in which they come nor on threads. Points at one place are chosen together.
class SURFEL_API SurfaceSampler {
 public:
  static constexpr std::size_t kPoints = 8192;  ///< Chosen of more points, roughly.

  /// \param total  number of points that there are to choose from.
  explicit SurfaceSampler(std::size_t total);

  /// Adds a point if it is finite and is chosen. Normals and areas that are not finite count as
  /// unknown, and as zero.
  void add(const SurfaceSample::Point& point);
  /// Takes what another sampler of the same total has chosen.
  void add(const SurfaceSampler& other);
  SurfaceSample sample(const Vec3d& origin) const;

 private:
  std::uint64_t threshold_;
  std::vector<SurfaceSample::Point> chosen_;
};

/// Samples a surface whose points are computed one by one.
/// \param count   Number of points to choose from.
/// \param total   Number of points that there were before some were left out, `count` at least.
/// \param origin  Origin of the points, world coordinates.
/// \param point   Gives point i, to any thread that asks for it.
SURFEL_API SurfaceSample sample_surface(std::size_t count, std::size_t total, const Vec3d& origin,
                                        FunctionRef<SurfaceSample::Point(std::size_t)> point);
SURFEL_API SurfaceSample sample_surface(const SurfelCloud& cloud);
SURFEL_API SurfaceSample sample_surface(const TriangleMesh& mesh);

}  // namespace surfel
