#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

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
#include <surfel/io/las_writer.h>
#include <surfel/io/laz_points.h>
#include <surfel/io/surfel_decoder.h>
#include <surfel/io/text_scanner.h>
#include <surfel/laz/chunk_table.h>
#include <surfel/laz/laz_chunk.h>

namespace surfel {
namespace {

constexpr std::size_t kMostBlockBytes = 65535;
constexpr std::uint32_t kChunkPoints = 50000;  ///< As LASzip's own, which readers are made for.

/// Bytes of a header or block, little-endian.
class Bytes {
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

/// A column of the cloud that goes into a field of the points.
struct Filled {
  RecordColumn column;
  LasField field;
};

/// A column of the cloud that becomes extra bytes.
struct Extra {
  RecordColumn column;
  std::size_t offset;  ///< In a point.
};

class LasWriter {
 public:
  LasWriter(const SurfelCloud& cloud, const std::string& path, bool no_clobber,
            const std::vector<std::string>& comments)
      : cloud_(cloud),
        path_(path),
        compressed_(lower_extension(path) == ".laz"),
        records_(cloud, {}),
        file_(path, no_clobber) {
    choose_format();
    place_columns();
    choose_steps();
    add_blocks(comments);
  }

  void write() {
    const std::size_t begin = header_bytes() + blocks_.all().size();
    file_.reserve(begin);
    compressed_ ? write_chunks(begin) : write_points();
    const std::string head = header(begin) + blocks_.all();
    file_.write_at(0, head.data(), head.size());
    file_.commit();
  }

 private:
  bool extended() const { return format_ >= 6; }
  std::size_t header_bytes() const { return extended() ? 375 : 227; }
  bool has(std::string_view name) const {
    return std::any_of(records_.columns().begin(), records_.columns().end(),
                       [&](const RecordColumn& column) { return column.name == name; });
  }

  void choose_format() {
    const int was = cloud_.las ? cloud_.las->point_format : 0;
    const bool was_colored = las_color_offset(was) > 0;
    const bool colored = !cloud_.color.empty() || was_colored;
    const bool wide = cloud_.size() > std::numeric_limits<std::uint32_t>::max();
    const bool more = was >= 6 || wide || has("nir") || has("scan_angle") || has("overlap") ||
                      has("scanner_channel");
    if (more) {
      format_ = has("nir") ? 8 : colored ? 7 : 6;
    } else {
      format_ = (has("gps_time") ? 1 : 0) + (colored ? 2 : 0);
    }
  }

  /// Calls visit(values) for all values of a column, some thousands at a time, in parallel.
  template <class Visit>
  void visit_values(const RecordColumn& column, const Visit& visit) const {
    parallel_for(cloud_.size(), kBlock, [&](std::size_t begin, std::size_t end, int) {
      Array<std::byte> bytes((end - begin) * records_.stride());
      records_.encode(begin, end, bytes.data());
      visit_type(column.type, [&]<class T>(T) {
        const std::byte* at = bytes.data() + column.offset;
        for (std::size_t i = begin; i < end; ++i, at += records_.stride()) {
          visit(load_scalar<T, false>(at));
        }
      });
    });
  }

  /// Can a field hold all values of a column?
  bool fits(const RecordColumn& column, const LasField& field) const {
    if (column.type == field.type && field.bits == 0) return true;
    std::atomic<bool> all = true;
    visit_type(field.type, [&]<class Field>(Field) {
      visit_values(column, [&](auto value) {
        const bool fit = representable<Field>(value) &&
                         (field.bits == 0 || static_cast<double>(value) < (1 << field.bits));
        if (!fit) all = false;
      });
    });
    return all;
  }

  /// Finds a field or extra bytes for each column.
  void place_columns() {
    const std::vector<LasField> fields = las_fields(format_);
    record_ = layout().format_bytes();
    for (const RecordColumn& column : records_.columns()) {
      const std::string_view name = column.name;
      if (name == "x" || name == "y" || name == "z") continue;
      if (name == "red" || name == "green" || name == "blue") {
        colors_.push_back(column);
        continue;
      }
      const auto field = std::find_if(fields.begin(), fields.end(),
                                      [&](const LasField& f) { return name == f.name; });
      if (field != fields.end() && fits(column, *field)) {
        filled_.push_back({column, *field});
      } else {
        extra_.push_back({column, record_});
        record_ += scalar_size(column.type);
      }
    }
    if (record_ > std::numeric_limits<std::uint16_t>::max()) {
      throw_input(path_, "a point has more than the 65,535 bytes that LAS allows; write PLY");
    }
    const auto find = [&](std::string_view name) -> const RecordColumn* {
      for (const RecordColumn& column : records_.columns()) {
        if (column.name == name) return &column;
      }
      return nullptr;
    };
    for (std::size_t k = 0; k < 3; ++k) {
      position_[k] = *find(std::array{"x", "y", "z"}[k]);
    }
    returns_ = std::any_of(filled_.begin(), filled_.end(), [](const Filled& filled) {
      return std::string_view(filled.field.name) == "return_number";
    });
  }

  /// Can the steps tell all positions?
  static bool reaches(const Vec3d& scale, const Vec3d& offset, const Bounds& box) {
    constexpr double kMost = std::numeric_limits<std::int32_t>::max();
    const auto in_reach = [&](const Vec3d& corner) {
      return ((corner - offset).array() / scale.array()).abs().maxCoeff() < kMost;
    };
    return in_reach(box.min) && in_reach(box.max);
  }

  void choose_steps() {
    for (std::size_t i = 0; i < cloud_.size(); ++i) {
      if (cloud_.position[i].allFinite()) continue;
      throw_input(path_,
                  fmt::format("surfel {} has a position that is not finite, which LAS cannot "
                              "tell; leave it out or write PLY",
                              i));
    }
    const Bounds box = cloud_.bounds();
    if (cloud_.las) {
      scale_ = cloud_.las->scale;
      offset_ = cloud_.las->offset;
      if (box.empty() || reaches(scale_, offset_, box)) return;
    }
    if (cloud_.decimals && !box.empty()) {
      scale_ = Vec3d::Constant(1 / power_of_ten(*cloud_.decimals));
      offset_ = cloud_.origin.array().round();
      if (reaches(scale_, offset_, box)) return;
    }
    // Floats that far from the origin have 24 bits.
    const double reach = box.empty() ? 0
                                     : std::max((box.max - cloud_.origin).cwiseAbs().maxCoeff(),
                                                (box.min - cloud_.origin).cwiseAbs().maxCoeff());
    const double step =
        reach > 0 ? portable::pow(10.0, std::floor(portable::log10(reach * 0x1p-24))) : 1e-3;
    scale_ = Vec3d::Constant(step);
    offset_ = cloud_.origin;
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
    Bytes bytes;
    for (const Extra& extra : extra_) {
      bytes.add(std::uint16_t{0});
      bytes.add(kTypes[static_cast<std::size_t>(extra.column.type)]);
      bytes.add(std::uint8_t{0});
      bytes.add_text(extra.column.name, 32);
      bytes.add_text("", 156);
    }
    return bytes.all();
  }

  void add_blocks(const std::vector<std::string>& comments) {
    if (cloud_.las) {
      for (const LasRecord& block : cloud_.las->records) {
        add_block(block.user, block.id, block.description, block.bytes);
      }
    }
    if (!extra_.empty()) {
      const std::string descriptions = extra_descriptions();
      if (descriptions.size() > kMostBlockBytes) {
        throw_input(path_, fmt::format("{} columns are more than LAS can describe; write PLY",
                                       extra_.size()));
      }
      add_block("LASF_Spec", 4, "extra bytes", descriptions);
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

  /// Makes the points [begin, end) and counts them.
  void make_points(std::size_t begin, std::size_t end, std::byte* points, Counts& counts) const {
    static thread_local Array<std::byte> scratch;
    if (scratch.size() < (end - begin) * records_.stride()) {
      scratch.resize((end - begin) * records_.stride());
    }
    records_.encode(begin, end, scratch.data());
    std::memset(points, 0, (end - begin) * record_);
    const std::byte* record = scratch.data();
    const std::size_t color = las_color_offset(format_);
    for (std::size_t i = begin; i < end; ++i, record += records_.stride(), points += record_) {
      make_position(record, points, counts);
      if (!returns_) points[14] = extended() ? std::byte{0x11} : std::byte{0x09};
      for (const Filled& filled : filled_) fill(filled, record, points);
      for (std::size_t k = 0; k < colors_.size(); ++k) {
        const auto code =
            static_cast<std::uint16_t>(color_code(colors_[k], record, cloud_.las.has_value()));
        std::memcpy(points + color + 2 * k, &code, sizeof(code));
      }
      for (std::size_t k = 0; k < extra_.size(); ++k) {
        std::memcpy(points + extra_[k].offset, record + extra_[k].column.offset,
                    scalar_size(extra_[k].column.type));
      }
      ++counts.returns[std::to_integer<std::size_t>(points[14]) & (extended() ? 15 : 7)];
    }
  }

  void make_position(const std::byte* record, std::byte* point, Counts& counts) const {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      const std::byte* at = record + position_[k].offset;
      const double world = position_[k].type == ScalarType::kFloat32
                               ? static_cast<double>(load_scalar<float, false>(at))
                               : load_scalar<double, false>(at);
      const auto step =
          static_cast<std::int32_t>(std::llround((world - offset_[axis]) / scale_[axis]));
      std::memcpy(point + 4 * k, &step, sizeof(step));
      counts.least[k] = std::min(counts.least[k], step);
      counts.most[k] = std::max(counts.most[k], step);
    }
  }

  static void fill(const Filled& filled, const std::byte* record, std::byte* point) {
    const LasField& field = filled.field;
    visit_type(filled.column.type, [&]<class T>(T) {
      const T value = load_scalar<T, false>(record + filled.column.offset);
      if (field.bits > 0) {
        point[field.offset] |= static_cast<std::byte>(static_cast<unsigned>(value) << field.shift);
        return;
      }
      visit_type(field.type, [&]<class Field>(Field) {
        const auto stored = static_cast<Field>(value);
        std::memcpy(point + field.offset, &stored, sizeof(stored));
      });
    });
  }

  void merge(const Counts& counts) {
    for (std::size_t k = 0; k < 3; ++k) {
      counts_.least[k] = std::min(counts_.least[k], counts.least[k]);
      counts_.most[k] = std::max(counts_.most[k], counts.most[k]);
    }
    for (std::size_t k = 0; k < counts.returns.size(); ++k) {
      counts_.returns[k] += counts.returns[k];
    }
  }

  void write_points() {
    const std::uint64_t begin = file_.reserve(std::uint64_t{cloud_.size()} * record_);
    std::vector<Counts> counts(cloud_.size() / kBlock + 1);
    PerWorker<Array<std::byte>> buffers;
    ProgressStage stage("writing", cloud_.size(), "surfels");
    parallel_for(cloud_.size(), kBlock, [&](std::size_t first, std::size_t end, int worker) {
      Array<std::byte>& points = buffers[worker];
      points.resize(kBlock * record_);
      make_points(first, end, points.data(), counts[first / kBlock]);
      file_.write_at(begin + first * record_, points.data(), (end - first) * record_);
      stage.add(end - first);
    });
    for (const Counts& part : counts) merge(part);
  }

  /// Writes some chunks at a time: threads compress them, then they are written in order.
  void write_chunks(std::uint64_t begin) {
    constexpr std::size_t kAtOnce = 64;
    std::vector<laz::ChunkSize> sizes;
    std::uint64_t table = begin + sizeof(std::uint64_t);
    file_.reserve(sizeof(table));
    ProgressStage stage("writing", cloud_.size(), "surfels");
    for (std::size_t first = 0; first < cloud_.size(); first += kAtOnce * kChunkPoints) {
      const std::size_t part = std::min<std::size_t>(kAtOnce * kChunkPoints, cloud_.size() - first);
      std::vector<std::vector<std::uint8_t>> chunks((part + kChunkPoints - 1) / kChunkPoints);
      std::vector<Counts> counts(chunks.size());
      parallel_for(part, kChunkPoints, [&](std::size_t from, std::size_t to, int) {
        static thread_local Array<std::byte> points;
        points.resize((to - from) * record_);
        const std::size_t k = from / kChunkPoints;
        make_points(first + from, first + to, points.data(), counts[k]);
        chunks[k] = laz::encode_chunk(layout(), points.data(), to - from);
        stage.add(to - from);
      });
      for (std::size_t k = 0; k < chunks.size(); ++k) {
        merge(counts[k]);
        file_.write(chunks[k].data(), chunks[k].size());
        sizes.push_back({kChunkPoints, static_cast<std::uint32_t>(chunks[k].size())});
        table += chunks[k].size();
      }
    }
    const std::vector<std::uint8_t> bytes = laz::encode_chunk_table(sizes, false);
    file_.write(bytes.data(), bytes.size());
    file_.write_at(begin, &table, sizeof(table));
  }

  std::string header(std::size_t begin) const {
    const bool narrow_count =
        !extended() && cloud_.size() <= std::numeric_limits<std::uint32_t>::max();
    Bytes out;
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
    out.add(static_cast<std::uint32_t>(begin));
    out.add(block_count_);
    out.add(static_cast<std::uint8_t>(format_ | (compressed_ ? 0x80 : 0)));
    out.add(static_cast<std::uint16_t>(record_));
    out.add(static_cast<std::uint32_t>(narrow_count ? cloud_.size() : 0));
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
      const double a = cloud_.empty() ? 0 : world(counts_.most[k]);
      const double b = cloud_.empty() ? 0 : world(counts_.least[k]);
      out.add(std::max(a, b));
      out.add(std::min(a, b));
    }
    if (!extended()) return out.all();
    out.add_text("", 20);  // No waveforms, no blocks behind the points.
    out.add(std::uint64_t{cloud_.size()});
    for (std::size_t k = 1; k <= 15; ++k) out.add(counts_.returns[k]);
    return out.all();
  }

  std::uint16_t global_encoding() const {
    constexpr unsigned kWkt = 16;
    constexpr unsigned kWaveforms = 6;
    unsigned bits = cloud_.las ? cloud_.las->global_encoding & ~kWaveforms : 0;
    const bool wkt = cloud_.las && std::any_of(cloud_.las->records.begin(),
                                               cloud_.las->records.end(), [](const LasRecord& r) {
                                                 return r.user == "LASF_Projection" && r.id == 2112;
                                               });
    if (extended() && wkt) bits |= kWkt;
    return static_cast<std::uint16_t>(bits);
  }

  static constexpr std::size_t kBlock = 4096;  ///< Points that one thread makes at a time.

  const SurfelCloud& cloud_;
  const std::string& path_;
  bool compressed_;
  CloudRecords records_;
  OutputFile file_;
  int format_ = 0;
  std::size_t record_ = 0;  ///< Bytes of a point.
  std::array<RecordColumn, 3> position_;
  std::vector<RecordColumn> colors_;
  std::vector<Filled> filled_;
  std::vector<Extra> extra_;
  bool returns_ = false;  ///< A column tells the number of the return.
  Vec3d scale_;
  Vec3d offset_;
  Bytes blocks_;
  std::uint32_t block_count_ = 0;
  Counts counts_;
};

}  // namespace

void write_las(const SurfelCloud& cloud, const std::string& path, bool no_clobber,
               const std::vector<std::string>& comments) {
  LasWriter(cloud, path, no_clobber, comments).write();
}

}  // namespace surfel
