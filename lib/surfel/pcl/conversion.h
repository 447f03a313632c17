#pragma once

// For programs that use PCL as well: header only, so that libsurfel itself needs no PCL.

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <surfel/base/color.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

namespace pcl_detail {

/// The float column of that name among the cloud's other properties, or null.
inline const ExtraProperty* find_extra(const SurfelCloud& cloud, std::string_view name) {
  for (const ExtraProperty& extra : cloud.extra) {
    if (extra.name == name && extra.type == ScalarType::kFloat32) return &extra;
  }
  return nullptr;
}

inline float get_extra(const ExtraProperty& extra, std::size_t i) {
  float value = 0;
  std::memcpy(&value, extra.data.data() + i * sizeof(value), sizeof(value));
  return value;
}

/// Adds a column with the values get(i).
template <class Get>
void add_extra(SurfelCloud& cloud, const char* name, Get get) {
  ExtraProperty& extra = cloud.extra.emplace_back();
  extra.name = name;
  extra.data.resize(cloud.size() * sizeof(float));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float value = get(i);
    std::memcpy(extra.data.data() + i * sizeof(value), &value, sizeof(value));
  }
}

inline std::uint8_t to_byte(float unit) {
  return static_cast<std::uint8_t>(std::lround(std::fmin(std::fmax(unit, 0.0F), 1.0F) * 255.0F));
}

}  // namespace pcl_detail

/// The surfels as a cloud of PCL, of any of its point types with x, y, z: normals, colour (linear
/// light becomes 8-bit sRGB), alpha, radius (sqrt of the larger variance, one standard deviation)
/// and the properties `confidence` and `curvature` are set where the type has them, and left at
/// PCL's defaults where the surfels have no such column. Positions are in world coordinates, which
/// PCL holds in single precision: far from the origin take `keep_origin`, which leaves the cloud's
/// origin out. NaN stays NaN; is_dense says whether all positions are finite. Width is the number
/// of surfels, height 1.
template <class Point>
pcl::PointCloud<Point> toPCL(const SurfelCloud& cloud, bool keep_origin = false) {
  namespace detail = pcl_detail;
  pcl::PointCloud<Point> out;
  out.resize(cloud.size());
  out.is_dense = true;
  const Array<Vec3f>* color = cloud.render_color();
  [[maybe_unused]] const ExtraProperty* confidence = detail::find_extra(cloud, "confidence");
  [[maybe_unused]] const ExtraProperty* curvature = detail::find_extra(cloud, "curvature");
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Point& p = out[i];
    const Vec3f position = keep_origin ? cloud.position[i] : Vec3f(cloud.world(i).cast<float>());
    p.x = position.x();
    p.y = position.y();
    p.z = position.z();
    if (!position.allFinite()) out.is_dense = false;
    if constexpr (requires(Point q) { q.normal_x; }) {
      if (!cloud.normal.empty()) {
        p.normal_x = cloud.normal[i].x();
        p.normal_y = cloud.normal[i].y();
        p.normal_z = cloud.normal[i].z();
      }
    }
    if constexpr (requires(Point q) { q.r; }) {
      if (color) {
        p.r = linear_to_srgb8((*color)[i].x());
        p.g = linear_to_srgb8((*color)[i].y());
        p.b = linear_to_srgb8((*color)[i].z());
      }
    }
    if constexpr (requires(Point q) { q.a; }) {
      if (!cloud.alpha.empty()) p.a = detail::to_byte(cloud.alpha[i]);
    }
    if constexpr (requires(Point q) { q.radius; }) {
      if (cloud.anisotropic()) {
        p.radius = std::sqrt(std::fmax(cloud.variance_u[i], cloud.variance_v[i]));
      } else if (!cloud.variance.empty()) {
        p.radius = std::sqrt(cloud.variance[i]);
      }
    }
    if constexpr (requires(Point q) { q.confidence; }) {
      if (confidence) p.confidence = detail::get_extra(*confidence, i);
    }
    if constexpr (requires(Point q) { q.curvature; }) {
      if (curvature) p.curvature = detail::get_extra(*curvature, i);
    }
  }
  if (cloud.viewpoint) {
    const Vec3d eye = cloud.viewpoint->position - (keep_origin ? cloud.origin : Vec3d(0, 0, 0));
    out.sensor_origin_.template head<3>() = eye.cast<float>();
    const Vec4d& q = cloud.viewpoint->orientation;
    out.sensor_orientation_ = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).cast<float>();
  }
  return out;
}

/// A cloud of PCL as surfels: position, and normal, colour (8-bit sRGB becomes linear light),
/// variance (radius^2, as toPCL() writes it) and the properties `confidence` and `curvature` where
/// the point type has them; alpha only with `with_alpha`, as PCL's readers set it to 255 or 0 where
/// files have none. The viewpoint is the sensor's pose, unless that is the default and the cloud is
/// not organised. Points that are not finite stay.
template <class Point>
SurfelCloud fromPCL(const pcl::PointCloud<Point>& cloud, bool with_alpha = false) {
  namespace detail = pcl_detail;
  SurfelCloud out;
  const std::size_t count = cloud.size();
  out.position.resize(count);
  if constexpr (requires(Point q) { q.normal_x; }) out.normal.resize(count);
  if constexpr (requires(Point q) { q.r; }) out.color.resize(count);
  if constexpr (requires(Point q) { q.radius; }) out.variance.resize(count);
  if constexpr (requires(Point q) { q.a; }) {
    if (with_alpha) out.alpha.resize(count);
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Point& p = cloud[i];
    out.position[i] = Vec3f(p.x, p.y, p.z);
    if constexpr (requires(Point q) { q.normal_x; }) {
      out.normal[i] = Vec3f(p.normal_x, p.normal_y, p.normal_z);
    }
    if constexpr (requires(Point q) { q.r; }) {
      out.color[i] = Vec3f(srgb8_to_linear(p.r), srgb8_to_linear(p.g), srgb8_to_linear(p.b));
    }
    if constexpr (requires(Point q) { q.radius; }) out.variance[i] = p.radius * p.radius;
    if constexpr (requires(Point q) { q.a; }) {
      if (with_alpha) out.alpha[i] = static_cast<float>(p.a) / 255.0F;
    }
  }
  if constexpr (requires(Point q) { q.confidence; }) {
    detail::add_extra(out, "confidence", [&](std::size_t i) { return cloud[i].confidence; });
  }
  if constexpr (requires(Point q) { q.curvature; }) {
    detail::add_extra(out, "curvature", [&](std::size_t i) { return cloud[i].curvature; });
  }
  const Eigen::Quaternionf& q = cloud.sensor_orientation_;
  out.viewpoint = Viewpoint{cloud.sensor_origin_.template head<3>().template cast<double>(),
                            Vec4d(q.w(), q.x(), q.y(), q.z())};
  // PCL's default tells nothing of points that are not in rows.
  if (cloud.height <= 1 && is_default(*out.viewpoint)) out.viewpoint.reset();
  return out;
}

}  // namespace surfel
