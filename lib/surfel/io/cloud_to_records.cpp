#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <iterator>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/text_scanner.h>
#include <surfel/scene/exact_coordinates.h>

namespace surfel {
namespace {

constexpr std::size_t kCloudGrain = std::size_t{1} << 15;

/// Is a number a decimal that programs write a float as: the shortest one, or of nine digits?
bool is_decimal_of(double x, float nearest) {
  const auto reads_back = [&](const auto& digits) {
    const std::string_view text(digits.data(), digits.size());
    return parse_number(text) == x;
  };
  fmt::basic_memory_buffer<char, 64> digits;
  fmt::format_to(std::back_inserter(digits), "{}", nearest);
  if (reads_back(digits)) return true;
  digits.clear();
  fmt::format_to(std::back_inserter(digits), "{:.9g}", nearest);
  return reads_back(digits);
}

/// Are all coordinates of this axis exact as float, or decimals that floats are written as?
bool exact_in_float(const SurfelCloud& cloud, const ExactCoordinates& coordinates, int axis) {
  const bool near = cloud.origin[axis] == 0;
  if (near && cloud.exact.empty()) return true;
  std::atomic<bool> exact{true};
  parallel_for(cloud.size(), kCloudGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end && exact; ++i) {
      const double x = coordinates(i, axis);
      const auto nearest = static_cast<float>(x);
      const bool same = static_cast<double>(nearest) == x || std::isnan(x);
      if (!same && !(near && is_decimal_of(x, nearest))) exact = false;
    }
  });
  return exact;
}

std::uint8_t to_uint8(float alpha) {
  return alpha > 0 ? static_cast<std::uint8_t>(std::lround(std::min(alpha, 1.0f) * 255)) : 0;
}

}  // namespace

/// Adds a column whose value in record i is value(i), unless that name is there already.
template <class T, class Value>
void CloudRecords::add(const std::string& name, Value value) {
  for (const RecordColumn& column : columns_) {
    if (column.name == name) return;
  }
  // Types in the order of ScalarType.
  constexpr ScalarType kType = std::is_same_v<T, std::int8_t>     ? ScalarType::kInt8
                               : std::is_same_v<T, std::uint8_t>  ? ScalarType::kUint8
                               : std::is_same_v<T, std::int16_t>  ? ScalarType::kInt16
                               : std::is_same_v<T, std::uint16_t> ? ScalarType::kUint16
                               : std::is_same_v<T, std::int32_t>  ? ScalarType::kInt32
                               : std::is_same_v<T, std::uint32_t> ? ScalarType::kUint32
                               : std::is_same_v<T, float>         ? ScalarType::kFloat32
                                                                  : ScalarType::kFloat64;
  const std::size_t offset = stride_;
  columns_.push_back({name, kType, offset});
  stride_ += sizeof(T);
  encode_.push_back([this, offset, value](std::size_t begin, std::size_t end, std::byte* out) {
    out += offset;
    for (std::size_t i = begin; i < end; ++i, out += stride_) {
      const T stored = value(i);
      std::memcpy(out, &stored, sizeof(T));
    }
  });
}

template <class T>
void CloudRecords::add_scalar(const char* name, const Array<T>& column) {
  if (column.empty()) return;
  add<T>(name, [from = column.data()](std::size_t i) { return from[i]; });
}

template <int kSize>
void CloudRecords::add_vector(const char* const (&names)[kSize],
                              const Array<Eigen::Matrix<float, kSize, 1>>& column) {
  if (column.empty()) return;
  for (int k = 0; k < kSize; ++k) {
    add<float>(names[k], [from = column.data(), k](std::size_t i) { return from[i][k]; });
  }
}

void CloudRecords::add_position(const CloudRecordOptions& options) {
  const ExactCoordinates coordinates(cloud_, options.for_text);
  const auto narrow = [&](int axis) { return exact_in_float(cloud_, coordinates, axis); };
  const bool decimal =
      options.for_text && (cloud_.origin != Vec3d::Zero() || !cloud_.exact.empty());
  const bool wide = options.double_positions || cloud_.double_positions || cloud_.las || decimal ||
                    !(narrow(0) && narrow(1) && narrow(2));
  constexpr const char* kNames[] = {"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    const auto exact = [coordinates, k](std::size_t i) { return coordinates(i, k); };
    if (wide) {
      add<double>(kNames[k], exact);
    } else {
      add<float>(kNames[k], [exact](std::size_t i) { return static_cast<float>(exact(i)); });
    }
  }
}

void CloudRecords::add_variances() {
  add_scalar("variance", cloud_.variance);
  add_vector<3>({"tx", "ty", "tz"}, cloud_.tangent);
  add_scalar("variance_u", cloud_.variance_u);
  add_scalar("variance_v", cloud_.variance_v);
  // For other viewers: sqrt(2 c max variance) at c = 1.
  if (cloud_.anisotropic()) {
    add<float>("radius", [this](std::size_t i) {
      return std::sqrt(2 * std::max(cloud_.variance_u[i], cloud_.variance_v[i]));
    });
  } else if (!cloud_.variance.empty()) {
    add<float>("radius", [this](std::size_t i) { return std::sqrt(2 * cloud_.variance[i]); });
  }
}

void CloudRecords::add_color(bool pcl_names) {
  if (cloud_.color.empty()) return;
  const Vec3f* color = cloud_.color.data();
  if (cloud_.color_encoding == ColorEncoding::kUint8Srgb && pcl_names) {
    add<float>("rgb", [color](std::size_t i) {
      const auto bits = [&](int k) { return std::uint32_t{linear_to_srgb8(color[i][k])}; };
      return std::bit_cast<float>(bits(0) << 16 | bits(1) << 8 | bits(2));
    });
    return;
  }
  constexpr const char* kNames[] = {"red", "green", "blue"};
  for (int k = 0; k < 3; ++k) {
    switch (cloud_.color_encoding) {
      case ColorEncoding::kUint8Srgb:
        add<std::uint8_t>(kNames[k],
                          [color, k](std::size_t i) { return linear_to_srgb8(color[i][k]); });
        break;
      case ColorEncoding::kUint16Srgb:
        add<std::uint16_t>(kNames[k],
                           [color, k](std::size_t i) { return linear_to_srgb16(color[i][k]); });
        break;
      case ColorEncoding::kFloatLinear:
        add<float>(kNames[k], [color, k](std::size_t i) { return color[i][k]; });
        break;
    }
  }
}

void CloudRecords::add_alpha() {
  if (!cloud_.alpha_as_uint8) return add_scalar("alpha", cloud_.alpha);
  if (cloud_.alpha.empty()) return;
  add<std::uint8_t>("alpha",
                    [from = cloud_.alpha.data()](std::size_t i) { return to_uint8(from[i]); });
}

void CloudRecords::add_extra(const ExtraProperty& property) {
  visit_type(property.type, [&]<class T>(T) {
    add<T>(property.name, [from = property.data.data()](std::size_t i) {
      return load_scalar<T, false>(from + i * sizeof(T));
    });
  });
}

bool same_columns(const std::vector<RecordColumn>& a, const std::vector<RecordColumn>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const RecordColumn& x, const RecordColumn& y) {
                      return x.name == y.name && x.type == y.type;
                    });
}

CloudRecords::CloudRecords(const SurfelCloud& cloud, const CloudRecordOptions& options)
    : cloud_(cloud) {
  add_position(options);
  if (options.pcl_names) {
    add_vector<3>({"normal_x", "normal_y", "normal_z"}, cloud.normal);
  } else {
    add_vector<3>({"nx", "ny", "nz"}, cloud.normal);
  }
  add_vector<3>({"shading_nx", "shading_ny", "shading_nz"}, cloud.shading_normal);
  add_variances();
  add_scalar("area", cloud.area);
  add_vector<3>({"clip1_x", "clip1_y", "clip1_z"}, cloud.clip1);
  add_scalar("clip1_d", cloud.clip1_distance);
  add_vector<3>({"clip2_x", "clip2_y", "clip2_z"}, cloud.clip2);
  add_scalar("clip2_d", cloud.clip2_distance);
  add_color(options.pcl_names);
  add_alpha();
  add_vector<3>({"w_red", "w_green", "w_blue"}, cloud.coefficient);
  add_vector<2>({"u", "v"}, cloud.uv);
  add_vector<3>({"dpdu_x", "dpdu_y", "dpdu_z"}, cloud.dpdu);
  add_vector<3>({"dpdv_x", "dpdv_y", "dpdv_z"}, cloud.dpdv);
  add_scalar("material", cloud.material);
  add_scalar("group", cloud.group);
  add_scalar("group_radius", cloud.group_radius);
  add_scalar("source", cloud.source);
  add_scalar("level", cloud.level);
  for (const ExtraProperty& property : cloud.extra) add_extra(property);
}

void CloudRecords::encode(std::size_t begin, std::size_t end, std::byte* out) const {
  for (const auto& column : encode_) column(begin, end, out);
}

RecordPositions::RecordPositions(const CloudRecords& records) : stride_(records.stride()) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const RecordColumn& column = records.columns()[axis];
    offset_[axis] = column.offset;
    doubles_ = column.type == ScalarType::kFloat64;
  }
}

Vec3d RecordPositions::operator()(const std::byte* records, std::size_t i) const {
  const std::byte* const record = records + i * stride_;
  Vec3d p;
  for (int axis = 0; axis < 3; ++axis) {
    const std::byte* const at = record + offset_[axis];
    p[axis] = doubles_ ? load_scalar<double, false>(at)
                       : static_cast<double>(load_scalar<float, false>(at));
  }
  return p;
}

}  // namespace surfel
