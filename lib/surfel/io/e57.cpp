#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/e57.h>
#include <surfel/io/e57_header.h>
#include <surfel/io/e57_streams.h>
#include <surfel/io/narrow_colors.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>

namespace surfel {
namespace {

using FieldNames = std::array<const char*, 3>;
constexpr FieldNames kCartesianFields{"cartesianX", "cartesianY", "cartesianZ"};
constexpr FieldNames kSphericalFields{"sphericalAzimuth", "sphericalElevation", "sphericalRange"};
constexpr FieldNames kColorFields{"colorRed", "colorGreen", "colorBlue"};
constexpr FieldNames kNormalFields{"nor:normalX", "nor:normalY", "nor:normalZ"};

/// Points that are decoded at a time: a few packets, so that packets at the blocks' borders, which
/// are read twice, are few.
constexpr std::uint64_t kE57Block = std::uint64_t{1} << 15;

/// "rowIndex" as row_index; a prefix is left out.
std::string e57_column_name(const std::string& field) {
  std::string name;
  for (const char c : std::string_view(field).substr(field.find(':') + 1)) {
    const bool capital = c >= 'A' && c <= 'Z';
    if (capital && !name.empty() && name.back() != '_') name += '_';
    name += capital ? static_cast<char>(c - 'A' + 'a') : c;
  }
  return name;
}

/// The narrowest type of a column that holds all values of a field.
ScalarType e57_column_type(const E57Field& field) {
  if (field.type == E57Type::kSingle) return ScalarType::kFloat32;
  if (field.type != E57Type::kInteger) return ScalarType::kFloat64;
  for (const ScalarType type : {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16,
                                ScalarType::kInt16, ScalarType::kUint32, ScalarType::kInt32}) {
    const bool fits = visit_type(type, [&]<class T>(T) {
      return representable<T>(field.least()) && representable<T>(field.most());
    });
    if (fits) return type;
  }
  return ScalarType::kFloat64;
}

/// How the fields of a scan make records.
struct E57Layout {
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  /// A field, as a place in `fields`, that goes to a column as it is.
  struct Other {
    std::size_t field;
    std::size_t column;
  };

  std::vector<std::size_t> fields;  ///< FieldNames to be read, by their numbers in the scan.
  bool spherical = false;
  std::array<std::size_t, 3> position{};  ///< Places in `fields`, as the following ones are.
  std::size_t invalid = kNone;            ///< Above 0 where a point was not measured.
  std::optional<std::array<std::size_t, 3>> normal;
  std::optional<std::array<std::size_t, 3>> color;
  std::array<E57Limits, 3> limits{};
  bool guessed_limits = false;
  std::size_t color_invalid = kNone;
  std::size_t intensity_invalid = kNone;
  std::vector<Other> others;
};

/// The records of all scans, made block by block.
class E57Blocks final : public RecordBlocks {
 public:
  E57Blocks(const E57Header& header, const std::string& file);

  std::size_t blocks() const override { return blocks_.size(); }
  std::size_t first(std::size_t block) const override {
    return block == blocks_.size() ? count_ : blocks_[block].first;
  }
  const std::byte* read(std::size_t block, Array<std::byte>& scratch) const override;

  const std::vector<RecordColumn>& columns() const { return columns_; }
  std::size_t stride() const { return stride_; }
  std::size_t count() const { return count_; }
  std::size_t unmeasured() const { return unmeasured_; }
  bool double_positions() const { return columns_.front().type == ScalarType::kFloat64; }
  /// The largest code of the colours that were read so far.
  int brightest() const { return brightest_; }
  bool spherical(std::size_t scan) const { return layouts_[scan].spherical; }

 private:
  struct Block {
    std::size_t scan;
    std::uint64_t begin;  ///< Points of the scan.
    std::uint64_t end;
    std::size_t first = 0;  ///< Record.
  };

  [[noreturn]] void fail(std::size_t scan, const std::string& message) const {
    throw_input(file_, fmt::format("scan {}: {}", scans_[scan].number + 1, message));
  }
  void lay_out(std::size_t scan);
  void find_limits(std::size_t scan, E57Layout& layout);
  void add_columns();
  std::size_t add_column(std::string name, ScalarType type);
  void make_blocks();
  void read_positions(const E57Layout& layout, const E57Scan& scan,
                      const std::array<const double*, 3>& from, std::span<const std::uint32_t> kept,
                      std::byte* records) const;
  void read_colors(const Block& block, const std::array<const double*, 3>& from,
                   const double* invalid, std::span<const std::uint32_t> kept,
                   std::byte* records) const;

  const std::vector<E57Scan>& scans_;
  const std::string& file_;
  std::vector<E57Streams> streams_;
  std::vector<E57Layout> layouts_;
  std::vector<RecordColumn> columns_;
  std::size_t stride_ = 0;
  std::size_t normal_ = E57Layout::kNone;  ///< The first of three columns, as the next one is.
  std::size_t color_ = E57Layout::kNone;
  std::size_t scan_ = E57Layout::kNone;  ///< The column that counts the scans.
  std::vector<Block> blocks_;
  std::size_t count_ = 0;
  std::size_t unmeasured_ = 0;
  mutable std::atomic<int> brightest_{0};
};

E57Blocks::E57Blocks(const E57Header& header, const std::string& file)
    : scans_(header.scans), file_(file) {
  std::uint64_t room = header.pages.size() * 8;
  for (std::size_t s = 0; s < scans_.size(); ++s) {
    const E57Scan& scan = scans_[s];
    // All scans together, because several may point at the same bytes. Of points that are all
    // equal not even a bit need be there: they count as one.
    std::uint64_t bits = 0;
    for (const E57Field& field : scan.fields) bits += field.bits();
    bits = std::max<std::uint64_t>(bits, 1);
    require_room(
        scan.count, bits, room, [&] { return fmt::format("scan {}", scan.number + 1); }, "points",
        [&](const std::string& message) { throw_input(file_, message); });
    room -= scan.count * bits;
    streams_.emplace_back(header.pages, scan);
  }
  columns_ = {{"x", {}, 0}, {"y", {}, 0}, {"z", {}, 0}};
  layouts_.resize(scans_.size());
  for (std::size_t s = 0; s < scans_.size(); ++s) lay_out(s);
  add_columns();
  make_blocks();
}

/// Adds a column, or finds the one that another scan has added.
std::size_t E57Blocks::add_column(std::string name, ScalarType type) {
  for (std::size_t c = 3; c < columns_.size(); ++c) {
    if (!same_name(columns_[c].name, name)) continue;
    if (columns_[c].type != type) columns_[c].type = ScalarType::kFloat64;
    return c;
  }
  columns_.push_back({std::move(name), type, 0});
  return columns_.size() - 1;
}

/// Finds the meaning of a scan's fields.
void E57Blocks::lay_out(std::size_t number) {
  const E57Scan& scan = scans_[number];
  E57Layout& layout = layouts_[number];
  std::vector<bool> taken(scan.fields.size());
  const auto take = [&](const char* name) {
    const E57Field* field = scan.find(name);
    if (!field || field->type == E57Type::kText) return E57Layout::kNone;
    const auto at = static_cast<std::size_t>(field - scan.fields.data());
    taken[at] = true;
    layout.fields.push_back(at);
    return layout.fields.size() - 1;
  };
  const auto take_all = [&](const FieldNames& names) -> std::optional<std::array<std::size_t, 3>> {
    for (const char* name : names) {
      const E57Field* field = scan.find(name);
      if (!field || field->type == E57Type::kText) return std::nullopt;
    }
    return std::array{take(names[0]), take(names[1]), take(names[2])};
  };
  std::optional<std::array<std::size_t, 3>> position = take_all(kCartesianFields);
  layout.spherical = !position;
  if (!position) position = take_all(kSphericalFields);
  if (!position) {
    fail(number,
         "its points have neither cartesianX, cartesianY and cartesianZ nor "
         "sphericalRange, sphericalAzimuth and sphericalElevation");
  }
  layout.position = *position;
  layout.invalid = take(layout.spherical ? "sphericalInvalidState" : "cartesianInvalidState");
  layout.normal = take_all(kNormalFields);
  layout.color = take_all(kColorFields);
  if (layout.color) {
    layout.color_invalid = take("isColorInvalid");
    find_limits(number, layout);
  }
  if (scan.find("intensity")) layout.intensity_invalid = take("isIntensityInvalid");
  // FieldNames that say the same again are left out.
  for (const FieldNames& names : {kCartesianFields, kSphericalFields}) {
    for (const char* name : names) {
      if (const E57Field* field = scan.find(name)) {
        taken[static_cast<std::size_t>(field - scan.fields.data())] = true;
      }
    }
  }
  for (const char* name : {"cartesianInvalidState", "sphericalInvalidState"}) {
    if (const E57Field* field = scan.find(name)) {
      taken[static_cast<std::size_t>(field - scan.fields.data())] = true;
    }
  }
  std::vector<std::string> used;
  for (std::size_t f = 0; f < scan.fields.size(); ++f) {
    if (taken[f] || scan.fields[f].type == E57Type::kText) continue;
    std::string name = e57_column_name(scan.fields[f].name);
    const auto is_taken = [&](const std::string& text) {
      constexpr std::array<std::string_view, 10> kOwn{"x",  "y",   "z",     "nx",   "ny",
                                                      "nz", "red", "green", "blue", "scan"};
      const auto same = [&](std::string_view other) { return same_name(other, text); };
      return std::any_of(kOwn.begin(), kOwn.end(), same) ||
             std::any_of(used.begin(), used.end(), same);
    };
    if (is_taken(name)) {
      int more = 2;
      while (is_taken(fmt::format("{}_{}", name, more))) ++more;
      name += fmt::format("_{}", more);
    }
    used.push_back(name);
    ScalarType type = e57_column_type(scan.fields[f]);
    // An invalid intensity is NaN, which no integer is.
    const bool marked = layout.intensity_invalid != E57Layout::kNone &&
                        scan.fields[f].name == "intensity" && type < ScalarType::kFloat32;
    if (marked) type = scalar_size(type) < 4 ? ScalarType::kFloat32 : ScalarType::kFloat64;
    layout.fields.push_back(f);
    layout.others.push_back({layout.fields.size() - 1, add_column(std::move(name), type)});
    require_few(columns_.size(), "columns of all scans",
                [&](const std::string& message) { throw_input(file_, message); });
  }
}

/// The values of black and white.
void E57Blocks::find_limits(std::size_t number, E57Layout& layout) {
  constexpr double kMostCodes = 65535;
  const E57Scan& scan = scans_[number];
  for (std::size_t k = 0; k < 3; ++k) {
    const E57Field& field = *scan.find(kColorFields[k]);
    const bool numbers = field.type == E57Type::kInteger || field.type == E57Type::kScaled;
    const double range =
        (static_cast<double>(field.max) - static_cast<double>(field.min)) * field.scale;
    if (scan.color[k]) {
      layout.limits[k] = *scan.color[k];
    } else if (numbers && range > 0 && range <= kMostCodes) {
      layout.limits[k] = {field.least(), field.least() + range};
    } else {
      layout.limits[k] = {0, numbers ? 255.0 : 1.0};
      layout.guessed_limits = true;
    }
  }
}

/// Adds the columns that do not stand for a field alone, and gives all columns their places.
void E57Blocks::add_columns() {
  constexpr std::size_t kNone = E57Layout::kNone;
  bool single = true;
  bool few_codes = true;
  bool normals = false;
  bool colors = false;
  for (std::size_t s = 0; s < scans_.size(); ++s) {
    const E57Layout& layout = layouts_[s];
    const E57Scan& scan = scans_[s];
    single = single && !layout.spherical && !scan.pose;
    for (const std::size_t place : layout.position) {
      single = single && scan.fields[layout.fields[place]].type == E57Type::kSingle;
    }
    normals = normals || layout.normal.has_value();
    if (!layout.color) continue;
    colors = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const E57Field& field = scan.fields[layout.fields[(*layout.color)[k]]];
      few_codes = few_codes && field.type == E57Type::kInteger &&
                  layout.limits[k].max - layout.limits[k].min <= 255;
    }
  }
  for (std::size_t k = 0; k < 3; ++k) {
    columns_[k].type = single ? ScalarType::kFloat32 : ScalarType::kFloat64;
  }
  const auto add_three = [&](const char* a, const char* b, const char* c, ScalarType type) {
    for (const char* name : {a, b, c}) columns_.push_back({name, type, 0});
    return columns_.size() - 3;
  };
  normal_ = normals ? add_three("nx", "ny", "nz", ScalarType::kFloat32) : kNone;
  const ScalarType code = few_codes ? ScalarType::kUint8 : ScalarType::kUint16;
  color_ = colors ? add_three("red", "green", "blue", code) : kNone;
  if (scans_.size() > 1) {
    columns_.push_back({"scan", ScalarType::kUint16, 0});
    scan_ = columns_.size() - 1;
  }
  for (RecordColumn& column : columns_) {
    column.offset = stride_;
    stride_ += scalar_size(column.type);
  }
}

/// Divides the scans into blocks, and counts the points of each that were measured.
void E57Blocks::make_blocks() {
  for (std::size_t s = 0; s < scans_.size(); ++s) {
    for (std::uint64_t i = 0; i < scans_[s].count; i += kE57Block) {
      blocks_.push_back({s, i, std::min(i + kE57Block, scans_[s].count)});
    }
  }
  std::vector<std::size_t> measured(blocks_.size());
  parallel_each(blocks_.size(), 1, [&](std::size_t b) {
    const Block& block = blocks_[b];
    const E57Layout& layout = layouts_[block.scan];
    measured[b] = block.end - block.begin;
    if (layout.invalid == E57Layout::kNone) return;
    const std::size_t field = layout.fields[layout.invalid];
    E57Values values;
    streams_[block.scan].read({&field, 1}, block.begin, block.end, values);
    std::vector<double> states(measured[b]);
    streams_[block.scan].decode(field, values.streams.front(), states.size(), states.data());
    measured[b] = static_cast<std::size_t>(std::count(states.begin(), states.end(), 0.0));
  });
  std::uint64_t all = 0;
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    blocks_[b].first = count_;
    count_ += measured[b];
    all += blocks_[b].end - blocks_[b].begin;
  }
  unmeasured_ = all - count_;
  if (count_ == 0) {
    throw_input(file_, fmt::format("none of its {} points was measured, as it says itself", all));
  }
}

/// Writes a number as a value of a column; one that an integer cannot hold as 0.
void store_value(const RecordColumn& column, double value, std::byte* record) {
  visit_type(column.type, [&]<class T>(T) {
    const T stored = representable<T>(value) ? static_cast<T>(value) : T{};
    std::memcpy(record + column.offset, &stored, sizeof(T));
  });
}

void E57Blocks::read_positions(const E57Layout& layout, const E57Scan& scan,
                               const std::array<const double*, 3>& from,
                               std::span<const std::uint32_t> kept, std::byte* records) const {
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  if (scan.pose) {
    const Vec4d& q = scan.pose->orientation;
    turn = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
  }
  const Eigen::Matrix3d rotation = turn.toRotationMatrix();
  for (const std::uint32_t i : kept) {
    Vec3d p(from[0][i], from[1][i], from[2][i]);
    if (layout.spherical) {
      const double across = p[2] * portable::cos(p[1]);
      p = {across * portable::cos(p[0]), across * portable::sin(p[0]), p[2] * portable::sin(p[1])};
    }
    if (scan.pose) p = rotation * p + scan.pose->position;
    for (std::size_t k = 0; k < 3; ++k) {
      store_value(columns_[k], p[static_cast<Eigen::Index>(k)], records);
    }
    records += stride_;
  }
}

void E57Blocks::read_colors(const Block& block, const std::array<const double*, 3>& from,
                            const double* invalid, std::span<const std::uint32_t> kept,
                            std::byte* records) const {
  const E57Layout& layout = layouts_[block.scan];
  const double top = columns_[color_].type == ScalarType::kUint8 ? 255 : 65535;
  const double gray = linear_to_srgb8(SurfelCloud::colorless()[0]) * top / 255;
  // Codes of 16 bits that stand in the file themselves may turn out to be codes of 8 bits.
  bool verbatim = true;
  for (const E57Limits& limits : layout.limits) {
    verbatim = verbatim && limits.min == 0 && limits.max == top;
  }
  int brightest = 0;
  for (const std::uint32_t i : kept) {
    const bool known = from[0] && !(invalid && invalid[i] != 0) && std::isfinite(from[0][i]) &&
                       std::isfinite(from[1][i]) && std::isfinite(from[2][i]);
    for (std::size_t k = 0; k < 3; ++k) {
      double code = gray;
      if (known) {
        const E57Limits& limits = layout.limits[k];
        const double value = from[k][i];
        if (layout.guessed_limits && (value < limits.min || value > limits.max)) {
          fail(block.scan, fmt::format("{} is {} and the file does not say between which "
                                       "colorLimits; export it again with them",
                                       kColorFields[k], value));
        }
        const double part = (value - limits.min) / (limits.max - limits.min);
        code = std::round(std::clamp(part, 0.0, 1.0) * top);
      }
      brightest = std::max(brightest, verbatim ? static_cast<int>(code) : 65535);
      store_value(columns_[color_ + k], code, records);
    }
    records += stride_;
  }
  int known = brightest_;
  while (known < brightest && !brightest_.compare_exchange_weak(known, brightest)) {
  }
}

const std::byte* E57Blocks::read(std::size_t number, Array<std::byte>& scratch) const {
  const Block& block = blocks_[number];
  const E57Scan& scan = scans_[block.scan];
  const E57Layout& layout = layouts_[block.scan];
  const E57Streams& streams = streams_[block.scan];
  const std::size_t count = block.end - block.begin;
  static thread_local E57Values values;
  streams.read(layout.fields, block.begin, block.end, values);
  static thread_local std::array<Array<double>, 4> decoded;
  const auto decode = [&](std::size_t place, std::size_t to) -> const double* {
    if (place == E57Layout::kNone) return nullptr;
    decoded[to].resize(count);
    streams.decode(layout.fields[place], values.streams[place], count, decoded[to].data());
    return decoded[to].data();
  };
  const auto decode_three = [&](const std::array<std::size_t, 3>& places) {
    return std::array{decode(places[0], 0), decode(places[1], 1), decode(places[2], 2)};
  };

  static thread_local std::vector<std::uint32_t> kept;
  kept.clear();
  const double* invalid = decode(layout.invalid, 3);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (!invalid || invalid[i] == 0) kept.push_back(i);
  }
  if (scratch.size() < kept.size() * stride_) scratch.resize(kept.size() * stride_);
  std::byte* const records = scratch.data();
  const auto fill = [&](std::size_t column, const auto& value) {
    std::byte* record = records;
    for (const std::uint32_t i : kept) {
      store_value(columns_[column], value(i), record);
      record += stride_;
    }
  };
  read_positions(layout, scan, decode_three(layout.position), kept, records);
  std::vector<bool> filled(columns_.size());
  for (const E57Layout::Other& other : layout.others) {
    const double* from = decode(other.field, 0);
    const bool marked = scan.fields[layout.fields[other.field]].name == "intensity";
    const double* bad = marked ? decode(layout.intensity_invalid, 1) : nullptr;
    filled[other.column] = true;
    fill(other.column, [&](std::uint32_t i) {
      return bad && bad[i] != 0 ? std::numeric_limits<double>::quiet_NaN() : from[i];
    });
  }
  if (normal_ != E57Layout::kNone) {
    std::array<const double*, 3> from{};
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    if (layout.normal) from = decode_three(*layout.normal);
    if (scan.pose) {
      const Vec4d& q = scan.pose->orientation;
      rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
    }
    for (std::size_t k = 0; k < 3; ++k) {
      filled[normal_ + k] = true;
      fill(normal_ + k, [&](std::uint32_t i) {
        if (!from[0]) return 0.0;  // An unknown normal.
        return rotation.row(static_cast<Eigen::Index>(k))
            .dot(Vec3d(from[0][i], from[1][i], from[2][i]));
      });
    }
  }
  if (color_ != E57Layout::kNone) {
    std::array<const double*, 3> from{};
    if (layout.color) from = decode_three(*layout.color);
    read_colors(block, from, decode(layout.color_invalid, 3), kept, records);
    for (std::size_t k = 0; k < 3; ++k) filled[color_ + k] = true;
  }
  if (scan_ != E57Layout::kNone) {
    filled[scan_] = true;
    fill(scan_, [&](std::uint32_t) { return static_cast<double>(block.scan); });
  }
  for (std::size_t c = 3; c < columns_.size(); ++c) {
    if (filled[c]) continue;
    const double missing =
        columns_[c].type < ScalarType::kFloat32 ? 0 : std::numeric_limits<double>::quiet_NaN();
    fill(c, [&](std::uint32_t) { return missing; });
  }
  return records;
}

/// Where a scan's scanner stood, if that is known.
std::optional<Viewpoint> e57_viewpoint(const E57Scan& scan, bool spherical) {
  if (scan.pose && !is_default(*scan.pose)) return scan.pose;
  const bool own_place = spherical || (scan.find("rowIndex") && scan.find("columnIndex"));
  if (own_place) return Viewpoint{};
  return std::nullopt;
}

void set_e57_viewpoints(const E57Header& header, const E57Blocks& points, SurfelCloud& cloud) {
  std::vector<Viewpoint> views;
  for (std::size_t s = 0; s < header.scans.size(); ++s) {
    const std::optional<Viewpoint> view = e57_viewpoint(header.scans[s], points.spherical(s));
    if (!view) return;
    views.push_back(*view);
  }
  const bool same = std::all_of(views.begin(), views.end(), [&](const Viewpoint& view) {
    return view.position == views.front().position;
  });
  if (same) {
    cloud.viewpoint = views.front();
  } else {
    cloud.scan_viewpoints = std::move(views);
  }
  // Scanners on a tripod are levelled; objects whose scans have no place lie in any way.
  cloud.up = Vec3d::UnitZ();
}

}  // namespace

struct E57Points::Impl {
  InputFile input;
  E57Header header;
  E57Blocks blocks;
  RecordTable table;

  explicit Impl(InputFile file)
      : input(std::move(file)), header(input), blocks(header, input.name()) {
    table.blocks = &blocks;
    table.count = blocks.count();
    table.stride = blocks.stride();
    table.columns = blocks.columns();
  }
};

E57Points::E57Points(InputFile file) : impl_(std::make_unique<Impl>(std::move(file))) {}
E57Points::~E57Points() = default;

const RecordTable& E57Points::table() const { return impl_->table; }
const std::string& E57Points::file() const { return impl_->input.name(); }
bool E57Points::double_positions() const { return impl_->blocks.double_positions(); }

void E57Points::describe(SurfelCloud& cloud) const {
  narrow_colors(cloud, impl_->blocks.brightest());
  cloud.unmeasured_skipped = impl_->blocks.unmeasured();
  set_e57_viewpoints(impl_->header, impl_->blocks, cloud);
  for (std::size_t s = 0; s < impl_->header.scans.size(); ++s) {
    const std::string& name = impl_->header.scans[s].name;
    if (!name.empty()) cloud.comments.push_back(fmt::format("scan {}: {}", s, name));
  }
}

}  // namespace surfel
