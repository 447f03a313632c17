#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The surfels of a cloud as functions on the surface, whose weighted sum is the texture function
/// [SS01 (1)]: r_k = a_k G_{V_k}(u - u_k), u in the tangent plane of surfel k. In double, and in
/// the order of a space-filling curve, so that neighbours lie together.
struct SurfelBasis {
  /// Scene units, relative to the cloud's origin. The frame is right-handed and orthonormal; V_k is
  /// diag(variance_u, variance_v) in (tangent, bitangent).
  struct Function {
    Vec3d position;
    Vec3d tangent, bitangent, normal;
    double variance_u, variance_v;
    double area;  ///< The amplitude a_k, unit^2.

    /// r_k at its centre.
    double peak() const {
      return area / (2 * std::numbers::pi * std::sqrt(variance_u * variance_v));
    }
  };
  /// A half-plane that a function is cut by: it is 0 where direction . (u - u_k) > distance.
  struct Cut {
    Vec2d direction;  ///< Along (tangent, bitangent): unit; zero: cuts nothing.
    double distance;  ///< Scene units.
  };
  Array<Function> function;
  Array<std::array<Cut, 2>> cut;  ///< Of every function; empty where none is cut.
  Array<std::uint32_t> surfel;    ///< Index in the cloud of every function's surfel.
  std::size_t unusable = 0;  ///< Surfels left out: no finite position, normal, positive variance.

  std::size_t size() const { return function.size(); }
};

/// Surfels without an area have sqrt |V_k|, as in the renderer (RenderCloud).
/// \param along_curve  the surfels are a part of a cloud, in the order that they have in the basis
///                     of the whole, which is kept: cells and their points are then the whole's.
SURFEL_API SurfelBasis make_basis(const SurfelCloud& cloud, bool along_curve = false);

}  // namespace surfel
