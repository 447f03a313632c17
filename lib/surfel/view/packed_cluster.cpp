// Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2),
// 2014: octahedral codes.
// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017: the tangent frame.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/view/packed_cluster.h>

namespace surfel {
namespace {

constexpr float kMost = 65535;
/// The code that stands for no direction is kept free.
constexpr float kMostDirection = 65534;
/// The code of a half-plane's distance that stands for none, and the one of distance 0.
constexpr std::uint16_t kNoHalfPlane = 0xffff;
constexpr float kMiddleDistance = 32767;

static_assert(std::endian::native == std::endian::little);

template <class Value>
void append(const Value& value, std::string& to) {
  to.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

/// Numbers of a range in 16 bits.
struct Range16 {
  float low, step;

  Range16(float least, float most) : low(least), step((most - least) / kMost) {}
  std::uint16_t code(float value) const {
    if (!(step > 0)) return 0;
    return static_cast<std::uint16_t>(std::clamp(std::round((value - low) / step), 0.0F, kMost));
  }
};

std::uint8_t code8(float share) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(share, 0.0F, 1.0F) * 255));
}

float log2_of(float value) { return static_cast<float>(portable::log2(std::max(value, 1e-37F))); }

/// The rows of a cluster in the order in which they are stored: places with reversed bits, so that
/// neighbours along the curve come far from one another.
std::vector<std::uint32_t> spread_rows(const Cluster& cluster) {
  static_assert(kClusterSurfels == 256);
  const std::uint32_t count = cluster.end - cluster.begin;
  std::vector<std::uint32_t> rows;
  rows.reserve(count);
  for (std::uint32_t i = 0; i < kClusterSurfels; ++i) {
    std::uint32_t reversed = 0;
    for (int bit = 0; bit < 8; ++bit) reversed |= (i >> bit & 1) << (7 - bit);
    if (reversed < count) rows.push_back(cluster.begin + reversed);
  }
  return rows;
}

/// Packs one cluster, column by column.
class Packer {
 public:
  Packer(const RenderCloud& cloud, std::uint32_t cluster, const RenderCloud* attribute)
      : cloud_(cloud), attribute_(attribute), rows_(spread_rows(cloud.clusters()[cluster])) {
    header_.count = static_cast<std::uint16_t>(rows_.size());
    header_.cluster = cluster;
  }

  void append_to(std::string& to) {
    const std::size_t at = to.size();
    append(header_, to);
    add_positions(to);
    add_normals(to);
    add_deviations(to);
    add_area(to);
    add_colors(to);
    add_alpha(to);
    if (cloud_.has_shading()) add_directions(kPackedShading, true, to);
    add_attribute(to);
    add_half_planes(kPackedClip1, cloud_.clip[0], to);
    add_half_planes(kPackedClip2, cloud_.clip[1], to);
    std::copy_n(reinterpret_cast<const char*>(&header_), sizeof(header_), to.data() + at);
  }

 private:
  /// Least and greatest value over the rows.
  template <class Value>
  std::pair<float, float> range_of(const Value& value) const {
    float least = std::numeric_limits<float>::infinity();
    float most = -least;
    for (const std::uint32_t row : rows_) {
      least = std::min(least, value(row));
      most = std::max(most, value(row));
    }
    return {least, most};
  }

  void add_positions(std::string& to) {
    header_.columns |= kPackedPosition;
    const Array<float>* const axes[] = {&cloud_.x, &cloud_.y, &cloud_.z};
    for (int axis = 0; axis < 3; ++axis) {
      const auto at = [&](std::uint32_t row) { return (*axes[axis])[row]; };
      const auto [least, most] = range_of(at);
      const Range16 range(least, most);
      header_.min[axis] = range.low;
      header_.step[axis] = range.step;
      for (const std::uint32_t row : rows_) append(range.code(at(row)), to);
    }
  }

  Vec3f normal(std::uint32_t row) const {
    return {cloud_.normal_x[row], cloud_.normal_y[row], cloud_.normal_z[row]};
  }

  void add_normals(std::string& to) {
    const bool known = std::any_of(rows_.begin(), rows_.end(),
                                   [&](std::uint32_t row) { return !normal(row).isZero(0); });
    if (known) add_directions(kPackedNormal, false, to);
  }

  void add_directions(PackedColumn column, bool shading, std::string& to) {
    header_.columns |= column;
    for (const std::uint32_t row : rows_) {
      append(pack_direction(shading ? cloud_.shading(row) : normal(row)), to);
    }
  }

  void add_deviations(std::string& to) {
    const bool across = cloud_.anisotropic();
    const auto u = [&](std::uint32_t row) { return log2_of(cloud_.deviation_u[row]); };
    const auto v = [&](std::uint32_t row) { return log2_of(cloud_.deviation_v[row]); };
    auto [least, most] = range_of(u);
    if (across) {
      const auto [least_v, most_v] = range_of(v);
      least = std::min(least, least_v);
      most = std::max(most, most_v);
    }
    const Range16 range(least, most);
    header_.deviation_log = range.low;
    header_.deviation_step = range.step;
    if (range.step > 0) {
      header_.columns |= kPackedDeviation;
      for (const std::uint32_t row : rows_) append(range.code(u(row)), to);
    }
    if (!across || !(range.step > 0)) return;
    header_.columns |= kPackedAcross;
    for (const std::uint32_t row : rows_) append(range.code(v(row)), to);
    for (const std::uint32_t row : rows_) append(tangent_angle(row), to);
  }

  /// The angle of a direction about the normal that is read back; `whole` radians are 65536.
  std::uint16_t angle_about_normal(std::uint32_t row, const Vec3f& direction, double whole) const {
    const Vec3f n = unpack_direction(pack_direction(normal(row)));
    const Vec3f a = packed_tangent(n);
    const double angle = portable::atan2(direction.dot(n.cross(a)), direction.dot(a));
    const double share = angle / whole;
    return static_cast<std::uint16_t>(std::lround((share - std::floor(share)) * 65536) & 0xffff);
  }

  std::uint16_t tangent_angle(std::uint32_t row) const {
    const Vec3f t(cloud_.tangent_x[row], cloud_.tangent_y[row], cloud_.tangent_z[row]);
    return angle_about_normal(row, t, std::numbers::pi);
  }

  /// Distance of a half-plane from the surfel's centre as a code, kNoHalfPlane where it cuts
  /// nothing.
  std::uint16_t half_plane_distance(const RenderCloud::ClipColumns& clip, std::uint32_t row) const {
    if (!RenderCloud::clips(clip, row) || normal(row).isZero(0)) return kNoHalfPlane;
    float deviation = cloud_.deviation_u[row];
    if (cloud_.anisotropic()) deviation = std::max(deviation, cloud_.deviation_v[row]);
    const float place = clip.distance[row] / (kPackedClipReach * deviation);
    if (!(place < 1)) return kNoHalfPlane;
    return static_cast<std::uint16_t>(std::lround((std::max(place, -1.0F) + 1) * kMiddleDistance));
  }

  void add_half_planes(PackedColumn column, const RenderCloud::ClipColumns& clip, std::string& to) {
    const bool some = std::any_of(rows_.begin(), rows_.end(), [&](std::uint32_t row) {
      return half_plane_distance(clip, row) != kNoHalfPlane;
    });
    if (!some) return;
    header_.columns |= column;
    for (const std::uint32_t row : rows_) {
      const std::uint16_t distance = half_plane_distance(clip, row);
      std::uint16_t angle = 0;
      if (distance != kNoHalfPlane) {
        const Vec3f direction(clip.x[row], clip.y[row], clip.z[row]);
        angle = angle_about_normal(row, direction, 2 * std::numbers::pi);
      }
      append(angle, to);
      append(distance, to);
    }
  }

  void add_area(std::string& to) {
    const auto area = [&](std::uint32_t row) { return log2_of(cloud_.area[row]); };
    const auto [least, most] = range_of(area);
    const Range16 range(least, most);
    header_.area_log = range.low;
    header_.area_step = range.step;
    if (!(range.step > 0)) return;
    header_.columns |= kPackedArea;
    for (const std::uint32_t row : rows_) append(range.code(area(row)), to);
  }

  void add_colors(std::string& to) {
    const Array<float>* const channels[] = {&cloud_.red, &cloud_.green, &cloud_.blue};
    float least = 0;
    float most = 1;
    for (const Array<float>* channel : channels) {
      const auto [low, high] = range_of([&](std::uint32_t row) { return (*channel)[row]; });
      least = std::min(least, low);
      most = std::max(most, high);
    }
    header_.color_low = least;
    header_.color_scale = most - least;
    const auto code = [&](std::uint32_t row, int channel) {
      return linear_to_srgb8(((*channels[channel])[row] - least) / (most - least));
    };
    bool same = true;
    std::string codes;
    for (const std::uint32_t row : rows_) {
      for (int channel = 0; channel < 3; ++channel) {
        const std::uint8_t value = code(row, channel);
        if (row == rows_.front()) header_.color[channel] = value;
        same = same && value == header_.color[channel];
        append(value, codes);
      }
    }
    if (same) return;
    header_.columns |= kPackedColor;
    to += codes;
  }

  void add_alpha(std::string& to) {
    if (!cloud_.transparent()) return;
    const auto alpha = [&](std::uint32_t row) { return cloud_.alpha[row]; };
    if (range_of(alpha).first >= 1) return;
    header_.columns |= kPackedAlpha;
    for (const std::uint32_t row : rows_) append(code8(alpha(row)), to);
  }

  void add_attribute(std::string& to) {
    if (!attribute_) return;
    const auto value = [&](std::uint32_t row) { return attribute_->red[row]; };
    const auto [least, most] = range_of(value);
    header_.attribute = code8(least);
    if (code8(least) == code8(most)) return;
    header_.columns |= kPackedAttribute;
    for (const std::uint32_t row : rows_) append(code8(value(row)), to);
  }

  const RenderCloud& cloud_;
  const RenderCloud* attribute_;
  std::vector<std::uint32_t> rows_;
  PackedCluster header_{};
};

}  // namespace

void pack_cluster(const RenderCloud& cloud, std::uint32_t cluster, const RenderCloud* attribute,
                  std::string& to) {
  Packer(cloud, cluster, attribute).append_to(to);
}

PackedDirection pack_direction(const Vec3f& direction) {
  const float size = direction.lpNorm<1>();
  if (!(size > 0)) return {0xffff, 0xffff};
  Vec3f d = direction / size;
  const auto sign = [](float x) { return x < 0 ? -1.0F : 1.0F; };
  float u = d.x();
  float v = d.y();
  if (d.z() < 0) {
    u = (1 - std::abs(d.y())) * sign(d.x());
    v = (1 - std::abs(d.x())) * sign(d.y());
  }
  const auto code = [](float x) {
    return static_cast<std::uint16_t>(
        std::lround(std::clamp((x + 1) / 2, 0.0F, 1.0F) * kMostDirection));
  };
  return {code(u), code(v)};
}

Vec3f unpack_direction(PackedDirection code) {
  if (code.u == 0xffff) return {0, 0, 0};
  const float u = 2 * static_cast<float>(code.u) / kMostDirection - 1;
  const float v = 2 * static_cast<float>(code.v) / kMostDirection - 1;
  const float z = 1 - std::abs(u) - std::abs(v);
  const float folded = std::max(0.0F, -z);
  return Vec3f(u + (u < 0 ? folded : -folded), v + (v < 0 ? folded : -folded), z).normalized();
}

Vec3f packed_tangent(const Vec3f& n) {
  const float sign = std::copysign(1.0F, n.z());
  const float a = -1 / (sign + n.z());
  return {1 + sign * n.x() * n.x() * a, sign * n.x() * n.y() * a, -sign * n.x()};
}

}  // namespace surfel
