#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_from_records.h>

namespace surfel {
namespace {

/// Records that one thread takes at a time: they and what is made of them fit into its cache.
constexpr std::size_t kBlock = 4096;

/// Linear light of every value of T, an sRGB code.
template <class T, class Decode>
std::vector<float> decoded_codes(const Decode& decode) {
  std::vector<float> table(std::size_t{std::numeric_limits<T>::max()} + 1);
  for (std::size_t i = 0; i < table.size(); ++i) table[i] = decode(static_cast<T>(i));
  return table;
}

/// The finite values' range in one block of records.
struct Range {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
};

class Reader {
 public:
  Reader(const RecordTable& table, const std::string& file, bool double_positions)
      : table_(table), file_(file), taken_(table.columns.size(), false) {
    cloud_.double_positions = double_positions;
  }

  SurfelCloud read();

 private:
  /// Copies of one block of records from the file into the cloud.
  using Copies = std::vector<std::function<void(std::size_t begin, std::size_t end)>>;
  using Names = std::initializer_list<const char*>;
  using Columns = std::vector<const RecordColumn*>;

  Columns find(Names names) const;
  bool taken(const RecordColumn& column) const { return taken_[&column - table_.columns.data()]; }
  void take(const Columns& columns);
  template <class T>
  void allocate(Array<T>& to, std::size_t values);
  void run(const Copies& copies) const;

  template <class Visit>
  void visit_values(const RecordColumn& column, Visit&& visit) const;
  template <class T>
  bool fit(const Columns& columns) const;
  template <class To, class Convert>
  void copy(const RecordColumn& column, To* to, std::size_t stride, Convert convert);
  template <class To>
  void copy(const RecordColumn& column, To* to, std::size_t stride);

  template <int kSize>
  bool read_vector(std::initializer_list<Names> spellings,
                   Array<Eigen::Matrix<float, kSize, 1>>& to);
  bool read_float(const char* name, Array<float>& to);
  template <class T>
  void read_integer(const char* name, Array<T>& to);

  void read_positions();
  void read_position(const RecordColumn& column, int axis);
  void recenter();
  void make_unit(Array<Vec3f>& column);
  void read_variances();
  void read_colors();
  void read_alpha();
  void read_extra();

  const RecordTable& table_;
  const std::string& file_;
  std::vector<bool> taken_;
  Copies position_copies_;
  Copies copies_;
  std::vector<Range> ranges_[3];  ///< Of the coordinates, one a block.
  std::uint64_t allocated_ = 0;
  const std::uint64_t available_ = available_memory_bytes();
  SurfelCloud cloud_;
};

/// The columns of these names, in their order; empty unless all are there and nobody took them.
Reader::Columns Reader::find(Names names) const {
  Columns found;
  for (const char* name : names) {
    const auto column =
        std::find_if(table_.columns.begin(), table_.columns.end(),
                     [&](const RecordColumn& c) { return same_name(c.name, name) && !taken(c); });
    if (column == table_.columns.end()) return {};
    found.push_back(&*column);
  }
  return found;
}

void Reader::take(const Columns& columns) {
  for (const RecordColumn* column : columns) taken_[column - table_.columns.data()] = true;
}

template <class T>
void Reader::allocate(Array<T>& to, std::size_t values) {
  allocated_ += std::uint64_t{values} * sizeof(T);
  if (allocated_ > available_) {
    throw_input(file_, fmt::format("{} points need more than the {} MB of memory that are free",
                                   table_.count, available_ >> 20));
  }
  to.resize(values);
}

void Reader::run(const Copies& copies) const {
  parallel_for(table_.count, kBlock, [&](std::size_t begin, std::size_t end, int) {
    for (const auto& copy : copies) copy(begin, end);
  });
}

/// Calls visit(load), where load(i) is record i's value in the column's own type.
template <class Visit>
void Reader::visit_values(const RecordColumn& column, Visit&& visit) const {
  const std::byte* first = table_.data + column.offset;
  const std::size_t stride = table_.stride;
  visit_type(column.type, [&]<class T>(T) {
    if (table_.swapped) {
      visit([=](std::size_t i) { return load_scalar<T, true>(first + i * stride); });
    } else {
      visit([=](std::size_t i) { return load_scalar<T, false>(first + i * stride); });
    }
  });
}

/// Can T hold all values of the columns?
template <class T>
bool Reader::fit(const Columns& columns) const {
  for (const RecordColumn* column : columns) {
    std::vector<char> fits(table_.count / kBlock + 1, 1);
    visit_values(*column, [&](auto load) {
      using From = decltype(load(0));
      if constexpr (!std::is_same_v<From, T>) {
        parallel_for(table_.count, kBlock, [&](std::size_t begin, std::size_t end, int) {
          bool all = true;
          for (std::size_t i = begin; i < end; ++i) all &= representable<T>(load(i));
          fits[begin / kBlock] = all;
        });
      }
    });
    if (std::find(fits.begin(), fits.end(), 0) != fits.end()) return false;
  }
  return true;
}

template <class To, class Convert>
void Reader::copy(const RecordColumn& column, To* to, std::size_t stride, Convert convert) {
  visit_values(column, [&](auto load) {
    copies_.push_back([=](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) to[i * stride] = convert(load(i));
    });
  });
}

template <class To>
void Reader::copy(const RecordColumn& column, To* to, std::size_t stride) {
  copy(column, to, stride, [](auto value) { return static_cast<To>(value); });
}

/// Reads the first spelling of which all components are there.
template <int kSize>
bool Reader::read_vector(std::initializer_list<Names> spellings,
                         Array<Eigen::Matrix<float, kSize, 1>>& to) {
  for (const Names names : spellings) {
    const Columns columns = find(names);
    if (columns.empty()) continue;
    take(columns);
    allocate(to, table_.count);
    for (int k = 0; k < kSize; ++k) copy(*columns[k], to.data()->data() + k, kSize);
    return true;
  }
  return false;
}

bool Reader::read_float(const char* name, Array<float>& to) {
  const Columns columns = find({name});
  if (columns.empty()) return false;
  take(columns);
  allocate(to, table_.count);
  copy(*columns[0], to.data(), 1);
  return true;
}

/// A column of that name whose values T cannot hold means something else: it stays in `extra`.
template <class T>
void Reader::read_integer(const char* name, Array<T>& to) {
  const Columns columns = find({name});
  if (columns.empty() || !fit<T>(columns)) return;
  take(columns);
  allocate(to, table_.count);
  copy(*columns[0], to.data(), 1);
}

void Reader::read_position(const RecordColumn& column, int axis) {
  float* to = cloud_.position.data()->data() + axis;
  ranges_[axis].resize(table_.count / kBlock + 1);
  visit_values(column, [&](auto load) {
    position_copies_.push_back([this, axis, to, load](std::size_t begin, std::size_t end) {
      using T = decltype(load(0));
      T min = std::numeric_limits<T>::max();
      T max = std::numeric_limits<T>::lowest();
      for (std::size_t i = begin; i < end; ++i) {
        const T value = load(i);
        const bool finite = value * T{0} == T{0};  // Neither infinite nor NaN, without a branch.
        min = finite && value < min ? value : min;
        max = finite && value > max ? value : max;
        to[3 * i] = static_cast<float>(value);
      }
      if (const double origin = cloud_.origin[axis]; origin != 0) {
        for (std::size_t i = begin; i < end; ++i) {
          to[3 * i] = static_cast<float>(static_cast<double>(load(i)) - origin);
        }
      }
      if (min <= max) {
        ranges_[axis][begin / kBlock] = {static_cast<double>(min), static_cast<double>(max)};
      }
    });
  });
}

void Reader::read_positions() {
  const Columns columns = find({"x", "y", "z"});
  for (const char* name : {"x", "y", "z"}) {
    if (find({name}).empty()) throw_input(file_, fmt::format("the points have no column {}", name));
  }
  take(columns);
  allocate(cloud_.position, table_.count);
  for (int axis = 0; axis < 3; ++axis) read_position(*columns[axis], axis);
}

/// Called when the positions have been read: moves the origin, if need be, and reads them again.
void Reader::recenter() {
  Bounds box;
  for (int axis = 0; axis < 3; ++axis) {
    for (const Range& range : ranges_[axis]) {
      box.min[axis] = std::min(box.min[axis], range.min);
      box.max[axis] = std::max(box.max[axis], range.max);
    }
  }
  cloud_.origin = float_origin(box);
  if (cloud_.origin != Vec3d::Zero()) run(position_copies_);
}

void Reader::make_unit(Array<Vec3f>& column) {
  copies_.push_back([to = column.data()](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) to[i] = stored_unit(to[i]);
  });
}

void Reader::read_variances() {
  const Columns anisotropic = find({"tx", "ty", "tz", "variance_u", "variance_v"});
  if (!anisotropic.empty()) {
    read_vector<3>({{"tx", "ty", "tz"}}, cloud_.tangent);
    make_unit(cloud_.tangent);
    read_float("variance_u", cloud_.variance_u);
    read_float("variance_v", cloud_.variance_v);
  }
  const bool isotropic = read_float("variance", cloud_.variance);
  const Columns radius = find({"radius"});
  if (radius.empty()) return;
  // Where there are variances the radius follows from them.
  take(radius);
  if (isotropic || cloud_.anisotropic()) return;
  allocate(cloud_.variance, table_.count);
  copy(*radius[0], cloud_.variance.data(), 1, [](auto value) {
    const auto r = static_cast<float>(value);
    return r * r / 2;  // radius = sqrt(2 c variance) at c = 1
  });
}

void Reader::read_colors() {
  const std::initializer_list<Names> spellings = {
      {"red", "green", "blue"}, {"diffuse_red", "diffuse_green", "diffuse_blue"}, {"r", "g", "b"}};
  for (const Names names : spellings) {
    const Columns columns = find(names);
    if (columns.empty()) continue;
    const bool floats = std::all_of(columns.begin(), columns.end(), [](const RecordColumn* c) {
      return c->type >= ScalarType::kFloat32;
    });
    const float* table = nullptr;
    if (floats) {
      cloud_.color_encoding = ColorEncoding::kFloatLinear;
    } else if (columns[0]->type != ScalarType::kUint16 && fit<std::uint8_t>(columns)) {
      cloud_.color_encoding = ColorEncoding::kUint8Srgb;
      table = srgb8_table();
    } else if (fit<std::uint16_t>(columns)) {
      cloud_.color_encoding = ColorEncoding::kUint16Srgb;
      table = srgb16_table();
    } else {
      continue;
    }
    take(columns);
    allocate(cloud_.color, table_.count);
    for (int k = 0; k < 3; ++k) {
      float* to = cloud_.color.data()->data() + k;
      if (floats) {
        copy(*columns[k], to, 3);
      } else {
        // fit() has seen that no value is negative.
        copy(*columns[k], to, 3,
             [table](auto value) { return table[static_cast<std::uint16_t>(value)]; });
      }
    }
    return;
  }
}

void Reader::read_alpha() {
  const Columns columns = find({"alpha"});
  if (columns.empty()) return;
  const ScalarType type = columns[0]->type;
  float scale = 1;
  if (type < ScalarType::kFloat32) {
    cloud_.alpha_as_uint8 = type != ScalarType::kUint16 && fit<std::uint8_t>(columns);
    if (!cloud_.alpha_as_uint8 && !fit<std::uint16_t>(columns)) return;
    scale = cloud_.alpha_as_uint8 ? 255.0f : 65535.0f;
  }
  take(columns);
  allocate(cloud_.alpha, table_.count);
  copy(*columns[0], cloud_.alpha.data(), 1,
       [scale](auto value) { return static_cast<float>(value) / scale; });
}

void Reader::read_extra() {
  for (const RecordColumn& column : table_.columns) {
    if (taken(column)) continue;
    ExtraProperty& extra = cloud_.extra.emplace_back(ExtraProperty{column.name, column.type, {}});
    allocate(extra.data, table_.count * scalar_size(column.type));
    visit_values(column, [&](auto load) {
      copies_.push_back([load, to = extra.data.data()](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          const auto value = load(i);
          std::memcpy(to + i * sizeof(value), &value, sizeof(value));
        }
      });
    });
  }
}

SurfelCloud Reader::read() {
  if (table_.count == 0) throw_input(file_, "holds no points");
  read_positions();
  if (read_vector<3>({{"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}}, cloud_.normal)) {
    make_unit(cloud_.normal);
  }
  read_variances();
  read_float("area", cloud_.area);
  read_colors();
  read_alpha();
  read_vector<3>({{"w_red", "w_green", "w_blue"}}, cloud_.coefficient);
  read_vector<2>({{"u", "v"}, {"s", "t"}, {"texture_u", "texture_v"}}, cloud_.uv);
  read_vector<3>({{"dpdu_x", "dpdu_y", "dpdu_z"}}, cloud_.dpdu);
  read_vector<3>({{"dpdv_x", "dpdv_y", "dpdv_z"}}, cloud_.dpdv);
  read_integer("material", cloud_.material);
  read_integer("group", cloud_.group);
  read_float("group_radius", cloud_.group_radius);
  read_integer("source", cloud_.source);
  read_integer("level", cloud_.level);
  read_extra();
  copies_.insert(copies_.begin(), position_copies_.begin(), position_copies_.end());
  run(copies_);
  recenter();
  return std::move(cloud_);
}

}  // namespace

Vec3f stored_unit(const Vec3f& n) {
  const float squared = n.squaredNorm();
  constexpr float kUnit = 1e-6f;
  if (std::abs(squared - 1) <= kUnit) return n;
  const Vec3d wide = n.cast<double>();  // Neither overflows nor vanishes when squared.
  const double length = wide.norm();
  if (!(length > 0) || !std::isfinite(length)) return Vec3f::Zero();
  return (wide / length).cast<float>();
}

const float* srgb8_table() {
  static const std::vector<float> table = decoded_codes<std::uint8_t>(srgb8_to_linear);
  return table.data();
}

const float* srgb16_table() {
  static const std::vector<float> table = decoded_codes<std::uint16_t>(srgb16_to_linear);
  return table.data();
}

SurfelCloud cloud_from_records(const RecordTable& table, const std::string& file,
                               bool double_positions) {
  return Reader(table, file, double_positions).read();
}

}  // namespace surfel
