#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// A surface over the unit square of (u, v), known exactly.
class SURFEL_API ParametricSurface {
 public:
  /// A place of the surface and its derivatives there.
  struct Point {
    Vec3d position;
    Vec3d normal;  ///< Unit, outward; defined where the derivatives vanish, too.
    Vec3d dpdu;
    Vec3d dpdv;
    /// Surface per unit of the parameter square.
    double area_element() const { return dpdu.cross(dpdv).norm(); }
  };

  virtual ~ParametricSurface() = default;
  /// Exact for any (u, v) in [0, 1]^2. Callable from any thread.
  virtual Point at(double u, double v) const = 0;
  virtual bool closed_u() const { return false; }   ///< Places at u = 1 are the places at u = 0.
  virtual bool closed_v() const { return false; }   ///< Places at v = 1 are the places at v = 0.
  virtual bool has_poles() const { return false; }  ///< v = 0 and v = 1 are a point each.
};

/// One surface of a procedural scene.
struct SurfacePart {
  std::unique_ptr<const ParametricSurface> shape;
  std::function<Vec3f(double u, double v, const ParametricSurface::Point&)> color;  ///< Linear.
  float alpha = 1;
};

/// Surfaces of a scene that has a name, all about as large as the unit ball.
/// plane: the square [-1, 1]^2 in z = 0, facing +z, checkered.
/// sphere: the unit sphere, poles at +-y. torus: radii 0.7 and 0.3 about the z axis.
/// head: a sphere displaced to a head that looks along +z, with fine relief.
/// terrain: fractal heights y over [-1, 1]^2 in x and z, with a high-frequency colour texture.
/// transparent: nested and intersecting surfaces of alpha 0.2 to 0.6.
struct ProceduralScene {
  std::vector<SurfacePart> parts;
  bool transparent = false;  ///< Some part has an alpha below 1.
};

/// Names of the scenes that procedural_scene() knows.
SURFEL_API const std::vector<std::string>& procedural_scene_names();

/// The scene called `kind`; `seed` chooses the relief of head and terrain. With a non-empty
/// `texture` all parts have this procedural_texture(), of this `frequency`. Throws Error(kUsage),
/// naming the known scenes or textures, if a name is unknown.
SURFEL_API ProceduralScene procedural_scene(const std::string& kind, std::uint64_t seed,
                                            const std::string& texture = {}, double frequency = 16);

}  // namespace surfel
