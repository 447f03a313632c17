#pragma once

#include <algorithm>
#include <cmath>

#include <surfel/base/random.h>
#include <surfel/texture/render_system.h>

namespace surfel::test {

/// Jittered grid of spacing 1 on the plane z = 0, side x side round functions, with variances as
/// files hold them.
inline SurfelBasis flat_basis(int side, double sigma) {
  const double variance = static_cast<double>(static_cast<float>(sigma * sigma));
  SurfelBasis basis;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const auto k = static_cast<std::uint64_t>(y) * side + x;
      const auto jitter = [&](int axis) { return 0.6 * (random_uniform(11, k, axis) - 0.5); };
      basis.function.push_back({{x + jitter(0), y + jitter(1), 0},
                                {1, 0, 0},
                                {0, 1, 0},
                                {0, 0, 1},
                                variance,
                                variance,
                                1});
      basis.surfel.push_back(static_cast<std::uint32_t>(k));
    }
  }
  return basis;
}

inline Vec2d place_of(const SurfelBasis& basis, const Quadrature& points, std::size_t i,
                      std::size_t q) {
  return basis.function[i].position.head<2>() + points.offset[q].cast<double>();
}

/// Waves of 10 and 13 spacings; three channels.
inline Array<Channels> smooth_colors(const SurfelBasis& basis, const Quadrature& points) {
  Array<Channels> f(points.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    for (std::size_t q = points.begin[i]; q < points.begin[i + 1]; ++q) {
      const Vec2d p = place_of(basis, points, i, q);
      f[q] = Channels(0.5 + 0.4 * std::sin(0.63 * p.x()), 0.5 + 0.3 * std::cos(0.48 * p.y()),
                      0.5 + 0.2 * std::sin(0.4 * (p.x() + p.y())), 0);
    }
  }
  return f;
}

inline double largest_difference(const Array<Channels>& a, const Array<Channels>& b) {
  double most = 0;
  for (std::size_t k = 0; k < a.size(); ++k) most = std::max(most, (a[k] - b[k]).abs().maxCoeff());
  return most;
}

}  // namespace surfel::test
