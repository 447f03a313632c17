#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/store/record_source.h>
#include <surfel/store/render_cloud.h>

namespace surfel {
namespace {

/// One column of consecutive records.
struct Field {
  const std::byte* first;
  std::size_t stride;

  template <class T>
  T get(std::size_t i) const {
    return load_scalar<T, false>(first + i * stride);
  }
  /// Writes convert(value) for the values of `count` records. Four at a time: two instructions each
  /// instead of five.
  template <class T, class To, class Convert>
  void copy(std::size_t count, To* to, const Convert& convert) const {
    const std::byte* at = first;
    std::size_t i = 0;
    for (; i + 4 <= count; i += 4, at += 4 * stride) {
      to[i] = convert(load_scalar<T, false>(at));
      to[i + 1] = convert(load_scalar<T, false>(at + stride));
      to[i + 2] = convert(load_scalar<T, false>(at + 2 * stride));
      to[i + 3] = convert(load_scalar<T, false>(at + 3 * stride));
    }
    for (; i < count; ++i) to[i] = convert(get<T>(i));
  }
};

/// Calls visit(T{}) with the type of a column that holds colours, opacities or small integers.
template <class Visit>
void visit_small(ScalarType type, Visit&& visit) {
  if (type == ScalarType::kUint8) {
    visit(std::uint8_t{});
  } else if (type == ScalarType::kUint16) {
    visit(std::uint16_t{});
  } else {
    visit(float{});
  }
}

/// Makes normals what unit_normal(stored_unit()) makes of them.
void make_unit(float* x, float* y, float* z, std::size_t count) {
  constexpr std::size_t kPiece = 256;
  constexpr float kUnit = 1e-6F;  // As stored_unit().
  for (std::size_t first = 0; first < count;
       first += kPiece, x += kPiece, y += kPiece, z += kPiece) {
    const std::size_t n = std::min(kPiece, count - first);
    float length[kPiece];
    int others = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const float squared = x[i] * x[i] + (y[i] * y[i] + z[i] * z[i]);
      length[i] = std::sqrt(squared);
      others |= static_cast<int>(!(std::abs(squared - 1) <= kUnit));
    }
    if (others == 0) {
      for (std::size_t i = 0; i < n; ++i) {
        x[i] /= length[i];
        y[i] /= length[i];
        z[i] /= length[i];
      }
      continue;
    }
    for (std::size_t i = 0; i < n; ++i) {
      const Vec3f unit = unit_normal(stored_unit(Vec3f(x[i], y[i], z[i])));
      x[i] = unit.x();
      y[i] = unit.y();
      z[i] = unit.z();
    }
  }
}

}  // namespace

std::unique_ptr<RecordSource> RecordSource::make(const InputFile& file, const RecordTable& table,
                                                 const std::optional<Bounds>& bounds) {
  if (table.swapped || std::endian::native != std::endian::little) return nullptr;
  if (table.count == 0) throw_input(file.name(), "holds no points");
  std::unique_ptr<RecordSource> source(new RecordSource(file, table));
  if (!source->find_columns()) return nullptr;
  if (bounds || source->position_[0]->type == ScalarType::kFloat64) {
    source->origin_ = float_origin(bounds ? *bounds : source->measure());
  }
  return source;
}

/// False if a column is of a type that is not decoded here.
bool RecordSource::find_columns() {
  bool known = true;
  const auto is_float = [](ScalarType type) { return type == ScalarType::kFloat32; };
  const auto is_code = [](ScalarType type) {
    return type == ScalarType::kUint8 || type == ScalarType::kUint16;
  };
  const auto is_color = [&](ScalarType type) { return is_code(type) || is_float(type); };
  const auto find = [&](const char* name, const auto& accept) -> Column {
    for (const RecordColumn& column : table_.columns) {
      if (!same_name(column.name, name)) continue;
      known = known && accept(column.type);
      return &column;
    }
    return nullptr;
  };
  const auto find_three = [&](std::initializer_list<std::array<const char*, 3>> spellings,
                              const auto& accept) -> Columns {
    for (const auto& names : spellings) {
      const auto any = [](ScalarType) { return true; };
      Columns found{find(names[0], any), find(names[1], any), find(names[2], any)};
      if (std::count(found.begin(), found.end(), nullptr) > 0) continue;
      for (const Column column : found) {
        known = known && accept(column->type) && column->type == found[0]->type;
      }
      return found;
    }
    return {};
  };
  position_ = find_three({{"x", "y", "z"}}, [&](ScalarType type) {
    return is_float(type) || type == ScalarType::kFloat64;
  });
  if (!position_[0]) {
    for (const char* name : {"x", "y", "z"}) {
      if (!find(name, [](ScalarType) { return true; })) {
        throw_input(file_.name(), std::string("the points have no column ") + name);
      }
    }
  }
  normal_ = find_three({{"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}}, is_float);
  tangent_ = find_three({{"tx", "ty", "tz"}}, is_float);
  variance_u_ = find("variance_u", is_float);
  variance_v_ = find("variance_v", is_float);
  if (!tangent_[0] || !variance_u_ || !variance_v_) tangent_ = {};
  variance_ = find("variance", is_float);
  radius_ = find("radius", is_float);
  if (!variance_ && !radius_ && !tangent_[0]) throw_no_variance(file_.name());
  area_ = find("area", is_float);
  color_ = find_three({{"w_red", "w_green", "w_blue"}}, is_float);
  if (!color_[0]) {
    color_ = find_three({{"red", "green", "blue"},
                         {"diffuse_red", "diffuse_green", "diffuse_blue"},
                         {"r", "g", "b"}},
                        is_color);
  }
  alpha_ = find("alpha", is_color);
  material_ = find("material", is_code);
  group_ = find("group", is_code);
  group_radius_ = find("group_radius", is_float);
  source_ = find("source", [](ScalarType type) { return type == ScalarType::kUint32; });
  return known;
}

SurfelAttributes RecordSource::attributes() const {
  return {.anisotropic = tangent_[0] != nullptr,
          .alpha = alpha_ != nullptr,
          .material = material_ != nullptr,
          .group = group_ != nullptr,
          .group_radius = group_radius_ != nullptr,
          .source = source_ != nullptr};
}

bool RecordSource::recenter(const Bounds& bounds) {
  if (position_[0]->type == ScalarType::kFloat64) return false;  // Placed before.
  const Vec3d origin = float_origin(bounds);
  if (origin == origin_) return false;
  origin_ = origin;
  return true;
}

/// Of a record in the file.
std::size_t RecordSource::offset(std::size_t record) const {
  return static_cast<std::size_t>(table_.data - file_.bytes().data()) + record * table_.stride;
}

const std::byte* RecordSource::read(std::size_t begin, std::size_t end) const {
  // Kept from block to block.
  static thread_local Array<std::byte> scratch;
  return file_.read_at(offset(begin), offset(end) - offset(begin), scratch);
}

void RecordSource::expect(std::size_t begin, std::size_t end) const {
  file_.expect(offset(begin), offset(end) - offset(begin));
}

/// Bounds of the finite positions, which are double.
Bounds RecordSource::measure() const {
  std::vector<Bounds> boxes(table_.count / RenderCloud::kBlock + 1);
  parallel_for(table_.count, RenderCloud::kBlock, [&](std::size_t begin, std::size_t end, int) {
    const std::byte* records = read(begin, end);
    Bounds box;
    for (int axis = 0; axis < 3; ++axis) {
      const Field from{records + position_[axis]->offset, table_.stride};
      for (std::size_t i = 0; i < end - begin; ++i) {
        const auto value = from.get<double>(i);
        if (!std::isfinite(value)) continue;
        box.min[axis] = std::min(box.min[axis], value);
        box.max[axis] = std::max(box.max[axis], value);
      }
    }
    boxes[begin / RenderCloud::kBlock] = box;
  });
  Bounds all;
  for (const Bounds& box : boxes) {
    all.min = all.min.cwiseMin(box.min);
    all.max = all.max.cwiseMax(box.max);
  }
  return all;
}

void RecordSource::fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
                        std::size_t row) const {
  // Records are read a block at a time, and decoded so few at a time that they and their columns
  // stay in the first-level cache while column after column is filled.
  constexpr std::size_t kPiece = RenderCloud::kClusterSize;
  for (; begin < end; begin += RenderCloud::kBlock) {
    const std::size_t block_end = std::min(begin + RenderCloud::kBlock, end);
    const std::byte* records = read(begin, block_end);
    for (std::size_t i = begin; i < block_end; i += kPiece) {
      const std::size_t count = std::min(kPiece, block_end - i);
      decode(records, count, cloud, row);
      records += count * table_.stride;
      row += count;
    }
  }
}

void RecordSource::decode(const std::byte* records, std::size_t count, RenderCloud& cloud,
                          std::size_t row) const {
  if (position_[0]->type == ScalarType::kFloat64) {
    fill_positions<double>(records, count, cloud, row);
  } else {
    fill_positions<float>(records, count, cloud, row);
  }
  fill_frames(records, count, cloud, row);
  fill_colors(records, count, cloud, row);
  const auto copy = [&](Column column, auto* to) {
    const Field from{records + column->offset, table_.stride};
    visit_small(column->type, [&]<class T>(T) {
      from.copy<T>(count, to,
                   [](T value) { return static_cast<std::remove_pointer_t<decltype(to)>>(value); });
    });
  };
  if (!cloud.material.empty()) copy(material_, cloud.material.data() + row);
  if (!cloud.group.empty()) copy(group_, cloud.group.data() + row);
  if (!cloud.group_radius.empty()) copy(group_radius_, cloud.group_radius.data() + row);
}

void RecordSource::fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const {
  for (; begin < end; begin += RenderCloud::kBlock) {
    const std::size_t count = std::min(RenderCloud::kBlock, end - begin);
    const Field from{read(begin, begin + count) + source_->offset, table_.stride};
    from.copy<std::uint32_t>(count, to, [](std::uint32_t value) { return value; });
    to += count;
  }
}

template <class T>
void RecordSource::fill_positions(const std::byte* records, std::size_t count, RenderCloud& cloud,
                                  std::size_t row) const {
  float* const to[] = {cloud.x.data() + row, cloud.y.data() + row, cloud.z.data() + row};
  for (int axis = 0; axis < 3; ++axis) {
    const Field from{records + position_[axis]->offset, table_.stride};
    const double origin = origin_[axis];
    float* out = to[axis];
    if (origin == 0) {
      from.copy<T>(count, out, [](T value) { return static_cast<float>(value); });
    } else {
      from.copy<T>(count, out, [=](T value) {
        return static_cast<float>(static_cast<double>(value) - origin);
      });
    }
    // Infinity minus itself is NaN, and passes for it.
    for (std::size_t i = 0; i < count; ++i) out[i] += out[i] - out[i];
  }
}

/// Normals, tangents, deviations and areas.
void RecordSource::fill_frames(const std::byte* records, std::size_t count, RenderCloud& cloud,
                               std::size_t row) const {
  const auto field = [&](Column column) { return Field{records + column->offset, table_.stride}; };
  const auto copy = [&](Column column, float* to) {
    field(column).copy<float>(count, to, [](float value) { return value; });
  };
  float* const normal[] = {cloud.normal_x.data() + row, cloud.normal_y.data() + row,
                           cloud.normal_z.data() + row};
  for (int k = 0; k < 3; ++k) {
    if (normal_[k]) {
      copy(normal_[k], normal[k]);
    } else {
      std::fill_n(normal[k], count, 0.0F);
    }
  }
  if (normal_[0]) make_unit(normal[0], normal[1], normal[2], count);

  float* u = cloud.deviation_u.data() + row;
  float* area = cloud.area.data() + row;
  if (tangent_[0]) {
    float* v = cloud.deviation_v.data() + row;
    copy(variance_u_, u);
    copy(variance_v_, v);
    for (std::size_t i = 0; i < count; ++i) u[i] = std::sqrt(u[i]);
    for (std::size_t i = 0; i < count; ++i) v[i] = std::sqrt(v[i]);
    for (std::size_t i = 0; i < count; ++i) area[i] = u[i] * v[i];  // sqrt |V|
    float* const tangent[] = {cloud.tangent_x.data() + row, cloud.tangent_y.data() + row,
                              cloud.tangent_z.data() + row};
    const Field from[] = {field(tangent_[0]), field(tangent_[1]), field(tangent_[2])};
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3f stored(from[0].get<float>(i), from[1].get<float>(i), from[2].get<float>(i));
      const Vec3f t =
          unit_tangent(stored_unit(stored), Vec3f(normal[0][i], normal[1][i], normal[2][i]));
      for (int k = 0; k < 3; ++k) tangent[k][i] = t[k];
    }
  } else {
    copy(variance_ ? variance_ : radius_, area);
    if (!variance_) {
      for (std::size_t i = 0; i < count; ++i) area[i] = area[i] * area[i] / 2;  // At cutoff 1.
    }
    for (std::size_t i = 0; i < count; ++i) u[i] = std::sqrt(area[i]);
  }
  if (!area_) return;
  copy(area_, area);
  for (std::size_t i = 0; i < count; ++i) {
    const float stored = area[i];
    // NaN where it is not finite.
    area[i] = (stored > 0 ? stored : 0.0F) + (stored - stored);
  }
}

void RecordSource::fill_colors(const std::byte* records, std::size_t count, RenderCloud& cloud,
                               std::size_t row) const {
  float* const to[] = {cloud.red.data() + row, cloud.green.data() + row, cloud.blue.data() + row};
  for (int k = 0; k < 3; ++k) {
    float* out = to[k];
    if (!color_[k]) {
      std::fill_n(out, count, SurfelCloud::colorless()[k]);
      continue;
    }
    const Field from{records + color_[k]->offset, table_.stride};
    visit_small(color_[k]->type, [&]<class T>(T) {
      if constexpr (std::is_same_v<T, float>) {
        from.copy<T>(count, out, [](float value) { return value; });
      } else {
        const float* table = std::is_same_v<T, std::uint8_t> ? srgb8_table() : srgb16_table();
        from.copy<T>(count, out, [=](T value) { return table[value]; });
      }
    });
  }
  if (cloud.alpha.empty()) return;
  float* out = cloud.alpha.data() + row;
  const Field from{records + alpha_->offset, table_.stride};
  visit_small(alpha_->type, [&]<class T>(T) {
    const float scale =
        std::is_same_v<T, float> ? 1.0F : static_cast<float>(std::numeric_limits<T>::max());
    from.copy<T>(count, out,
                 [=](T value) { return usable_alpha(static_cast<float>(value) / scale); });
  });
}

}  // namespace surfel
