#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include <surfel/base/error.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/store/render_cloud.h>
#include <surfel/store/surfel_source.h>

namespace surfel {
namespace {

Vec3f unit_normal(const Vec3f& normal) {
  const float length = normal.norm();
  return std::isfinite(length) && length > 0 ? Vec3f(normal / length) : Vec3f(0, 0, 0);
}

/// A unit vector perpendicular to the unit normal, on which splat set-up relies: along the tangent,
/// or in an arbitrary direction if the tangent has no part perpendicular to the normal.
Vec3f unit_tangent(const Vec3f& tangent, const Vec3f& normal) {
  const Vec3f t = unit_normal(tangent - normal * normal.dot(tangent));
  if (!t.isZero()) return t;
  return normal.isZero() ? Vec3f::UnitX() : Vec3f(normal.unitOrthogonal());
}

/// Makes vectors unit, or zero where they have no direction. There is no branch, so that compilers
/// use vectors.
void make_unit_normals(float* __restrict x, float* __restrict y, float* __restrict z,
                       std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const float length = std::sqrt(x[i] * x[i] + (y[i] * y[i] + z[i] * z[i]));
    const int known = static_cast<int>(length > 0) &
                      static_cast<int>(length <= std::numeric_limits<float>::max());
    const std::uint32_t mask = 0 - static_cast<std::uint32_t>(known);  // All bits, or none.
    const auto unit = [&](float v) {
      return std::bit_cast<float>(std::bit_cast<std::uint32_t>(v / length) & mask);
    };
    x[i] = unit(x[i]);
    y[i] = unit(y[i]);
    z[i] = unit(z[i]);
  }
}

/// Shortens shading normals to 1 at most. Where there is none the normal takes its place.
void bound_shading_normals(float* const (&normal)[3], float* const (&shading)[3],
                           std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    Vec3f mean(shading[0][i], shading[1][i], shading[2][i]);
    const float length = mean.norm();
    if (!std::isfinite(length) || length == 0) {
      mean = Vec3f(normal[0][i], normal[1][i], normal[2][i]);
    } else if (length > 1) {
      mean /= length;
    }
    for (int k = 0; k < 3; ++k) shading[k][i] = mean[k];
  }
}

/// Makes the directions of half-planes unit vectors of the surfels' planes. Half-planes without a
/// direction there, or without a distance, cut nothing, and all their numbers become zero.
void make_unit_clips(float* const (&normal)[3], RenderCloud::ClipColumns& clip, std::size_t row,
                     std::size_t count) {
  for (std::size_t i = row; i < row + count; ++i) {
    Vec3f direction(clip.x[i], clip.y[i], clip.z[i]);
    if (direction.isZero(0)) {
      clip.distance[i] = 0;
      continue;
    }
    const Vec3f n(normal[0][i - row], normal[1][i - row], normal[2][i - row]);
    const bool usable = !n.isZero(0) && std::isfinite(clip.distance[i]);
    direction = usable ? unit_normal(direction - n * n.dot(direction)) : Vec3f(0, 0, 0);
    clip.x[i] = direction.x();
    clip.y[i] = direction.y();
    clip.z[i] = direction.z();
    if (direction.isZero(0)) clip.distance[i] = 0;
  }
}

/// Copies surfels [begin, end) of a column.
template <class T>
void copy(const Array<T>& column, std::size_t begin, std::size_t end, T* to) {
  std::copy(column.data() + begin, column.data() + end, to);
}

void copy(const Array<Vec3f>& column, std::size_t begin, std::size_t end,
          const std::array<float*, 3>& to) {
  for (std::size_t i = begin; i < end; ++i) {
    for (int k = 0; k < 3; ++k) to[static_cast<std::size_t>(k)][i - begin] = column[i][k];
  }
}

}  // namespace

void SurfelSource::make_drawable(const SurfelAttributes& known, RenderCloud& cloud, std::size_t row,
                                 std::size_t count) {
  // A value minus itself is zero, or NaN where the value is not finite.
  for (Array<float>* column : {&cloud.x, &cloud.y, &cloud.z}) {
    float* p = column->data() + row;
    for (std::size_t i = 0; i < count; ++i) p[i] += p[i] - p[i];
  }
  float* const n[] = {cloud.normal_x.data() + row, cloud.normal_y.data() + row,
                      cloud.normal_z.data() + row};
  if (known.normal) {
    make_unit_normals(n[0], n[1], n[2], count);
  } else {
    for (float* column : n) std::fill_n(column, count, 0.0F);
  }
  if (known.shading_normal) {
    float* const shading[] = {cloud.shading_x.data() + row, cloud.shading_y.data() + row,
                              cloud.shading_z.data() + row};
    bound_shading_normals(n, shading, count);
  }
  // A surfel without an area gets sqrt |V|, the amplitude of SS01, as root_of_determinant() has it
  // but from deviations: a product of roots and a root of a product may differ in the last bit.
  float* u = cloud.deviation_u.data() + row;
  float* area = cloud.area.data() + row;
  if (!known.anisotropic && !known.area) std::copy_n(u, count, area);
  for (std::size_t i = 0; i < count; ++i) u[i] = std::sqrt(u[i]);
  if (known.anisotropic) {
    float* v = cloud.deviation_v.data() + row;
    for (std::size_t i = 0; i < count; ++i) v[i] = std::sqrt(v[i]);
    for (std::size_t i = 0; i < count && !known.area; ++i) area[i] = u[i] * v[i];
    float* const t[] = {cloud.tangent_x.data() + row, cloud.tangent_y.data() + row,
                        cloud.tangent_z.data() + row};
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3f tangent =
          unit_tangent(Vec3f(t[0][i], t[1][i], t[2][i]), Vec3f(n[0][i], n[1][i], n[2][i]));
      for (int k = 0; k < 3; ++k) t[k][i] = tangent[k];
    }
  }
  if (known.clip1) make_unit_clips(n, cloud.clip[0], row, count);
  if (known.clip2) make_unit_clips(n, cloud.clip[1], row, count);
  for (std::size_t i = 0; i < count && known.area; ++i) {
    area[i] = (area[i] > 0 ? area[i] : 0.0F) + (area[i] - area[i]);
  }
  if (!known.color) {
    const Vec3f grey = SurfelCloud::colorless();
    std::fill_n(cloud.red.data() + row, count, grey.x());
    std::fill_n(cloud.green.data() + row, count, grey.y());
    std::fill_n(cloud.blue.data() + row, count, grey.z());
  }
  if (cloud.alpha.empty()) return;
  // Shading divides by opacities: the least of single precision would make infinite colours.
  constexpr float kLeastOpacity = 1e-6F;
  float* alpha = cloud.alpha.data() + row;
  for (std::size_t i = 0; i < count; ++i) {
    const float opacity = alpha[i] < kLeastOpacity ? 0.0F : std::min(alpha[i], 1.0F);
    alpha[i] = opacity + (alpha[i] - alpha[i]);
  }
}

CloudSource::CloudSource(const SurfelCloud& cloud, const std::string& name, Sizes sizes)
    : cloud_(cloud) {
  cloud.check_columns(name);
  if (sizes == Sizes::kNeeded && !cloud.empty() && !has_variance(cloud)) throw_no_variance(name);
}

SurfelAttributes CloudSource::attributes() const {
  return {.anisotropic = cloud_.anisotropic(),
          .normal = !cloud_.normal.empty(),
          .shading_normal = !cloud_.shading_normal.empty(),
          .area = !cloud_.area.empty(),
          .clip1 = !cloud_.clip1.empty(),
          .clip2 = !cloud_.clip2.empty(),
          .color = cloud_.render_color() != nullptr,
          .alpha = !cloud_.alpha.empty(),
          .material = !cloud_.material.empty(),
          .group = !cloud_.group.empty(),
          .group_radius = !cloud_.group_radius.empty(),
          .source = !cloud_.source.empty()};
}

void CloudSource::fill(std::size_t begin, std::size_t end, RenderCloud& to, std::size_t row) const {
  const SurfelAttributes known = attributes();
  for (; begin < end; begin += RenderCloud::kClusterSize, row += RenderCloud::kClusterSize) {
    const std::size_t stop = std::min<std::size_t>(end, begin + RenderCloud::kClusterSize);
    const auto vector = [&](const Array<Vec3f>& from, Array<float>& x, Array<float>& y,
                            Array<float>& z) {
      copy(from, begin, stop, {x.data() + row, y.data() + row, z.data() + row});
    };
    vector(cloud_.position, to.x, to.y, to.z);
    if (known.normal) vector(cloud_.normal, to.normal_x, to.normal_y, to.normal_z);
    if (known.shading_normal) {
      vector(cloud_.shading_normal, to.shading_x, to.shading_y, to.shading_z);
    }
    if (known.anisotropic) {
      vector(cloud_.tangent, to.tangent_x, to.tangent_y, to.tangent_z);
      copy(cloud_.variance_u, begin, stop, to.deviation_u.data() + row);
      copy(cloud_.variance_v, begin, stop, to.deviation_v.data() + row);
    } else if (has_variance(cloud_)) {
      copy(cloud_.variance, begin, stop, to.deviation_u.data() + row);
    } else {
      std::fill_n(to.deviation_u.data() + row, stop - begin, 1.0F);
    }
    if (known.area) copy(cloud_.area, begin, stop, to.area.data() + row);
    const auto clip = [&](const Array<Vec3f>& direction, const Array<float>& distance,
                          RenderCloud::ClipColumns& columns) {
      vector(direction, columns.x, columns.y, columns.z);
      copy(distance, begin, stop, columns.distance.data() + row);
    };
    if (known.clip1) clip(cloud_.clip1, cloud_.clip1_distance, to.clip[0]);
    if (known.clip2) clip(cloud_.clip2, cloud_.clip2_distance, to.clip[1]);
    if (known.color) vector(*cloud_.render_color(), to.red, to.green, to.blue);
    const auto optional = [&](const auto& from, auto& column) {
      if (!column.empty()) copy(from, begin, stop, column.data() + row);
    };
    optional(cloud_.alpha, to.alpha);
    optional(cloud_.material, to.material);
    optional(cloud_.group, to.group);
    optional(cloud_.group_radius, to.group_radius);
    make_drawable(known, to, row, stop - begin);
  }
}

void CloudSource::fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const {
  copy(cloud_.source, begin, end, to);
}

std::vector<std::string> CloudSource::columns() const {
  std::vector<std::string> names;
  if (!cloud_.material.empty()) names.emplace_back(kMaterialColumn);
  if (!cloud_.group.empty()) names.emplace_back(kGroupColumn);
  if (!cloud_.level.empty()) names.emplace_back(kLevelColumn);
  for (const ExtraProperty& property : cloud_.extra) names.push_back(property.name);
  return names;
}

void CloudSource::fill_column(std::size_t column, std::size_t begin, std::size_t end,
                              double* to) const {
  std::size_t place = 0;
  const auto whole = [&](const auto& values) {
    if (values.empty() || place++ != column) return;
    std::copy(values.data() + begin, values.data() + end, to);
  };
  whole(cloud_.material);
  whole(cloud_.group);
  whole(cloud_.level);
  if (column < place) return;
  const ExtraProperty& property = cloud_.extra[column - place];
  load_scalars(property.type, property.data.data() + begin * scalar_size(property.type),
               end - begin, to);
}

void throw_no_variance(const std::string& file) {
  throw_input(file,
              "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
              "surfel-estimate");
}

}  // namespace surfel
