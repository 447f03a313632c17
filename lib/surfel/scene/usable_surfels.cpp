#include <cmath>

#include <surfel/scene/usable_surfels.h>

namespace surfel {
namespace {

/// NaN is neither.
bool bounded(float v) { return std::abs(v) <= kMostMagnitude; }
bool bounded(const Vec3f& v) { return bounded(v.x()) && bounded(v.y()) && bounded(v.z()); }
bool usable_size(float v) { return v > 0 && bounded(v); }

SurfelValues values(const SurfelCloud& cloud, const Array<Vec3f>* color, bool group_radius,
                    std::size_t i) {
  const bool anisotropic = cloud.anisotropic();
  const float deviation = std::sqrt(anisotropic ? cloud.variance_u[i] : cloud.variance[i]);
  SurfelValues v{.position = cloud.position[i],
                 .deviation_u = deviation,
                 .deviation_v = anisotropic ? std::sqrt(cloud.variance_v[i]) : deviation};
  if (group_radius) v.group_radius = cloud.group_radius[i];
  if (color) v.color = (*color)[i];
  if (!cloud.alpha.empty()) v.alpha = cloud.alpha[i];
  if (!cloud.area.empty()) v.area = cloud.area[i];
  return v;
}

}  // namespace

Usability usability(const SurfelValues& s) {
  if (!bounded(s.position)) return Usability::kPosition;
  if (!usable_size(s.deviation_u) || !usable_size(s.deviation_v) || !usable_size(s.group_radius)) {
    return Usability::kVariance;
  }
  const bool color = bounded(s.color) && bounded(s.alpha);
  return color && std::abs(s.area) <= most_area(s.deviation_u, s.deviation_v) ? Usability::kUsable
                                                                              : Usability::kColor;
}

UnusableSurfels remove_unusable(const SurfelCloud& cloud, bool group_radius,
                                Array<std::uint32_t>& order) {
  UnusableSurfels dropped;
  const Array<Vec3f>* color = cloud.render_color();
  std::size_t kept = 0;
  for (const std::uint32_t i : order) {
    const Usability found = usability(values(cloud, color, group_radius, i));
    dropped.add(found);
    if (found == Usability::kUsable) order[kept++] = i;
  }
  order.resize(kept);
  return dropped;
}

}  // namespace surfel
