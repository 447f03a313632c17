#include <cmath>

#include <surfel/scene/usable_surfels.h>

namespace surfel {
namespace {

enum class Verdict : std::uint8_t { kUsable, kPosition, kVariance, kColor };

bool usable_variance(float v) { return std::isfinite(v) && v > 0; }

Verdict judge(const SurfelCloud& cloud, const Array<Vec3f>* color, bool group_radius,
              std::size_t i) {
  if (!cloud.position[i].allFinite()) return Verdict::kPosition;
  const bool variance_ok = cloud.anisotropic() ? usable_variance(cloud.variance_u[i]) &&
                                                     usable_variance(cloud.variance_v[i])
                                               : usable_variance(cloud.variance[i]);
  if (!variance_ok || (group_radius && !usable_variance(cloud.group_radius[i]))) {
    return Verdict::kVariance;
  }
  if (color && !(*color)[i].allFinite()) return Verdict::kColor;
  if (!cloud.alpha.empty() && !std::isfinite(cloud.alpha[i])) return Verdict::kColor;
  if (!cloud.area.empty() && !std::isfinite(cloud.area[i])) return Verdict::kColor;
  return Verdict::kUsable;
}

}  // namespace

UnusableSurfels remove_unusable(const SurfelCloud& cloud, bool group_radius,
                                Array<std::uint32_t>& order) {
  UnusableSurfels dropped;
  const Array<Vec3f>* color = cloud.render_color();
  std::size_t kept = 0;
  for (const std::uint32_t i : order) {
    switch (judge(cloud, color, group_radius, i)) {
      case Verdict::kUsable:
        order[kept++] = i;
        break;
      case Verdict::kPosition:
        ++dropped.position;
        break;
      case Verdict::kVariance:
        ++dropped.variance;
        break;
      case Verdict::kColor:
        ++dropped.color;
        break;
    }
  }
  order.resize(kept);
  return dropped;
}

}  // namespace surfel
