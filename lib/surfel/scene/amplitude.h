#pragma once

#include <cmath>
#include <cstddef>

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// sqrt |V_i|, unit^2: the amplitude of a surfel whose cloud has no areas. The cloud has variances.
/// \tparam Real the type that it is computed in.
template <class Real = float>
Real root_of_determinant(const SurfelCloud& cloud, std::size_t i) {
  return cloud.anisotropic() ? std::sqrt(static_cast<Real>(cloud.variance_u[i]) *
                                         static_cast<Real>(cloud.variance_v[i]))
                             : static_cast<Real>(cloud.variance[i]);
}

/// The amplitude a_i of a surfel's kernel, unit^2: its area, or sqrt |V_i| where the cloud has no
/// areas.
template <class Real = float>
Real amplitude(const SurfelCloud& cloud, std::size_t i) {
  return cloud.area.empty() ? root_of_determinant<Real>(cloud, i)
                            : static_cast<Real>(cloud.area[i]);
}

}  // namespace surfel
