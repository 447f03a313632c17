#include <algorithm>
#include <cmath>

#include <surfel/base/elementary.h>
#include <surfel/gaussian/gaussian_cut.h>
#include <surfel/gaussian/gaussian_projection.h>
#include <surfel/lod/cut.h>

namespace surfel {
namespace {

/// Standard deviations at which all kernels have ended: kExact's are the longest,
/// sqrt(2 kExactCut ln 2) = 4.08.
constexpr float kReach = 4.1F;
/// Deviation of the widest pixel filter of trained renderers, 2D Gaussian splatting's, pixels.
constexpr float kWidestFilter = 0.71F;
/// Against rounding, and for bounds that are whole pixels.
constexpr float kSparePixels = 2;

/// What a picture shows of spheres around centres of Gaussians.
class Frustum {
 public:
  explicit Frustum(const GaussianView& view) : view_(view) {
    sides_[0] = {-view.center_x / view.focal_x, 0};
    sides_[1] = {(static_cast<float>(view.width) - view.center_x) / view.focal_x, 0};
    sides_[2] = {-view.center_y / view.focal_y, 1};
    sides_[3] = {(static_cast<float>(view.height) - view.center_y) / view.focal_y, 1};
    float steepest = std::max({std::abs(view.least_slope_x), std::abs(view.most_slope_x),
                               std::abs(view.least_slope_y), std::abs(view.most_slope_y)});
    for (const Side& side : sides_) steepest = std::max(steepest, std::abs(side.slope));
    stretch_ = std::sqrt(1 + steepest * steepest);
    const float filter = std::max(kWidestFilter, std::sqrt(view.lowpass2));
    margin_ = (kReach * filter + kSparePixels) / std::min(view.focal_x, view.focal_y);
  }

  Vec3f in_camera(const Vec3f& p) const {
    Vec3f out;
    for (int row = 0; row < 3; ++row) {
      const float* const r = view_.rotation + 3 * row;
      out[row] = r[0] * p.x() + r[1] * p.y() + r[2] * p.z() + view_.translation[row];
    }
    return out;
  }

  /// Is none of the Gaussians seen whose centres lie in a sphere at `center`, camera space?
  ///
  /// Seen from x = slope z, a kernel of standard deviation s at depth z reaches over a distance
  /// k (s sqrt(1 + w^2) + h z / f) at most, w being the slope at which its projection is
  /// linearised: the rows of J A are no longer than f / z s sqrt(1 + w^2).
  bool misses(const Vec3f& center, const ClusterBounds& bounds) const {
    const float furthest = center.z() + bounds.radius;
    if (!(furthest > view_.near)) return true;
    const float reach = kReach * bounds.max_deviation * stretch_ + margin_ * furthest;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto [slope, axis] = sides_[k];
      const float inwards = k % 2 == 0 ? 1.0F : -1.0F;
      const float inside = inwards * (center[axis] - slope * center.z()) +
                           bounds.radius * std::sqrt(1 + slope * slope);
      const float rounding = 1e-5F * (center.cwiseAbs().sum() + bounds.radius);
      if (inside + reach + rounding < 0) return true;
    }
    return false;
  }

 private:
  struct Side {
    float slope;
    int axis;
  };

  const GaussianView& view_;
  Side sides_[4];
  float stretch_;
  float margin_;
};

}  // namespace

std::vector<std::uint32_t> gaussian_cut(const GaussianCloud& head, const Camera& camera,
                                        const GaussianOptions& options, double error) {
  const GaussianView view = gaussian_view(head, camera, options);
  const Frustum frustum(view);
  const float pixels_per_unit = std::max(view.focal_x, view.focal_y);
  return cut_tree(head.tree, [&](std::uint32_t c) {
    const TreeCluster& cluster = head.tree[c];
    const Vec3f center = frustum.in_camera(cluster.bounds.center);
    if (frustum.misses(center, cluster.bounds)) return CutStep::kSkip;
    const float nearest = center.z() - cluster.bounds.radius;
    return fine_enough(cluster, nearest, pixels_per_unit, false, static_cast<float>(error))
               ? CutStep::kDraw
               : CutStep::kRefine;
  });
}

std::uint64_t gaussian_memory(std::size_t count, const GaussianCloud& cloud,
                              GaussianProfile profile) {
  const bool perspective = profile == GaussianProfile::k2dgs || profile == GaussianProfile::kExact;
  const std::uint64_t columns = sizeof(float) * (3 + 3 + 4 + 1 + cloud.harmonics_stride());
  const std::uint64_t splats = (perspective ? 100 : 68) + 25;  // See GaussianRenderer.
  return count * (columns + splats);
}

}  // namespace surfel
