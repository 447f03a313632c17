#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/surfel_decoder.h>
#include <surfel/io/unit_vector.h>

namespace surfel {
namespace {

using enum SurfelAttribute;

/// Linear light of every value of T, an sRGB code.
template <class T, class Decode>
std::vector<float> decoded_codes(const Decode& decode) {
  std::vector<float> table(std::size_t{std::numeric_limits<T>::max()} + 1);
  for (std::size_t i = 0; i < table.size(); ++i) table[i] = decode(static_cast<T>(i));
  return table;
}

/// Calls visit(load), where load(at) is the value at an address in the column's own type.
template <class Visit>
void visit_column(const RecordColumn& column, bool swapped, Visit&& visit) {
  visit_type(column.type, [&]<class T>(T) {
    if (swapped) {
      visit([](const std::byte* at) { return load_scalar<T, true>(at); });
    } else {
      visit([](const std::byte* at) { return load_scalar<T, false>(at); });
    }
  });
}

/// The decoding loop: writes value(at) for each of `count` records, `record` bytes apart, the first
/// at `at`. Four at a time, which takes two instructions a value instead of five.
/// \param stride  Places from one value written to the next: an integer, or a type that stands for
/// it.
template <class To, class Stride, class Value>
void for_values(const std::byte* at, std::size_t record, std::size_t count, To* to, Stride stride,
                const Value& value) {
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4, at += 4 * record, to += 4 * stride) {
    to[0] = value(at);
    to[stride] = value(at + record);
    to[2 * stride] = value(at + 2 * record);
    to[3 * stride] = value(at + 3 * record);
  }
  for (; i < count; ++i, at += record, to += stride) *to = value(at);
}

/// Makes vectors unit, or zero, if any of them is not unit already.
template <std::size_t kStride>
void make_unit(const std::array<float*, 3>& at, std::size_t count) {
  int others = 0;
  for (std::size_t i = 0; i < count * kStride; i += kStride) {
    const float x = at[0][i];
    const float y = at[1][i];
    const float z = at[2][i];
    others |= static_cast<int>(!(std::abs(x * x + (y * y + z * z) - 1) <= kUnitTolerance));
  }
  if (others == 0) return;
  for (std::size_t i = 0; i < count * kStride; i += kStride) {
    const Vec3f v(at[0][i], at[1][i], at[2][i]);
    if (std::abs(v.squaredNorm() - 1) <= kUnitTolerance) continue;
    const Vec3f unit = unit_or_zero(v);
    for (int k = 0; k < 3; ++k) at[k][i] = unit[k];
  }
}

}  // namespace

SurfelDecoder::SurfelDecoder(const RecordTable& table, const std::string& file)
    : table_(table), file_(file), taken_(table.columns.size()) {
  if (table.count == 0) throw_input(file, "holds no points");
  for (const char* name : {"x", "y", "z"}) {
    if (std::none_of(table.columns.begin(), table.columns.end(),
                     [&](const RecordColumn& c) { return same_name(c.name, name); })) {
      throw_input(file, fmt::format("the points have no column {}; x, y and z are needed", name));
    }
  }
  find(kPosition, {"x", "y", "z"});
  find_vector(kNormal, {{"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}});
  find(kShadingNormal, {"shading_nx", "shading_ny", "shading_nz"});
  find_variances();
  find(kArea, {"area"});
  find_clip(kClip1, {"clip1_x", "clip1_y", "clip1_z"}, kClip1Distance, "clip1_d");
  if (has(kClip1)) {
    find_clip(kClip2, {"clip2_x", "clip2_y", "clip2_z"}, kClip2Distance, "clip2_d");
  }
  find_colors();
  find_alpha();
  find(kCoefficient, {"w_red", "w_green", "w_blue"});
  find_vector(kUv, {{"u", "v"}, {"s", "t"}, {"texture_u", "texture_v"}});
  find(kDpdu, {"dpdu_x", "dpdu_y", "dpdu_z"});
  find(kDpdv, {"dpdv_x", "dpdv_y", "dpdv_z"});
  find_integer<std::uint16_t>(kMaterial, "material");
  find_integer<std::uint16_t>(kGroup, "group");
  find(kGroupRadius, {"group_radius"});
  find_integer<std::uint32_t>(kSource, "source");
  find_integer<std::uint8_t>(kLevel, "level");
  for (std::size_t i = 0; i < taken_.size(); ++i) {
    if (!taken_[i]) others_.push_back(&table_.columns[i]);
  }
}

bool SurfelDecoder::double_positions() const {
  const auto& columns = fields_[index(kPosition)].columns;
  return std::any_of(columns.begin(), columns.end(), [](const RecordColumn* column) {
    return column->type != ScalarType::kFloat32;
  });
}

/// Takes the columns of these names for the attribute; null unless all are there and free.
SurfelDecoder::Field* SurfelDecoder::find(SurfelAttribute attribute, const Names& names) {
  Field& field = fields_[index(attribute)];
  std::array<std::size_t, 3> found{};
  for (std::size_t k = 0; k < names.size() && names[k]; ++k) {
    const std::vector<RecordColumn>& columns = table_.columns;
    std::size_t& i = found[k];
    while (i < columns.size() && (taken_[i] || !same_name(columns[i].name, names[k]))) ++i;
    if (i == columns.size()) {
      field = {};
      return nullptr;
    }
    field.columns[k] = &columns[i];
  }
  for (std::size_t k = 0; k < names.size() && names[k]; ++k) taken_[found[k]] = true;
  return &field;
}

/// Frees the columns of an attribute for others.
void SurfelDecoder::release(Field& field) {
  for (const RecordColumn* column : field.columns) {
    if (column) taken_[static_cast<std::size_t>(column - table_.columns.data())] = false;
  }
  field = {};
}

/// Takes the first spelling of which all components are there.
void SurfelDecoder::find_vector(SurfelAttribute attribute, std::initializer_list<Names> spellings) {
  for (const Names& names : spellings) {
    if (find(attribute, names)) return;
  }
}

/// Can T hold all values of the field's columns?
template <class T>
bool SurfelDecoder::fit(const Field& field) const {
  constexpr std::size_t kBlock = 4096;  // Records: their bytes stay in the second-level cache.
  std::atomic<bool> all = true;
  for (const RecordColumn* column : field.columns) {
    if (!column) continue;
    visit_column(*column, table_.swapped, [&](auto load) {
      using From = decltype(load(nullptr));
      using Limits = std::numeric_limits<From>;
      if constexpr (!std::is_unsigned_v<From> || Limits::digits > std::numeric_limits<T>::digits) {
        table_.for_pieces(kBlock, [&](std::size_t, std::size_t begin, std::size_t end,
                                      const std::byte* records, int) {
          const std::byte* at = records + column->offset;
          bool fits = true;
          for (; begin < end; ++begin, at += table_.stride) fits &= representable<T>(load(at));
          if (!fits) all = false;
        });
      }
    });
  }
  return all;
}

template <class T>
void SurfelDecoder::find_integer(SurfelAttribute attribute, const char* name) {
  Field* field = find(attribute, {name});
  if (!field || fit<T>(*field)) return;
  release(*field);
}

void SurfelDecoder::find_variances() {
  Field& u = fields_[index(kVarianceU)];
  if (find(kVarianceU, {"variance_u", "variance_v"})) {
    if (find(kTangent, {"tx", "ty", "tz"})) {
      fields_[index(kVarianceV)].columns[0] = std::exchange(u.columns[1], nullptr);
    } else {
      release(u);
    }
  }
  Field& variance = fields_[index(kVariance)];
  find(kVariance, {"variance"});
  const Field stored = variance;
  if (find(kVariance, {"radius"})) variance.radius = true;
  // Where there are variances the radius follows from them.
  if (stored.columns[0] || anisotropic()) variance = stored;
}

/// Takes the four columns of a half-plane, if all are there.
void SurfelDecoder::find_clip(SurfelAttribute direction, const Names& names,
                              SurfelAttribute distance, const char* name) {
  Field* field = find(direction, names);
  if (field && !find(distance, {name})) release(*field);
}

void SurfelDecoder::find_colors() {
  for (const Names& names :
       {Names{"red", "green", "blue"}, Names{"diffuse_red", "diffuse_green", "diffuse_blue"},
        Names{"r", "g", "b"}}) {
    Field* field = find(kColor, names);
    if (!field) continue;
    const auto is_float = [](const RecordColumn* c) { return c->type >= ScalarType::kFloat32; };
    if (std::all_of(field->columns.begin(), field->columns.end(), is_float)) {
      color_encoding_ = ColorEncoding::kFloatLinear;
      return;
    }
    if (field->columns[0]->type != ScalarType::kUint16 && fit<std::uint8_t>(*field)) {
      color_encoding_ = ColorEncoding::kUint8Srgb;
      field->table = srgb8_table();
      return;
    }
    if (fit<std::uint16_t>(*field)) {
      color_encoding_ = ColorEncoding::kUint16Srgb;
      field->table = srgb16_table();
      return;
    }
    release(*field);
  }
}

void SurfelDecoder::find_alpha() {
  Field* field = find(kAlpha, {"alpha"});
  if (!field || field->columns[0]->type >= ScalarType::kFloat32) return;
  alpha_as_uint8_ = field->columns[0]->type != ScalarType::kUint16 && fit<std::uint8_t>(*field);
  if (alpha_as_uint8_ || fit<std::uint16_t>(*field)) {
    field->scale = alpha_as_uint8_ ? 255.0F : 65535.0F;
  } else {
    release(*field);
  }
}

template <class To>
void SurfelDecoder::decode_component(SurfelAttribute attribute, int component,
                                     const std::byte* records, std::size_t count, To* to,
                                     std::size_t stride) const {
  const Field& field = fields_[index(attribute)];
  const RecordColumn& column = *field.columns[static_cast<std::size_t>(component)];
  visit_column(column, table_.swapped, [&](auto load) {
    const auto run = [&](const auto& value) {
      const std::byte* first = records + column.offset;
      if (stride == 1) {
        constexpr std::integral_constant<std::size_t, 1> kOne;
        for_values(first, table_.stride, count, to, kOne, value);
      } else {
        for_values(first, table_.stride, count, to, stride, value);
      }
    };
    if constexpr (std::is_same_v<To, float>) {
      if (const double origin = origin_[component]; attribute == kPosition && origin != 0) {
        return run([=](const std::byte* at) {
          return static_cast<float>(static_cast<double>(load(at)) - origin);
        });
      }
      if (const float* table = field.table) {
        // fit() has seen that no value is negative.
        return run(
            [=](const std::byte* at) { return table[static_cast<std::uint16_t>(load(at))]; });
      }
      if (field.radius) {
        return run([=](const std::byte* at) {
          const auto r = static_cast<float>(load(at));
          return r * r / 2;  // radius = sqrt(2 c variance) at c = 1
        });
      }
      if (const float scale = field.scale; scale != 1) {
        return run([=](const std::byte* at) { return static_cast<float>(load(at)) / scale; });
      }
    }
    run([=](const std::byte* at) { return static_cast<To>(load(at)); });
  });
}

template <class T>
void SurfelDecoder::decode(SurfelAttribute attribute, const std::byte* records, std::size_t count,
                           const ComponentColumns<T>& to) const {
  const Field& field = fields_[index(attribute)];
  for (std::size_t k = 0; k < field.columns.size() && field.columns[k]; ++k) {
    decode_component(attribute, static_cast<int>(k), records, count, to.at[k], to.stride);
  }
  if constexpr (std::is_same_v<T, float>) {
    if (attribute != kNormal && attribute != kTangent) return;
    to.stride == 1 ? make_unit<1>(to.at, count) : make_unit<3>(to.at, count);
  }
}

template void SurfelDecoder::decode(SurfelAttribute, const std::byte*, std::size_t,
                                    const ComponentColumns<float>&) const;
template void SurfelDecoder::decode(SurfelAttribute, const std::byte*, std::size_t,
                                    const ComponentColumns<std::uint8_t>&) const;
template void SurfelDecoder::decode(SurfelAttribute, const std::byte*, std::size_t,
                                    const ComponentColumns<std::uint16_t>&) const;
template void SurfelDecoder::decode(SurfelAttribute, const std::byte*, std::size_t,
                                    const ComponentColumns<std::uint32_t>&) const;

void SurfelDecoder::decode(const RecordColumn& column, const std::byte* records, std::size_t count,
                           std::byte* to) const {
  visit_column(column, table_.swapped, [&](auto load) {
    const std::byte* at = records + column.offset;
    for (std::size_t i = 0; i < count; ++i, at += table_.stride) {
      const auto value = load(at);
      std::memcpy(to + i * sizeof(value), &value, sizeof(value));
    }
  });
}

void SurfelDecoder::measure(const std::byte* records, std::size_t count, Bounds& box) const {
  for (int axis = 0; axis < 3; ++axis) {
    const RecordColumn& column = *fields_[index(kPosition)].columns[static_cast<std::size_t>(axis)];
    visit_column(column, table_.swapped, [&](auto load) {
      using T = decltype(load(nullptr));
      T min = std::numeric_limits<T>::max();
      T max = std::numeric_limits<T>::lowest();
      const std::byte* at = records + column.offset;
      for (std::size_t i = 0; i < count; ++i, at += table_.stride) {
        const T value = load(at);
        const bool finite = value * T{0} == T{0};  // Neither infinite nor NaN, without a branch.
        min = finite && value < min ? value : min;
        max = finite && value > max ? value : max;
      }
      if (min > max) return;
      box.min[axis] = std::min(box.min[axis], static_cast<double>(min));
      box.max[axis] = std::max(box.max[axis], static_cast<double>(max));
    });
  }
}

void SurfelDecoder::measure(const std::byte* records, std::size_t count,
                            CoordinateSpread& spread) const {
  for (int axis = 0; axis < 3; ++axis) {
    const RecordColumn& column = *fields_[index(kPosition)].columns[static_cast<std::size_t>(axis)];
    visit_column(column, table_.swapped, [&](auto load) {
      const std::byte* at = records + column.offset;
      std::array<double, kPiece> coordinates;
      for (std::size_t i = 0; i < count; ++i, at += table_.stride) {
        coordinates[i] = static_cast<double>(load(at));
      }
      spread.add(axis, std::span(coordinates).first(count));
    });
  }
}

void SurfelDecoder::decode_exact(const std::byte* records, std::size_t count, Vec3d* to) const {
  for (int axis = 0; axis < 3; ++axis) {
    const RecordColumn& column = *fields_[index(kPosition)].columns[static_cast<std::size_t>(axis)];
    visit_column(column, table_.swapped, [&](auto load) {
      const std::byte* at = records + column.offset;
      for (std::size_t i = 0; i < count; ++i, at += table_.stride) {
        to[i][axis] = static_cast<double>(load(at));
      }
    });
  }
}

bool SurfelDecoder::offsets_are_exact(const std::byte* records, std::size_t count,
                                      const Vec3d& origin) const {
  bool all = true;
  for (int axis = 0; axis < 3; ++axis) {
    const RecordColumn& column = *fields_[index(kPosition)].columns[static_cast<std::size_t>(axis)];
    visit_column(column, table_.swapped, [&](auto load) {
      const std::byte* at = records + column.offset;
      for (std::size_t i = 0; i < count && all; ++i, at += table_.stride) {
        const auto x = static_cast<double>(load(at));
        const auto offset = static_cast<double>(static_cast<float>(x - origin[axis]));
        all = origin[axis] + offset == x || !std::isfinite(x);
      }
    });
  }
  return all;
}

void SurfelDecoder::count_decimals(const std::byte* records, std::size_t count,
                                   int& decimals) const {
  double power = power_of_ten(decimals);
  for (const RecordColumn* column : fields_[index(kPosition)].columns) {
    visit_column(*column, table_.swapped, [&](auto load) {
      const std::byte* at = records + column->offset;
      for (std::size_t i = 0; i < count && decimals < kManyDecimals; ++i, at += table_.stride) {
        const auto value = static_cast<double>(load(at));
        if (!std::isfinite(value)) continue;
        const auto is_decimal = [&] { return std::round(value * power) / power == value; };
        while (decimals < kManyDecimals && !is_decimal()) power = power_of_ten(++decimals);
      }
    });
  }
}

const float* srgb8_table() {
  static const std::vector<float> table = decoded_codes<std::uint8_t>(srgb8_to_linear);
  return table.data();
}

const float* srgb16_table() {
  static const std::vector<float> table = decoded_codes<std::uint16_t>(srgb16_to_linear);
  return table.data();
}

}  // namespace surfel
