#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/error.h>
#include <surfel/store/render_cloud.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

CloudSource::CloudSource(const SurfelCloud& cloud, const std::string& name) : cloud_(cloud) {
  cloud.check_columns(name);
  if (!cloud.empty() && cloud.variance.empty() && !cloud.anisotropic()) throw_no_variance(name);
}

SurfelAttributes CloudSource::attributes() const {
  return {.anisotropic = cloud_.anisotropic(),
          .alpha = !cloud_.alpha.empty(),
          .material = !cloud_.material.empty(),
          .group = !cloud_.group.empty(),
          .group_radius = !cloud_.group_radius.empty(),
          .source = !cloud_.source.empty()};
}

void CloudSource::fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
                       std::size_t row) const {
  const Array<Vec3f>* color = cloud_.render_color();
  for (std::size_t k = begin, i = row; k < end; ++k, ++i) {
    cloud.x[i] = usable_position(cloud_.position[k].x());
    cloud.y[i] = usable_position(cloud_.position[k].y());
    cloud.z[i] = usable_position(cloud_.position[k].z());
    const Vec3f n = cloud_.normal.empty() ? Vec3f(0, 0, 0) : unit_normal(cloud_.normal[k]);
    cloud.normal_x[i] = n.x();
    cloud.normal_y[i] = n.y();
    cloud.normal_z[i] = n.z();
    float root_of_V = 0;  // sqrt |V|, the amplitude where the file has no area
    if (cloud_.anisotropic()) {
      cloud.deviation_u[i] = std::sqrt(cloud_.variance_u[k]);
      cloud.deviation_v[i] = std::sqrt(cloud_.variance_v[k]);
      root_of_V = cloud.deviation_u[i] * cloud.deviation_v[i];
      const Vec3f t = unit_tangent(cloud_.tangent[k], n);
      cloud.tangent_x[i] = t.x();
      cloud.tangent_y[i] = t.y();
      cloud.tangent_z[i] = t.z();
    } else {
      cloud.deviation_u[i] = std::sqrt(cloud_.variance[k]);
      root_of_V = cloud_.variance[k];
    }
    cloud.area[i] = cloud_.area.empty() ? root_of_V : usable_area(cloud_.area[k]);
    const Vec3f c = color ? (*color)[k] : SurfelCloud::colorless();
    cloud.red[i] = c.x();
    cloud.green[i] = c.y();
    cloud.blue[i] = c.z();
    if (!cloud.alpha.empty()) cloud.alpha[i] = usable_alpha(cloud_.alpha[k]);
    if (!cloud.material.empty()) cloud.material[i] = cloud_.material[k];
    if (!cloud.group.empty()) cloud.group[i] = cloud_.group[k];
    if (!cloud.group_radius.empty()) cloud.group_radius[i] = cloud_.group_radius[k];
  }
}

void CloudSource::fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const {
  std::copy(cloud_.source.data() + begin, cloud_.source.data() + end, to);
}

Vec3f unit_normal(const Vec3f& normal) {
  const float length = normal.norm();
  return std::isfinite(length) && length > 0 ? Vec3f(normal / length) : Vec3f(0, 0, 0);
}

Vec3f unit_tangent(const Vec3f& tangent, const Vec3f& normal) {
  const Vec3f t = unit_normal(tangent - normal * normal.dot(tangent));
  if (!t.isZero()) return t;
  return normal.isZero() ? Vec3f::UnitX() : Vec3f(normal.unitOrthogonal());
}

float usable_position(float x) {
  return std::isfinite(x) ? x : std::numeric_limits<float>::quiet_NaN();
}

float usable_area(float area) {
  return std::isfinite(area) ? std::max(0.0F, area) : std::numeric_limits<float>::quiet_NaN();
}

float usable_alpha(float alpha) {
  return std::isfinite(alpha) ? std::clamp(alpha, 0.0F, 1.0F)
                              : std::numeric_limits<float>::quiet_NaN();
}

void throw_no_variance(const std::string& file) {
  throw_input(file,
              "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
              "surfel-estimate");
}

void throw_no_groups(const std::string& file) {
  throw_input(file, "the surfels have no groups; run surfel-group on them");
}

}  // namespace surfel
