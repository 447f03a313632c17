#include <algorithm>
#include <array>
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
    const float left = -view.center_x / view.focal_x;
    const float right = (static_cast<float>(view.width) - view.center_x) / view.focal_x;
    const float top = -view.center_y / view.focal_y;
    const float bottom = (static_cast<float>(view.height) - view.center_y) / view.focal_y;
    const float filter = std::max(kWidestFilter, std::sqrt(view.lowpass2));
    margin_ = (kReach * filter + kSparePixels) / std::min(view.focal_x, view.focal_y);
    if (view.orthographic) {
      sides_ = {{{0, left, 0}, {0, right, 0}, {0, top, 1}, {0, bottom, 1}}};
      return;
    }
    sides_ = {{{left, 0, 0}, {right, 0, 0}, {top, 0, 1}, {bottom, 0, 1}}};
    float steepest = std::max({std::abs(view.least_slope_x), std::abs(view.most_slope_x),
                               std::abs(view.least_slope_y), std::abs(view.most_slope_y)});
    for (const Side& side : sides_) steepest = std::max(steepest, std::abs(side.slope));
    stretch_ = std::sqrt(1 + steepest * steepest);
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
  /// Seen from a side x = slope z + offset, a kernel of standard deviation s at depth z reaches
  /// over a distance k (s sqrt(1 + w^2) + h z / f) at most, w being the slope at which its
  /// projection is linearised: the rows of J A are no longer than f / z s sqrt(1 + w^2). Parallel
  /// rays: k (s + h / f).
  bool misses(const Vec3f& center, const ClusterBounds& bounds) const {
    const float furthest = center.z() + bounds.radius;
    if (!(furthest > view_.near)) return true;
    const float reach =
        kReach * bounds.max_deviation * stretch_ + margin_ * (view_.orthographic ? 1 : furthest);
    for (std::size_t k = 0; k < 4; ++k) {
      const auto [slope, offset, axis] = sides_[k];
      const float inwards = k % 2 == 0 ? 1.0F : -1.0F;
      const float inside = inwards * (center[axis] - slope * center.z() - offset) +
                           bounds.radius * std::sqrt(1 + slope * slope);
      const float rounding = 1e-5F * (center.cwiseAbs().sum() + bounds.radius);
      if (inside + reach + rounding < 0) return true;
    }
    return false;
  }

 private:
  struct Side {
    float slope, offset;
    int axis;
  };

  const GaussianView& view_;
  std::array<Side, 4> sides_;
  float stretch_ = 1;
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
    return fine_enough(cluster, nearest, pixels_per_unit, view.orthographic,
                       static_cast<float>(error))
               ? CutStep::kDraw
               : CutStep::kRefine;
  });
}

std::uint64_t gaussian_memory(std::size_t count, const GaussianCloud& cloud,
                              GaussianProfile profile) {
  const bool perspective = profile == GaussianProfile::k2dgs ||
                           profile == GaussianProfile::kExact ||
                           profile == GaussianProfile::kSurfel;
  const std::uint64_t columns = sizeof(float) * (3 + 3 + 4 + 1 + cloud.harmonics_stride());
  const std::uint64_t splats = (perspective ? 100 : 68) + 25;  // See GaussianRenderer.
  return count * (columns + splats);
}

}  // namespace surfel
