#include <algorithm>
#include <cmath>
#include <cstdint>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/estimate/window_moments.h>

namespace surfel {
namespace {

/// A number between -1 and 1.
double number(std::uint64_t stream, std::uint64_t k) { return 2 * random_uniform(stream, k) - 1; }

Vec3d vector(std::uint64_t stream, std::uint64_t k) {
  return {number(stream, 3 * k), number(stream, 3 * k + 1), number(stream, 3 * k + 2)};
}

struct Scene {
  SharedWindow window;
  WindowPoints points;
};

Scene scene() {
  Scene out;
  for (std::uint64_t k = 0; k < 200; ++k) out.window.add(vector(1, k));
  for (std::size_t i = 0; i < WindowPoints::kSize; ++i) {
    const Vec3d p = vector(2, i) / 4;
    out.points.x[i] = p.x();
    out.points.y[i] = p.y();
    out.points.z[i] = p.z();
    out.points.reach2[i] = 0.3 + 0.04 * static_cast<double>(i);
    out.points.slack[i] = 0.05 * static_cast<double>(i);
    out.points.set_plane(i, vector(3, i), 0.1 * number(4, i));
    out.points.inverse_scale[i] = i % 4 == 0 ? 0 : 2;
  }
  return out;
}

/// The sums of point i, one neighbour after another; `in_image` as the two functions differ.
Moments sums(const Scene& s, std::size_t i, bool in_image) {
  const WindowPoints& p = s.points;
  const Vec3d at(p.x[i], p.y[i], p.z[i]);
  const Vec3d normal(p.normal_x[i], p.normal_y[i], p.normal_z[i]);
  Moments out;
  for (std::size_t k = 0; k < s.window.size(); ++k) {
    const Vec3d n(s.window.x[k], s.window.y[k], s.window.z[k]);
    if (!in_image && (n - at).squaredNorm() > p.reach2[i]) continue;
    const double free = in_image ? p.slack[i] * (n - at).head<2>().norm() : 0;
    const double off = std::max(0.0, std::abs(normal.dot(n) - p.offset[i]) - free);
    const double e = off * p.inverse_scale[i];
    out.add(n, std::pow(std::max(0.0, 1 - e * e), 2));
  }
  return out;
}

TEST(WindowMoments, AreSumsOverTheNeighborsOfEachPoint) {
  const Scene s = scene();
  for (const bool in_image : {false, true}) {
    WindowMoments all{};
    (in_image ? sum_in_image : sum_in_space)(WindowPoints::kSize, s.window, s.points, all);
    for (std::size_t i = 0; i < WindowPoints::kSize; ++i) {
      const Moments expected = sums(s, i, in_image);
      const Moments found = all.of(i);
      EXPECT_GT(expected.n, 5);
      EXPECT_NEAR(found.n, expected.n, 1e-9);
      EXPECT_NEAR((found.mean() - expected.mean()).norm(), 0, 1e-9);
      for (int axis = 0; axis < 3; ++axis) {
        const Vec3d direction = (Vec3d::Unit(axis) + Vec3d::Unit((axis + 1) % 3)).normalized();
        EXPECT_NEAR(found.variance_along(direction), expected.variance_along(direction), 1e-9);
      }
      EXPECT_NEAR(found.variance(), expected.variance(), 1e-9);
    }
  }
}

}  // namespace
}  // namespace surfel
