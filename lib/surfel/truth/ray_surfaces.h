#pragma once

// The common parts of the two ray casters (reference.h, source_ewa.h): surfels in double, and the
// surfaces that a ray meets.

#include <array>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/shading.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/scene.h>
#include <surfel/store/render_cloud.h>
#include <surfel/truth/supersample.h>

namespace surfel {

/// A surfel as a camera sees it: a Gaussian r(u) = area G_V(u) in the plane through `center`, V =
/// diag(deviation_u^2, deviation_v^2) in (tangent, bitangent).
struct Disc {
  Vec3d center;                      ///< World axes, relative to the camera's eye.
  Vec3d normal, tangent, bitangent;  ///< Right-handed, orthonormal.
  double deviation_u, deviation_v;   ///< Scene units.
  double area;                       ///< Scene units^2.
  std::uint32_t surfel;
  /// A half-plane that cuts the disc; the direction is zero where there is none.
  struct Line {
    Vec3d direction;  ///< World axes, unit.
    double distance;  ///< From the centre.
  };
  std::array<Line, 2> lines;

  /// A surfel without a normal is perpendicular to the line from the eye to its centre.
  Disc(const RenderCloud& cloud, std::uint32_t surfel, const Camera& camera);

  double max_deviation() const { return deviation_u > deviation_v ? deviation_u : deviation_v; }
  /// Whether a point of the plane, relative to the centre, lies beyond a line that cuts the disc.
  bool is_cut(const Vec3d& offset) const {
    return lines[0].direction.dot(offset) > lines[0].distance ||
           lines[1].direction.dot(offset) > lines[1].distance;
  }
  /// Where the ray meets the plane: its t; not finite where it is parallel to the plane.
  double meet(const ViewRay& ray) const {
    return normal.dot(center - ray.origin) / normal.dot(ray.direction);
  }
};

/// A surfel's contribution to a ray.
struct RayHit {
  double z;        ///< Depth along the view.
  double weight;   ///< rho, > 0.
  double epsilon;  ///< The hit joins surfaces that are nearer to it than this along z.
  std::uint32_t surfel;
  bool front;  ///< The surfel's front faces the eye.
};

/// The surfaces that one ray meets. Kept from ray to ray, so that nothing is allocated for each.
class RaySurfaces {
 public:
  /// Keeps references to the cloud, the scene and the shader. `full_weight` is tau.
  RaySurfaces(const RenderCloud& cloud, const Scene& scene, const Shader& shader,
              double full_weight)
      : cloud_(cloud), scene_(scene), shader_(shader), full_weight_(full_weight) {}

  /// Takes the hits of a ray in any order, leaves them sorted. Separates them front to back into
  /// surfaces: a hit joins the nearest surface of the same side whose mean depth is within its
  /// epsilon, or else opens one. Each surface is normalised by its sum of rho (9), shaded at the
  /// picture coordinates (x, y) and weighed by its coverage (SS01 section 7); they are composited
  /// front to back (12), however many there are, over the environment.
  /// \return premultiplied.
  Rgba color(std::vector<RayHit>& hits, double x, double y);

 private:
  /// Sums over the hits, each times its weight.
  struct Surface {
    double weight = 0;
    double z = 0;
    Vec3d color{0, 0, 0};  ///< Times alpha.
    double alpha = 0;
    Vec3d normal{0, 0, 0};
    std::uint32_t material = 0;  ///< Material of the first hit.
    bool front = false;

    double mean_z() const { return z / weight; }
  };
  /// Fills surfaces_, nearest first.
  void separate(const std::vector<RayHit>& hits);

  const RenderCloud& cloud_;
  const Scene& scene_;
  const Shader& shader_;
  double full_weight_;
  std::vector<Surface> surfaces_;
};

}  // namespace surfel
