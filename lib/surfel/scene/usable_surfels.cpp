#include <cmath>

#include <surfel/scene/usable_surfels.h>

namespace surfel {
namespace {

bool usable_size(float v) { return std::isfinite(v) && v > 0; }

SurfelValues values(const SurfelCloud& cloud, const Array<Vec3f>* color, bool group_radius,
                    std::size_t i) {
  SurfelValues v{.position = cloud.position[i],
                 .size_u = cloud.anisotropic() ? cloud.variance_u[i] : cloud.variance[i]};
  if (cloud.anisotropic()) v.size_v = cloud.variance_v[i];
  if (group_radius) v.group_radius = cloud.group_radius[i];
  if (color) v.color = (*color)[i];
  if (!cloud.alpha.empty()) v.alpha = cloud.alpha[i];
  if (!cloud.area.empty()) v.area = cloud.area[i];
  return v;
}

}  // namespace

Usability usability(const SurfelValues& s) {
  if (!s.position.allFinite()) return Usability::kPosition;
  if (!usable_size(s.size_u) || !usable_size(s.size_v) || !usable_size(s.group_radius)) {
    return Usability::kVariance;
  }
  const bool color = s.color.allFinite() && std::isfinite(s.alpha) && std::isfinite(s.area);
  return color ? Usability::kUsable : Usability::kColor;
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
