#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/version.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/las_header.h>
#include <surfel/io/las_layout.h>
#include <surfel/io/las_projection.h>
#include <surfel/io/las_writer.h>
#include <surfel/io/laz_points.h>
#include <surfel/io/surfel_decoder.h>
#include <surfel/io/text_scanner.h>
#include <surfel/laz/chunk_table.h>
#include <surfel/laz/laz_chunk.h>

namespace surfel {
namespace {

constexpr std::size_t kMostBlockBytes = 65535;
constexpr std::size_t kMostExtra = kMostBlockBytes / 192;  ///< Columns that one block describes.
constexpr std::uint32_t kChunkPoints = 50000;  ///< As LASzip's own, which readers are made for.

/// FieldBytes of a header or block, little-endian.
class FieldBytes {
 public:
  template <class T>
  void add(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  /// Text in a field of so many bytes, the rest zeros.
  void add_text(std::string_view text, std::size_t bytes) {
    std::string field(text.substr(0, bytes));
    field.resize(bytes);
    bytes_ += field;
  }
  void add_bytes(std::string_view bytes) { bytes_ += bytes; }
  const std::string& all() const { return bytes_; }

 private:
  std::string bytes_;
};

/// So many values that a field does not hold change no factor, however few others there are.
constexpr std::uint64_t kFewValues = 10;
constexpr double kAngleStep = 0.006;  ///< Degrees of a step of `scan_angle`.

/// A column of the cloud that goes into a field of the points: (value - offset) * factor, rounded
/// and clamped to what the field holds.
struct Filled {
  RecordColumn column;
  LasField field;
  double least = 0;
  double most = 0;
  double offset = 0;
  double factor = 1;
  bool exact = false;  ///< The field holds all values as they are.
  bool copy = false;   ///< Extra bytes hold the values, too, as they are.
};

/// A column of the cloud that becomes extra bytes.
struct Extra {
  RecordColumn column;
  std::string name;
  std::size_t offset;  ///< In a point.
};

/// The least and the largest value of a field.
std::pair<double, double> limits_of(const LasField& field) {
  if (field.bits > 0) return {0, (1 << field.bits) - 1};
  return visit_type(field.type, []<class T>(T) {
    using Limits = std::numeric_limits<T>;
    return std::pair(static_cast<double>(Limits::lowest()), static_cast<double>(Limits::max()));
  });
}

bool is_real(const LasField& field) {
  return field.bits == 0 &&
         (field.type == ScalarType::kFloat32 || field.type == ScalarType::kFloat64);
}

/// Does a field hold all values that a survey has seen as they are?
bool holds_all(const LasField& field, const CloudSurvey::Range& range) {
  const auto [least, most] = limits_of(field);
  return is_real(field) || (range.count > 0 && range.fractions + range.nan + range.infinite == 0 &&
                            range.least >= least && range.most <= most);
}

/// Chooses how values become whole numbers: brightness uses the 16 bits of its field, angles with
/// fractions are degrees.
void choose_factor(const CloudSurvey::Range& range, Filled& filled) {
  const std::string_view name = filled.field.name;
  const bool brightness = name == "intensity" || name == "nir";
  if (name == "scan_angle" && range.fractions > 0 && std::abs(range.least) <= 180 &&
      std::abs(range.most) <= 180) {
    filled.factor = 1 / kAngleStep;
  }
  if (!brightness || range.least > range.most) return;
  const auto are_many = [&](std::uint64_t values) {
    return values > kFewValues && values > range.count / 100;
  };
  if (are_many(range.outside)) {
    const double span = range.most - range.least;
    filled.offset = range.least;
    const bool steps = range.fractions == 0 && span <= filled.most;
    if (!steps && span > 0) filled.factor = filled.most / span;
  } else if (range.fractions > 0 && range.most <= 1) {
    filled.factor = filled.most;
  } else if (are_many(range.fractions) && range.most <= 255) {
    filled.factor = filled.most / 255;
  }
}

}  // namespace

class LasWriter::Impl {
 public:
  Impl(std::string path, const CloudSurvey& survey, bool no_clobber)
      : path_(std::move(path)),
        compressed_(lower_extension(path_) == ".laz"),
        survey_(survey),
        file_(path_, no_clobber) {
    if (!survey_.nowhere) return;
    throw_input(path_,
                fmt::format("surfel {} has a position that is not finite, which LAS cannot tell; "
                            "leave it out or write PLY",
                            *survey_.nowhere));
  }

  void append(const SurfelCloud& piece, const std::vector<std::string>& comments) {
    const CloudRecords records(piece, {.double_positions = true});
    if (!open_) open(piece, records, comments);
    require_same(records.columns());
    constexpr std::size_t kAtOnce = 16 * std::size_t{kChunkPoints};
    ProgressStage stage("writing", piece.size(), "surfels");
    for (std::size_t begin = 0; begin < piece.size(); begin += kAtOnce) {
      const std::size_t end = std::min(begin + kAtOnce, piece.size());
      const std::size_t made = points_.size();
      points_.resize(made + (end - begin) * record_);
      make_points(records, begin, end, points_.data() + made);
      if (points_.size() >= kAtOnce * record_) write_whole_chunks();
      stage.add(end - begin);
    }
    written_ += piece.size();
  }

  std::vector<std::string> commit() {
    if (written_ != survey_.count) {
      throw_input(path_,
                  fmt::format("{} surfels were promised and {} written", survey_.count, written_));
    }
    write_chunks(points_.size() / record_);
    if (compressed_) write_chunk_table();
    const std::string head = header() + blocks_.all();
    file_.write_at(0, head.data(), head.size());
    file_.commit();
    return notes();
  }

 private:
  /// Decides on what is the same for all points.
  void open(const SurfelCloud& first, const CloudRecords& records,
            const std::vector<std::string>& comments) {
    las_ = first.las;
    columns_ = records.columns();
    colored_ = !first.color.empty();
    choose_format();
    place_columns();
    choose_steps(first);
    add_blocks(comments);
    begin_ = header_bytes() + blocks_.all().size();
    file_.reserve(begin_);
    table_ = begin_;
    if (compressed_) table_ = begin_ + sizeof(std::uint64_t);
    file_.reserve(table_ - begin_);
    open_ = true;
  }

  void require_same(const std::vector<RecordColumn>& columns) const {
    const bool same = std::equal(columns_.begin(), columns_.end(), columns.begin(), columns.end(),
                                 [](const RecordColumn& a, const RecordColumn& b) {
                                   return a.name == b.name && a.type == b.type;
                                 });
    if (!same) throw_input(path_, "pieces of the cloud differ in their columns");
  }

  bool extended() const { return format_ >= 6; }
  std::size_t header_bytes() const { return extended() ? 375 : 227; }
  const RecordColumn* find(std::string_view name) const {
    const auto column = std::find_if(columns_.begin(), columns_.end(),
                                     [&](const auto& c) { return same_name(c.name, name); });
    return column == columns_.end() ? nullptr : &*column;
  }
  bool has(std::string_view name) const { return find(name) != nullptr; }
  CloudSurvey::Range range_of(const RecordColumn& column) const {
    const auto found = survey_.range.find(column.name);
    return found == survey_.range.end() ? CloudSurvey::Range() : found->second;
  }

  /// Do formats 6 to 8 hold values of this field that formats 0 to 3 do not?
  bool wants_more(const LasField& field) const {
    const RecordColumn* column = find(field.name);
    if (!column) return false;
    const CloudSurvey::Range range = range_of(*column);
    if (std::string_view(field.name) == "scan_angle_rank") {
      return range.count > 0 && !holds_all(field, range);
    }
    for (const LasField& wide : las_fields(6)) {
      if (std::string_view(wide.name) != field.name) continue;
      const double most = limits_of(field).second;
      return range.most > most && limits_of(wide).second > most;
    }
    return false;
  }

  void choose_format() {
    const int was = las_ ? las_->point_format : 0;
    const bool colored = colored_ || las_color_offset(was) > 0;
    const bool wide = survey_.count > std::numeric_limits<std::uint32_t>::max();
    const std::vector<LasField> fields = las_fields(0);
    const bool more = was >= 6 || wide || has("nir") || has("scan_angle") || has("overlap") ||
                      has("scanner_channel") ||
                      std::any_of(fields.begin(), fields.end(),
                                  [&](const auto& field) { return wants_more(field); });
    if (more) {
      format_ = has("nir") ? 8 : colored ? 7 : 6;
    } else {
      format_ = (has("gps_time") ? 1 : 0) + (colored ? 2 : 0);
    }
  }

  void add_filled(const RecordColumn& column, const LasField& field) {
    Filled filled{.column = column, .field = field};
    std::tie(filled.least, filled.most) = limits_of(field);
    const CloudSurvey::Range range = range_of(column);
    choose_factor(range, filled);
    filled.exact = filled.factor == 1 && filled.offset == 0 && holds_all(field, range);
    filled_.push_back(filled);
  }

  /// The name that extra bytes get, which no other column of the file has.
  std::string extra_name(const std::string& name) {
    constexpr std::size_t kMost = 32;
    std::string own = name.substr(0, kMost);
    for (int number = 2; std::any_of(names_.begin(), names_.end(),
                                     [&](const auto& taken) { return same_name(taken, own); });
         ++number) {
      const std::string end = fmt::format("_{}", number);
      own = name.substr(0, kMost - end.size()) + end;
    }
    names_.push_back(own);
    return own;
  }

  /// Finds fields for columns. Formats 6 to 8 have the degrees of `scan_angle_rank` in finer steps:
  /// other programs look for them there.
  void place_fields() {
    names_ = {"x", "y", "z"};
    for (const LasField& field : las_fields(format_)) {
      const std::string_view name = field.name;
      names_.emplace_back(name);
      const bool color = name == "red" || name == "green" || name == "blue";
      // A column of that name that is not a channel of colours would be read as one.
      const RecordColumn* column = color ? nullptr : find(name);
      if (column) add_filled(*column, field);
      const RecordColumn* rank =
          name == "scan_angle" && !column ? find("scan_angle_rank") : nullptr;
      if (!rank) continue;
      const auto [least, most] = limits_of(field);
      filled_.push_back({*rank, field, least, most, 0, 1 / kAngleStep, false, true});
    }
  }

  /// Finds a field or extra bytes for each column.
  void place_columns() {
    record_ = layout().format_bytes();
    place_fields();
    for (const RecordColumn& column : columns_) {
      const std::string_view name = column.name;
      if (name == "x" || name == "y" || name == "z") continue;
      if (colored_ && (name == "red" || name == "green" || name == "blue")) {
        colors_.push_back(column);
        continue;
      }
      const bool placed = std::any_of(filled_.begin(), filled_.end(), [&](const Filled& filled) {
        return filled.column.name == name && !filled.copy;
      });
      if (placed) continue;
      if (extra_.size() == kMostExtra) {
        throw_input(path_, fmt::format("{} columns are more than LAS can describe; write PLY",
                                       columns_.size()));
      }
      extra_.push_back({column, extra_name(column.name), record_});
      record_ += scalar_size(column.type);
    }
    if (record_ > std::numeric_limits<std::uint16_t>::max()) {
      throw_input(path_, "a point has more than the 65,535 bytes that LAS allows; write PLY");
    }
    for (std::size_t k = 0; k < 3; ++k) {
      position_[k] = *find(std::array{"x", "y", "z"}[k]);
    }
    if (has("return_number")) return;
    const unsigned one_of_one = extended() ? 0x11 : 0x09;
    returns_ = static_cast<std::byte>(has("number_of_returns") ? 1 : one_of_one);
  }

  static constexpr double kMostSteps = std::numeric_limits<std::int32_t>::max();
  static double power_of_ten_below(double length) {
    return portable::pow(10.0, std::floor(portable::log10(length)));
  }
  /// The finest power of ten by whose steps 32 bits reach so far in both directions.
  static double finest_step(double reach) {
    // Powers of ten below it have few digits, or none: the step would be zero.
    constexpr double kLeastStep = 1e-300;
    return 10 * power_of_ten_below(std::max(reach / kMostSteps, kLeastStep));
  }
  /// Can the steps tell all positions?
  static bool reaches(const Vec3d& scale, const Vec3d& offset, const Bounds& box) {
    const auto in_reach = [&](const Vec3d& corner) {
      const Vec3d steps = ((corner - offset).array() / scale.array()).round();
      return steps.minCoeff() >= -kMostSteps - 1 && steps.maxCoeff() <= kMostSteps;
    };
    return in_reach(box.min) && in_reach(box.max);
  }

  void choose_steps(const SurfelCloud& first) {
    const Bounds& box = survey_.box;
    if (las_) {
      scale_ = las_->scale;
      offset_ = las_->offset;
      if (box.empty() || reaches(scale_, offset_, box)) return;
    }
    offset_ = first.origin;
    double step = 1e-3;
    if (survey_.decimals) {
      step = 1 / power_of_ten(*survey_.decimals);
      offset_ = first.origin.array().round();
    } else if (survey_.exact) {
      step = 0;
    } else if (!box.empty()) {
      const Bounds core = survey_.core();
      const double reach = std::max((core.max - first.origin).cwiseAbs().maxCoeff(),
                                    (core.min - first.origin).cwiseAbs().maxCoeff());
      // Floats that far from the origin have 24 bits.
      tolerance_ = reach * 0x1p-24;
      if (reach > 0) step = power_of_ten_below(tolerance_);
    }
    scale_ = Vec3d::Constant(step);
    if (box.empty() || (step > 0 && reaches(scale_, offset_, box))) return;
    for (int axis = 0; axis < 3; ++axis) {
      offset_[axis] = std::round(box.min[axis] / 2 + box.max[axis] / 2);
      const double reach = std::max(box.max[axis] - offset_[axis], offset_[axis] - box.min[axis]);
      scale_[axis] = std::max(step, finest_step(reach > 0 ? reach : 1));
    }
  }

  void add_block(std::string_view user, int id, std::string_view description,
                 std::string_view bytes) {
    if (bytes.size() > kMostBlockBytes) return;
    blocks_.add(std::uint16_t{0});
    blocks_.add_text(user, 16);
    blocks_.add(static_cast<std::uint16_t>(id));
    blocks_.add(static_cast<std::uint16_t>(bytes.size()));
    blocks_.add_text(description, 32);
    blocks_.add_bytes(bytes);
    ++block_count_;
  }

  std::string extra_descriptions() const {
    // By ScalarType.
    constexpr unsigned char kTypes[] = {2, 1, 4, 3, 6, 5, 9, 10};
    FieldBytes bytes;
    for (const Extra& extra : extra_) {
      bytes.add(std::uint16_t{0});
      bytes.add(kTypes[static_cast<std::size_t>(extra.column.type)]);
      bytes.add(std::uint8_t{0});
      bytes.add_text(extra.name, 32);
      bytes.add_text("", 156);
    }
    return bytes.all();
  }

  void add_blocks(const std::vector<std::string>& comments) {
    if (las_) {
      for (const LasRecord& block : las_->records) {
        add_block(block.user, block.id, block.description, block.bytes);
      }
    }
    const std::optional<CoordinateSystem> system = coordinate_system(comments);
    if (system && (!las_ || las_projection(las_->records) != system)) {
      const LasRecord block = las_projection_record(*system);
      add_block(block.user, block.id, block.description, block.bytes);
    }
    if (!extra_.empty()) {
      add_block("LASF_Spec", 4, "extra bytes", extra_descriptions());
    }
    std::string lines;
    for (const std::string& comment : comments) {
      if (lines.size() + comment.size() < kMostBlockBytes) lines += comment + '\n';
    }
    if (!lines.empty()) add_block(kCommentUser, kCommentId, "comments", lines);
    if (compressed_)
      add_block("laszip encoded", 22204, "LASzip", laszip_block(layout(), kChunkPoints));
  }

  laz::PointLayout layout() const { return {.format = format_, .bytes = record_}; }

  /// What the points tell that the header counts.
  struct Counts {
    std::array<std::int32_t, 3> least{std::numeric_limits<std::int32_t>::max(),
                                      std::numeric_limits<std::int32_t>::max(),
                                      std::numeric_limits<std::int32_t>::max()};
    std::array<std::int32_t, 3> most{std::numeric_limits<std::int32_t>::min(),
                                     std::numeric_limits<std::int32_t>::min(),
                                     std::numeric_limits<std::int32_t>::min()};
    std::array<std::uint64_t, 16> returns{};
    std::vector<std::uint64_t> clamped;  ///< Values that were, by the column of filled_.
    std::uint64_t colors = 0;            ///< Colours of which a value was clamped.
    std::uint64_t rounded = 0;           ///< Points whose coordinates the steps do not tell.
  };

  static unsigned color_code(const RecordColumn& column, const std::byte* record, bool narrow) {
    switch (column.type) {
      case ScalarType::kUint8:
        return load_scalar<std::uint8_t, false>(record + column.offset) * (narrow ? 1U : 257U);
      case ScalarType::kUint16:
        return load_scalar<std::uint16_t, false>(record + column.offset);
      default:
        return linear_to_srgb16(load_scalar<float, false>(record + column.offset));
    }
  }

  /// Makes the points [first, last) and counts them.
  void make_points(const CloudRecords& records, std::size_t first, std::size_t last,
                   std::byte* points) {
    std::vector<Counts> counts((last - first) / kBlock + 1);
    PerWorker<Array<std::byte>> buffers;
    parallel_for(last - first, kBlock, [&](std::size_t begin, std::size_t end, int worker) {
      Array<std::byte>& bytes = buffers[worker];
      bytes.resize(kBlock * records.stride());
      records.encode(first + begin, first + end, bytes.data());
      make_points(bytes.data(), records.stride(), end - begin, points + begin * record_,
                  counts[begin / kBlock]);
    });
    for (const Counts& part : counts) merge(part);
  }

  void make_points(const std::byte* record, std::size_t stride, std::size_t count,
                   std::byte* points, Counts& counts) const {
    std::memset(points, 0, count * record_);
    counts.clamped.resize(filled_.size());
    const std::size_t color = las_color_offset(format_);
    for (std::size_t i = 0; i < count; ++i, record += stride, points += record_) {
      make_position(record, points, counts);
      points[14] = returns_;
      for (std::size_t k = 0; k < filled_.size(); ++k) {
        fill(filled_[k], record, points, counts.clamped[k]);
      }
      bool beyond = false;
      for (std::size_t k = 0; k < colors_.size(); ++k) {
        const auto code =
            static_cast<std::uint16_t>(color_code(colors_[k], record, las_.has_value()));
        std::memcpy(points + color + 2 * k, &code, sizeof(code));
        if (colors_[k].type != ScalarType::kFloat32) continue;
        const auto value = load_scalar<float, false>(record + colors_[k].offset);
        beyond = beyond || !(value >= 0 && value <= 1);
      }
      counts.colors += beyond ? 1 : 0;
      for (const Extra& extra : extra_) {
        std::memcpy(points + extra.offset, record + extra.column.offset,
                    scalar_size(extra.column.type));
      }
      ++counts.returns[std::to_integer<std::size_t>(points[14]) & (extended() ? 15 : 7)];
    }
  }

  void make_position(const std::byte* record, std::byte* point, Counts& counts) const {
    // A sum of a product rounds in double precision.
    constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();
    bool rounded = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      const auto world = load_scalar<double, false>(record + position_[k].offset);
      const auto step =
          static_cast<std::int32_t>(std::llround((world - offset_[axis]) / scale_[axis]));
      std::memcpy(point + 4 * k, &step, sizeof(step));
      counts.least[k] = std::min(counts.least[k], step);
      counts.most[k] = std::max(counts.most[k], step);
      const double error = std::abs(step * scale_[axis] + offset_[axis] - world);
      const double least = kRounding * (std::abs(world) + std::abs(offset_[axis]));
      rounded = rounded || error > std::max(least, tolerance_);
    }
    counts.rounded += rounded ? 1 : 0;
  }

  static void fill(const Filled& filled, const std::byte* record, std::byte* point,
                   std::uint64_t& clamped) {
    const LasField& field = filled.field;
    visit_type(filled.column.type, [&]<class T>(T) {
      const T value = load_scalar<T, false>(record + filled.column.offset);
      if (filled.exact) return store(field, value, point);
      const double number = (static_cast<double>(value) - filled.offset) * filled.factor;
      const double whole = std::isnan(number) ? 0 : std::round(number);
      const double stored = std::clamp(whole, filled.least, filled.most);
      clamped += stored == whole ? 0 : 1;
      store(field, stored, point);
    });
  }

  template <class T>
  static void store(const LasField& field, T value, std::byte* point) {
    if (field.bits > 0) {
      point[field.offset] |= static_cast<std::byte>(static_cast<unsigned>(value) << field.shift);
      return;
    }
    visit_type(field.type, [&]<class Field>(Field) {
      const auto stored = static_cast<Field>(value);
      std::memcpy(point + field.offset, &stored, sizeof(stored));
    });
  }

  /// How what is stored differs from the cloud.
  std::vector<std::string> notes() const {
    std::vector<std::string> lines;
    if (counts_.rounded > 0) {
      const std::string why =
          las_ && scale_ == las_->scale
              ? "those of the first file"
              : fmt::format("LAS has 32 bits for each, and the points extend over {:.4g} units",
                            survey_.box.diagonal());
      lines.push_back(
          fmt::format("coordinates of {} of {} points are rounded to steps of {:.2g}: {}",
                      counts_.rounded, survey_.count, scale_.maxCoeff(), why));
    }
    for (std::size_t k = 0; k < filled_.size() && !counts_.clamped.empty(); ++k) {
      const Filled& filled = filled_[k];
      if (filled.copy) continue;
      const CloudSurvey::Range range = range_of(filled.column);
      std::vector<std::string> parts;
      if (filled.factor != 1 || filled.offset != 0) {
        parts.push_back(fmt::format(
            "stored as {} times {:.9g}",
            filled.offset == 0 ? "the value" : fmt::format("(the value {:+.9g})", -filled.offset),
            filled.factor));
      } else if (range.fractions > 0 && !filled.exact) {
        parts.push_back(fmt::format("{} of {} values rounded", range.fractions, range.count));
      }
      if (counts_.clamped[k] > 0) {
        parts.push_back(fmt::format("{} of {} values clamped to {} to {}", counts_.clamped[k],
                                    range.count, filled.least, filled.most));
      }
      if (range.nan > 0 && !filled.exact) {
        parts.push_back(
            fmt::format("{} of {} values not a number, stored as 0", range.nan, range.count));
      }
      if (!parts.empty()) {
        lines.push_back(fmt::format("{}: {}", filled.column.name, fmt::join(parts, ", ")));
      }
    }
    if (counts_.colors > 0) {
      lines.push_back(
          fmt::format("{} of {} colours clamped to 0 to 1", counts_.colors, survey_.count));
    }
    for (const Extra& extra : extra_) {
      if (extra.name == extra.column.name) continue;
      lines.push_back(
          fmt::format("{} is named {}: names have 32 characters in LAS, and each is "
                      "there once",
                      extra.column.name, extra.name));
    }
    return lines;
  }

  void merge(const Counts& counts) {
    for (std::size_t k = 0; k < 3; ++k) {
      counts_.least[k] = std::min(counts_.least[k], counts.least[k]);
      counts_.most[k] = std::max(counts_.most[k], counts.most[k]);
    }
    for (std::size_t k = 0; k < counts.returns.size(); ++k) {
      counts_.returns[k] += counts.returns[k];
    }
    counts_.clamped.resize(filled_.size());
    for (std::size_t k = 0; k < counts.clamped.size(); ++k) {
      counts_.clamped[k] += counts.clamped[k];
    }
    counts_.colors += counts.colors;
    counts_.rounded += counts.rounded;
  }

  /// Writes the points that have been made, without the points of a last chunk that is not full.
  void write_whole_chunks() {
    const std::size_t made = points_.size() / record_;
    write_chunks(compressed_ ? made / kChunkPoints * kChunkPoints : made);
  }

  /// Writes the first points that have been made and were not written yet.
  void write_chunks(std::size_t count) {
    if (count == 0) return;
    if (compressed_) {
      std::vector<std::vector<std::uint8_t>> chunks((count + kChunkPoints - 1) / kChunkPoints);
      parallel_for(count, kChunkPoints, [&](std::size_t begin, std::size_t end, int) {
        chunks[begin / kChunkPoints] =
            laz::encode_chunk(layout(), points_.data() + begin * record_, end - begin);
      });
      for (const std::vector<std::uint8_t>& chunk : chunks) {
        file_.write(chunk.data(), chunk.size());
        sizes_.push_back({kChunkPoints, static_cast<std::uint32_t>(chunk.size())});
        table_ += chunk.size();
      }
    } else {
      file_.write(points_.data(), count * record_);
    }
    std::copy(points_.begin() + static_cast<std::ptrdiff_t>(count * record_), points_.end(),
              points_.begin());
    points_.resize(points_.size() - count * record_);
  }

  void write_chunk_table() {
    const std::vector<std::uint8_t> bytes = laz::encode_chunk_table(sizes_, false);
    file_.write(bytes.data(), bytes.size());
    file_.write_at(begin_, &table_, sizeof(table_));
  }

  std::string header() const {
    const bool narrow_count =
        !extended() && survey_.count <= std::numeric_limits<std::uint32_t>::max();
    FieldBytes out;
    out.add_text("LASF", 4);
    out.add(std::uint16_t{0});
    out.add(global_encoding());
    out.add_text("", 16);
    out.add(std::uint8_t{1});
    out.add(static_cast<std::uint8_t>(extended() ? 4 : 2));
    out.add_text("OTHER", 32);
    out.add_text(std::string("surfelkit ") + version(), 32);
    out.add(std::uint32_t{0});  // The day of its making: the same bytes every day.
    out.add(static_cast<std::uint16_t>(header_bytes()));
    out.add(static_cast<std::uint32_t>(begin_));
    out.add(block_count_);
    out.add(static_cast<std::uint8_t>(format_ | (compressed_ ? 0x80 : 0)));
    out.add(static_cast<std::uint16_t>(record_));
    out.add(static_cast<std::uint32_t>(narrow_count ? survey_.count : 0));
    for (std::size_t k = 1; k <= 5; ++k) {
      out.add(static_cast<std::uint32_t>(narrow_count ? counts_.returns[k] : 0));
    }
    for (const Vec3d& v : {scale_, offset_}) {
      for (const double value : v) out.add(value);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      const auto world = [&](std::int32_t step) { return step * scale_[axis] + offset_[axis]; };
      // A negative scale turns the order around.
      const double a = survey_.count == 0 ? 0 : world(counts_.most[k]);
      const double b = survey_.count == 0 ? 0 : world(counts_.least[k]);
      out.add(std::max(a, b));
      out.add(std::min(a, b));
    }
    if (!extended()) return out.all();
    out.add_text("", 20);  // No waveforms, no blocks behind the points.
    out.add(survey_.count);
    for (std::size_t k = 1; k <= 15; ++k) out.add(counts_.returns[k]);
    return out.all();
  }

  std::uint16_t global_encoding() const {
    constexpr unsigned kWkt = 16;
    constexpr unsigned kWaveforms = 6;
    unsigned bits = las_ ? las_->global_encoding & ~kWaveforms : 0;
    const bool wkt =
        las_ && std::any_of(las_->records.begin(), las_->records.end(), [](const LasRecord& r) {
          return r.user == "LASF_Projection" && r.id == 2112;
        });
    if (extended() && wkt) bits |= kWkt;
    return static_cast<std::uint16_t>(bits);
  }

  static constexpr std::size_t kBlock = 4096;  ///< Points that one thread makes at a time.

  const std::string path_;
  bool compressed_;
  const CloudSurvey& survey_;
  OutputFile file_;
  bool open_ = false;
  std::optional<LasStorage> las_;
  std::vector<RecordColumn> columns_;
  bool colored_ = false;
  int format_ = 0;
  std::size_t record_ = 0;  ///< FieldBytes of a point.
  std::array<RecordColumn, 3> position_;
  std::vector<RecordColumn> colors_;
  std::vector<Filled> filled_;
  std::vector<Extra> extra_;
  std::vector<std::string> names_;  ///< Of the fields and the extra bytes.
  std::byte returns_{0};            ///< What no column says of the number of the return: the first.
  Vec3d scale_;
  double tolerance_ = 0;  ///< Less than this changes no coordinate: its digits are a float's.
  Vec3d offset_;
  FieldBytes blocks_;
  std::uint32_t block_count_ = 0;
  Counts counts_;
  Array<std::byte> points_;  ///< Made, and not written yet.
  std::uint64_t written_ = 0;
  std::uint64_t begin_ = 0;  ///< Where the points begin.
  std::uint64_t table_ = 0;  ///< Where the chunks that are written end.
  std::vector<laz::ChunkSize> sizes_;
};

LasWriter::LasWriter(std::string path, const CloudSurvey& survey, bool no_clobber)
    : impl_(std::make_unique<Impl>(std::move(path), survey, no_clobber)) {}
LasWriter::~LasWriter() = default;

void LasWriter::append(const SurfelCloud& piece, const std::vector<std::string>& comments) {
  impl_->append(piece, comments);
}

std::vector<std::string> LasWriter::commit() { return impl_->commit(); }

}  // namespace surfel
