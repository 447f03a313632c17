#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/version.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/compressed_ply.h>
#include <surfel/io/e57.h>
#include <surfel/io/e57_header.h>
#include <surfel/io/expe.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/gaussian_ply.h>
#include <surfel/io/input_file.h>
#include <surfel/io/las.h>
#include <surfel/io/las_header.h>
#include <surfel/io/las_writer.h>
#include <surfel/io/pcd.h>
#include <surfel/io/ply.h>
#include <surfel/io/ptx.h>
#include <surfel/io/range_grid.h>
#include <surfel/io/spz.h>
#include <surfel/io/text_records.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/tree_records.h>
#include <surfel/io/volume_io.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

constexpr std::string_view kVersionComment = "surfel ";
constexpr std::string_view kBasisComment = "surfel_basis ";
constexpr std::string_view kProvenanceComment = "surfel_provenance ";
constexpr std::string_view kViewpointComment = "surfel_viewpoint ";
constexpr std::string_view kScanViewpointComment = "surfel_scan_viewpoint ";
constexpr std::string_view kUpComment = "surfel_up ";
constexpr std::string_view kColorComment = "surfel_color ";
constexpr std::string_view kLasComment = "surfel_las ";
constexpr std::array<std::pair<std::string_view, ColorLight>, 3> kColorLights{
    {{"recorded", ColorLight::kRecorded},
     {"reflectance", ColorLight::kReflectance},
     {"mixed", ColorLight::kMixed}}};

/// Blank-separated numbers, exactly as many as `values` has; false if they are not there.
bool parse_numbers(std::string_view text, std::span<double> values) {
  TextScanner words({}, text);
  for (double& value : values) {
    const auto number = parse_number(words.word());
    if (!number) return false;
    value = *number;
  }
  return words.at_line_end();
}

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  return text;
}

/// The reverse of read_comments(). PCD has a header line of its own for the viewpoint, which means
/// unknown where it is the default; a sensor that stood there needs the comment.
std::vector<std::string> write_comments(const SurfelCloud& cloud, bool pcd) {
  const bool with_viewpoint = !pcd || (cloud.viewpoint && is_default(*cloud.viewpoint));
  std::vector<std::string> lines{std::string(kVersionComment) + version()};
  if (cloud.basis_cutoff) lines.push_back(fmt::format("{}{}", kBasisComment, *cloud.basis_cutoff));
  const auto add_view = [&](std::string_view name, const Viewpoint& view) {
    lines.push_back(fmt::format("{}{} {}", name, fmt::join(view.position, " "),
                                fmt::join(view.orientation, " ")));
  };
  if (with_viewpoint && cloud.viewpoint) add_view(kViewpointComment, *cloud.viewpoint);
  for (const Viewpoint& view : cloud.scan_viewpoints) add_view(kScanViewpointComment, view);
  if (cloud.up) {
    lines.push_back(fmt::format("{}{}", kUpComment, fmt::join(*cloud.up, " ")));
  }
  for (const auto& [name, light] : kColorLights) {
    if (cloud.color_light == light) lines.push_back(fmt::format("{}{}", kColorComment, name));
  }
  for (const std::string& line : cloud.provenance) {
    lines.push_back(std::string(kProvenanceComment) + one_line(line));
  }
  for (const std::string& line : cloud.comments) lines.push_back(one_line(line));
  return lines;
}

/// How a LAS file stored the points, for a later LAS file.
std::string las_comment(const LasStorage& las) {
  return fmt::format("{}{} {} {} {}", kLasComment, fmt::join(las.scale, " "),
                     fmt::join(las.offset, " "), las.point_format, las.global_encoding);
}

/// The comments of a file that is no LAS file.
std::vector<std::string> file_comments(const SurfelCloud& cloud, bool pcd) {
  std::vector<std::string> comments = write_comments(cloud, pcd);
  if (cloud.las) comments.push_back(las_comment(*cloud.las));
  return comments;
}

LasStorage parse_las_comment(std::string_view text, const std::string& file) {
  double numbers[8];
  const bool all = parse_numbers(text.substr(kLasComment.size()), numbers);
  const Vec3d scale(numbers);
  const Vec3d offset(numbers + 3);
  if (!all || !scale.allFinite() || (scale.array() == 0).any() || !offset.allFinite() ||
      !representable<std::uint8_t>(numbers[6]) || numbers[6] > 10 ||
      !representable<std::uint16_t>(numbers[7])) {
    throw_input(file, "the header comment " + quoted_excerpt(text) +
                          " has not a scale, an offset, a point format and an encoding");
  }
  return {.scale = scale,
          .offset = offset,
          .point_format = static_cast<int>(numbers[6]),
          .global_encoding = static_cast<std::uint16_t>(numbers[7]),
          .records = {}};
}

/// \param name  The words of the comment before its numbers.
Viewpoint parse_viewpoint(std::string_view text, std::string_view name, const std::string& file) {
  double view[7];
  if (!parse_numbers(text.substr(name.size()), view)) {
    throw_input(file, "the header comment " + quoted_excerpt(text) + " has not seven numbers");
  }
  return {Vec3d(view), Eigen::Vector4d(view + 3)};
}

class PcdPoints final : public PointRecords {
 public:
  explicit PcdPoints(InputFile input) : name_(input.name()), pcd_(std::move(input)) {}

  const RecordTable& table() const override { return pcd_.records(); }
  const std::string& file() const override { return name_; }
  bool double_positions() const override { return pcd_.double_positions(); }
  void describe(SurfelCloud& cloud) const override {
    cloud.viewpoint = pcd_.viewpoint();
    read_comments(pcd_.comments(), name_, cloud);
  }

 private:
  std::string name_;
  PcdFile pcd_;
};

/// The points of a PLY file; without its coarser levels of detail unless the options ask for them.
class PlyPoints final : public PointRecords {
 public:
  /// Keeps a reference to the file.
  PlyPoints(PlyFile& ply, const CloudReadOptions& options) : ply_(ply) {
    const PlyElement* vertex = ply.header().find("vertex");
    if (!vertex) throw_input(ply.name(), "holds no points: it has no element 'vertex'");
    const PlyProperty* x = vertex->find("x");
    double_positions_ = x && x->type == ScalarType::kFloat64;
    table_ = ply.scalars("vertex", {"x", "y", "z"});
    if (ply.header().find(kTreeElement)) {
      levels_ = tree_from_records(ply.scalars(kTreeElement), table_.count, ply.name());
      if (!options.levels) coarser_ = levels_->tree[first_leaf(levels_->tree)].begin;
    }
    // The finest level is the last.
    table_.skip(coarser_);
    table_.stepped =
        std::any_of(ply.header().comments.begin(), ply.header().comments.end(),
                    [](const std::string& comment) { return comment.starts_with(kLasComment); });
    all_levels_ = levels_ && options.levels;
  }

  const RecordTable& table() const override { return table_; }
  const std::string& file() const override { return ply_.name(); }
  bool double_positions() const override { return double_positions_; }
  void describe(SurfelCloud& cloud) const override {
    if (levels_ && !all_levels_) {
      cloud.level = {};
      cloud.coarser_skipped = coarser_;
    }
    read_comments(ply_.header().comments, ply_.name(), cloud);
    for (const PlyElement& element : ply_.header().elements) {
      const bool read =
          element.name == "vertex" || element.name == kTreeElement || element.name == "range_grid";
      if (!read && element.count > 0) {
        cloud.skipped_elements.emplace_back(element.name, element.count);
      }
    }
  }
  SurfelCloud read_all() {
    SurfelCloud cloud = PointRecords::read_all();
    if (all_levels_) cloud.tree = recentered_tree(*std::move(levels_), cloud.origin);
    if (!cloud.viewpoint) cloud.viewpoint = range_grid_viewpoint(ply_, cloud);
    return cloud;
  }

 private:
  PlyFile& ply_;
  RecordTable table_;
  std::optional<TreeRecords> levels_;
  std::size_t coarser_ = 0;
  bool double_positions_ = false;
  bool all_levels_ = false;
};

/// The points of a PLY file of its own, which can be read in pieces.
class OwnPlyPoints final : public PointRecords {
 public:
  OwnPlyPoints(PlyFile ply, const CloudReadOptions& options)
      : ply_(std::move(ply)), points_(ply_, options) {}

  const RecordTable& table() const override { return points_.table(); }
  const std::string& file() const override { return points_.file(); }
  bool double_positions() const override { return points_.double_positions(); }
  void describe(SurfelCloud& cloud) const override { points_.describe(cloud); }

 private:
  PlyFile ply_;
  PlyPoints points_;
};

/// Records that one thread makes at a time: they fit into its cache.
constexpr std::size_t kWriteBlock = 4096;

/// Each thread writes what it has made: one makes while another writes.
void write_binary(const CloudRecords& records, std::size_t count, OutputFile& file) {
  const std::size_t stride = records.stride();
  const std::uint64_t offset = file.reserve(std::uint64_t{count} * stride);
  PerWorker<Array<std::byte>> buffers;
  ProgressStage stage("writing", count, "surfels");
  parallel_for(count, kWriteBlock, [&](std::size_t begin, std::size_t end, int worker) {
    Array<std::byte>& buffer = buffers[worker];
    buffer.resize(kWriteBlock * stride);
    records.encode(begin, end, buffer.data());
    file.write_at(offset + begin * stride, buffer.data(), (end - begin) * stride);
    stage.add(end - begin);
  });
}

/// Writes some blocks of surfels at a time: threads make their text, then it is written in order.
/// \param text_of  text_of(begin, end) is the text of the surfels [begin, end).
template <class TextOf>
void write_text(std::size_t count, const TextOf& text_of, OutputFile& file) {
  constexpr std::size_t kChunk = 64 * kWriteBlock;  // Blocks for all threads, in little memory.
  std::vector<std::string> texts(kChunk / kWriteBlock);
  ProgressStage stage("writing", count, "surfels");
  for (std::size_t first = 0; first < count; first += kChunk) {
    const std::size_t chunk = std::min(kChunk, count - first);
    parallel_for(chunk, kWriteBlock, [&](std::size_t begin, std::size_t end, int) {
      texts[begin / kWriteBlock] = text_of(first + begin, first + end);
    });
    for (std::size_t k = 0; k * kWriteBlock < chunk; ++k) file.write(texts[k]);
    stage.add(chunk);
  }
}

void write_text(const CloudRecords& records, std::size_t count, char separator, OutputFile& file) {
  const auto text_of = [&](std::size_t begin, std::size_t end) {
    Array<std::byte> bytes((end - begin) * records.stride());
    records.encode(begin, end, bytes.data());
    std::string text;
    for (std::size_t i = 0; i < end - begin; ++i) {
      append_record(bytes.data() + i * records.stride(), records.columns(), separator, text);
    }
    return text;
  };
  write_text(count, text_of, file);
}

void write_tree(const SurfelCloud& cloud, bool ascii, OutputFile& file) {
  const std::vector<RecordColumn> columns = tree_columns();
  const Array<std::byte> bytes = tree_to_records(cloud.tree, cloud.origin);
  if (!ascii) return file.write(bytes.data(), bytes.size());
  const std::size_t stride = bytes.size() / cloud.tree.size();
  std::string text;
  for (std::size_t i = 0; i < cloud.tree.size(); ++i) {
    append_record(bytes.data() + i * stride, columns, ' ', text);
  }
  file.write(text);
}

}  // namespace

std::string cloud_ply_header(const SurfelCloud& cloud, const std::vector<RecordColumn>& columns,
                             std::size_t count, std::size_t clusters, bool ascii) {
  std::string header = "ply\n";
  header += ascii ? "format ascii 1.0\n" : "format binary_little_endian 1.0\n";
  for (const std::string& comment : file_comments(cloud, false)) {
    header += "comment " + comment + "\n";
  }
  header += ply_element("vertex", columns, count);
  if (clusters > 0) header += ply_element(kTreeElement, tree_columns(), clusters);
  return header + "end_header\n";
}

void read_comments(const std::vector<std::string>& comments, const std::string& file,
                   SurfelCloud& cloud) {
  for (const std::string& comment : comments) {
    const std::string_view text = comment;
    if (text.starts_with(kProvenanceComment)) {
      cloud.provenance.emplace_back(text.substr(kProvenanceComment.size()));
    } else if (text.starts_with(kBasisComment)) {
      double cutoff = 0;
      if (!parse_numbers(text.substr(kBasisComment.size()), {&cutoff, 1}) || !(cutoff > 0)) {
        throw_input(file, "the header comment " + quoted_excerpt(text) + " has no cutoff > 0");
      }
      cloud.basis_cutoff = cutoff;
    } else if (text.starts_with(kViewpointComment)) {
      cloud.viewpoint = parse_viewpoint(text, kViewpointComment, file);
    } else if (text.starts_with(kScanViewpointComment)) {
      cloud.scan_viewpoints.push_back(parse_viewpoint(text, kScanViewpointComment, file));
    } else if (text.starts_with(kUpComment)) {
      double up[3];
      const bool numbers = parse_numbers(text.substr(kUpComment.size()), up);
      if (!numbers || !Vec3d(up).allFinite() || !(Vec3d(up).norm() > 0)) {
        throw_input(file, "the header comment " + quoted_excerpt(text) + " has no direction");
      }
      cloud.up = Vec3d(up).normalized();
    } else if (text.starts_with(kLasComment)) {
      cloud.las = parse_las_comment(text, file);
    } else if (text.starts_with(kColorComment)) {
      const std::string_view said = text.substr(kColorComment.size());
      const auto* const known =
          std::find_if(kColorLights.begin(), kColorLights.end(),
                       [&](const auto& light) { return light.first == said; });
      if (known == kColorLights.end()) {
        throw_input(file, "the header comment " + quoted_excerpt(text) +
                              " says neither recorded, reflectance nor mixed");
      }
      cloud.color_light = known->second;
    } else if (!text.starts_with(kVersionComment)) {
      cloud.comments.push_back(comment);
    }
  }
}

SurfelCloud read_cloud(PlyFile& ply, const CloudReadOptions& options) {
  return PlyPoints(ply, options).read_all();
}

namespace {

/// Where a scanner stood may be told by all points only.
bool needs_all_points(const PlyFile& ply) { return ply.header().find("range_grid") != nullptr; }

/// Opens a file and hands its points to one of two functions.
/// \param in_records  gets a pointer to PointRecords, where points can be read in pieces
/// \param whole       gets all points as a cloud
template <class InRecords, class Whole>
void open_points(InputFile input, const CloudReadOptions& options, const InRecords& in_records,
                 const Whole& whole) {
  const std::string name = input.name();
  if (input.size() == 0) throw_input(name, "is empty; make it anew");
  const bool text = is_xyz_name(name) && !is_expe(input);
  if (!options.columns.empty() && !text) {
    throw_input(name, "is no text file, whose columns can be named; leave out `columns`");
  }
  if (LasHeader::matches(input.head(4))) {
    return in_records(std::make_unique<LasPoints>(std::move(input), options));
  }
  if (options.level) {
    throw_input(name, "is no COPC file, whose points have levels; leave out `level`");
  }
  if (E57Header::matches(input.head(8))) {
    return in_records(std::make_unique<E57Points>(std::move(input)));
  }
  if (is_expe(input)) return whole(read_expe(input));
  if (PlyFile::matches(input.head(4))) {
    PlyFile ply(std::move(input));
    if (has_trained_gaussians(ply.header()) || has_packed_gaussians(ply.header())) {
      refuse_gaussians(name);
    }
    if (options.levels || needs_all_points(ply)) return whole(read_cloud(ply, options));
    return in_records(std::make_unique<OwnPlyPoints>(std::move(ply), options));
  }
  if (PcdFile::matches(input.head(PcdFile::kMatched))) {
    return in_records(std::make_unique<PcdPoints>(std::move(input)));
  }
  if (lower_extension(name) == ".ply")
    throw_input(name, "is not a PLY file: it does not start with 'ply'");
  if (lower_extension(name) == ".pcd") throw_input(name, "is not a PCD file: it has no PCD header");
  if (is_las_name(name)) throw_input(name, "is not a LAS file: it does not start with 'LASF'");
  if (is_e57_name(name)) throw_input(name, "is not an E57 file: it does not start with 'ASTM-E57'");
  if (is_ptx_name(name)) return in_records(std::make_unique<PtxPoints>(std::move(input)));
  if (text) return in_records(std::make_unique<XyzPoints>(std::move(input), options.columns));
  if (is_mesh_name(name)) throw_input(name, "is a mesh; surfel-from-mesh makes surfels of it");
  if (is_image_name(name)) throw_input(name, "is a picture; surfels or points are needed");
  if (is_splat_name(name) || is_spz(input)) refuse_gaussians(name);
  if (is_volume_name(name)) refuse_volume(name);
  throw_input(name,
              "format not supported; surfels and points are read from PLY, PCD, LAS, LAZ, E57 "
              "and text (PTX, XYZ, PTS)" +
                  converter_advice(name));
}

/// Does the file hold its points as records of equal size?
bool stores_records(const PlyFile& ply) {
  const PlyElement* vertex = ply.header().find("vertex");
  return ply.header().format != PlyFormat::kAscii && vertex &&
         std::none_of(vertex->properties.begin(), vertex->properties.end(),
                      [](const PlyProperty& property) { return property.is_list(); });
}

/// The surfels of a cloud that the options ask for.
/// \param inside  counts the surfels within the bounds, of all pieces so far
Array<std::uint32_t> asked_for(const SurfelCloud& cloud, const CloudReadOptions& options,
                               std::uint64_t& inside) {
  Array<std::uint32_t> order;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (options.bounds && !options.bounds->contains(cloud.world(i))) continue;
    if (inside++ % options.every == 0) order.push_back(static_cast<std::uint32_t>(i));
  }
  return order;
}

bool takes_all(const CloudReadOptions& options) { return !options.bounds && options.every == 1; }

[[noreturn]] void throw_nothing_inside(const std::string& file) {
  throw_input(file, "holds no points within the `bounds`");
}

}  // namespace

std::vector<std::string> CloudReadOptions::problems() const {
  std::vector<std::string> found;
  if (level) check_option(found, *level >= 0, "level", *level, ">= 0");
  check_option(found, every >= 1, "every", every, ">= 1");
  if (bounds && !((bounds->max - bounds->min).minCoeff() > 0)) {
    found.emplace_back("`bounds` has no inside; give the lowest corner, then the highest");
  }
  for (auto name = columns.begin(); name != columns.end(); ++name) {
    const auto again = [&](const std::string& other) { return same_name(*name, other); };
    if (name->empty()) {
      found.emplace_back("`columns` has an empty name; give - for a column to be left out");
    } else if (*name != "-" && std::any_of(name + 1, columns.end(), again)) {
      found.push_back("`columns` has " + quoted_excerpt(*name) + " twice; name each column once");
    }
  }
  for (const char* needed : {"x", "y", "z"}) {
    const auto same = [&](const std::string& name) { return same_name(name, needed); };
    if (columns.empty() || std::any_of(columns.begin(), columns.end(), same)) continue;
    found.push_back(fmt::format("`columns` does not name {}; x, y and z are needed", needed));
  }
  return found;
}

SurfelCloud read_cloud(InputFile input, const CloudReadOptions& options) {
  require_usable(options);
  const std::string name = input.name();
  SurfelCloud cloud;
  open_points(
      std::move(input), options,
      [&](const std::unique_ptr<PointRecords>& points) { cloud = points->read_all(); },
      [&](SurfelCloud&& whole) { cloud = std::move(whole); });
  if (takes_all(options)) return cloud;
  std::uint64_t inside = 0;
  const Array<std::uint32_t> order = asked_for(cloud, options, inside);
  if (order.empty()) throw_nothing_inside(name);
  return cloud.gathered(order);
}

SurfelCloud read_cloud(const std::string& path, const CloudReadOptions& options) {
  return read_cloud(InputFile(path), options);
}

std::unique_ptr<PointRecords> open_records(InputFile input) {
  if (!input.regular() || !PlyFile::matches(input.head(4))) return nullptr;
  PlyFile ply(std::move(input));
  const bool gaussians = has_trained_gaussians(ply.header()) || has_packed_gaussians(ply.header());
  if (gaussians || needs_all_points(ply) || !stores_records(ply)) return nullptr;
  return std::make_unique<OwnPlyPoints>(std::move(ply), CloudReadOptions{});
}

struct CloudReader::Impl {
  std::string name;
  CloudReadOptions options;
  std::unique_ptr<PointRecords> points;
  std::unique_ptr<PieceReader> pieces;
  SurfelCloud whole;                ///< Of a file that is not read in pieces.
  std::optional<PointPlace> place;  ///< Of all points, once they were measured.

  std::size_t size() const { return pieces ? pieces->first(pieces->parts()) : whole.size(); }
  /// \param at  where the pieces are placed; null: each by itself
  void for_each(std::size_t most, const PointPlace* at,
                FunctionRef<void(SurfelCloud&& piece)> visit) const;
  void visit_asked_for(std::size_t most, const PointPlace* at,
                       FunctionRef<void(SurfelCloud piece)> visit) const;
};

/// Do offsets from the piece's origin tell all steps of a LAS file apart?
bool keeps_steps(const SurfelCloud& piece) {
  if (!piece.las) return true;
  const Bounds box = piece.bounds();
  return box.empty() ||
         ((box.max - box.min).array() / piece.las->scale.array()).abs().maxCoeff() < 0x1p24;
}

void CloudReader::Impl::for_each(std::size_t most, const PointPlace* at,
                                 FunctionRef<void(SurfelCloud&& piece)> visit) const {
  if (!pieces) {
    for (std::size_t begin = 0; begin < whole.size(); begin += most) {
      Array<std::uint32_t> order(std::min(most, whole.size() - begin));
      std::iota(order.begin(), order.end(), static_cast<std::uint32_t>(begin));
      visit(whole.gathered(order));
    }
    return;
  }
  for (std::size_t begin = 0; begin < pieces->parts();) {
    std::size_t end = begin + 1;
    while (end < pieces->parts() && pieces->first(end + 1) - pieces->first(begin) <= most) ++end;
    SurfelCloud piece = pieces->read(begin, end, at);
    if (!at && end - begin > 1 && !keeps_steps(piece)) {
      most = piece.size() / 2;
      continue;
    }
    begin = end;
    visit(std::move(piece));
  }
}

CloudReader::CloudReader(const std::string& path, const CloudReadOptions& options)
    : impl_(std::make_unique<Impl>()) {
  require_usable(options);
  InputFile input(path);
  impl_->name = input.name();
  impl_->options = options;
  open_points(
      std::move(input), options,
      [&](std::unique_ptr<PointRecords> points) { impl_->points = std::move(points); },
      [&](SurfelCloud&& whole) { impl_->whole = std::move(whole); });
  if (impl_->points) impl_->pieces = std::make_unique<PieceReader>(*impl_->points);
}
CloudReader::~CloudReader() = default;

SurfelCloud CloudReader::first() const {
  const Array<std::uint32_t> order{0};
  if (!impl_->pieces) return impl_->whole.gathered(order);
  const PieceReader& pieces = *impl_->pieces;
  std::size_t part = 0;
  while (pieces.first(part + 1) == 0) ++part;
  return pieces.read(part, part + 1).gathered(order);
}

void CloudReader::Impl::visit_asked_for(std::size_t most, const PointPlace* at,
                                        FunctionRef<void(SurfelCloud piece)> visit) const {
  std::uint64_t inside = 0;
  ProgressStage stage("reading " + name, size(), "points");
  for_each(most, at, [&](SurfelCloud&& piece) {
    const std::size_t count = piece.size();
    if (takes_all(options)) {
      visit(std::move(piece));
    } else {
      const Array<std::uint32_t> order = asked_for(piece, options, inside);
      if (!order.empty()) visit(piece.gathered(order));
    }
    stage.add(count);
  });
  if (!takes_all(options) && inside == 0) throw_nothing_inside(name);
}

void CloudReader::for_each(FunctionRef<void(SurfelCloud piece)> visit) const {
  constexpr std::size_t kPiece = std::size_t{1} << 18;
  impl_->visit_asked_for(kPiece, nullptr, visit);
}

void CloudReader::for_each_placed(std::size_t most,
                                  FunctionRef<void(SurfelCloud piece)> visit) const {
  if (impl_->pieces && !impl_->place) impl_->place = impl_->pieces->measure();
  impl_->visit_asked_for(most, impl_->place ? &*impl_->place : nullptr, visit);
}

std::uint64_t CloudReader::size() const { return impl_->size(); }

bool CloudReader::reads_pieces(const std::string& path) {
  InputFile input(path);
  if (!input.regular()) return false;
  if (LasHeader::matches(input.head(4)) || E57Header::matches(input.head(8))) return true;
  if (is_expe(input)) return false;
  if (PlyFile::matches(input.head(4))) {
    const PlyFile ply(std::move(input));
    return stores_records(ply) && !needs_all_points(ply);
  }
  if (PcdFile::matches(input.head(PcdFile::kMatched))) {
    // Binary bodies stay in the file, compressed and text bodies do not.
    const std::span<const std::byte> head = input.head(PcdFile::kMatched);
    const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
    const std::size_t body = text.find("\nDATA binary");
    return body != std::string_view::npos && !text.substr(body).starts_with("\nDATA binary_");
  }
  return is_xyz_name(path);
}

namespace {

/// How a file holds surfels, as its name says.
enum class CloudFormat { kPly, kPcd, kLas, kText, kObj };

CloudFormat format_of(const std::string& path) {
  const std::string extension = lower_extension(path);
  if (extension == ".pcd") return CloudFormat::kPcd;
  if (is_las_name(path)) return CloudFormat::kLas;
  if (extension == ".obj") return CloudFormat::kObj;
  return is_xyz_name(path) ? CloudFormat::kText : CloudFormat::kPly;
}

}  // namespace

struct CloudWriter::Impl {
  std::string path;
  std::size_t count;
  CloudWriteOptions options;
  CloudFormat format;
  std::optional<CloudSurvey> survey;
  std::optional<LasWriter> las;
  std::optional<OutputFile> file;
  std::vector<RecordColumn> columns;
  std::size_t written = 0;

  Impl(std::string to, std::size_t n, std::optional<CloudSurvey> all, const CloudWriteOptions& o)
      : path(std::move(to)), count(n), options(o), format(format_of(path)), survey(std::move(all)) {
    if (format != CloudFormat::kLas) {
      file.emplace(path, o.no_clobber);
    } else if (survey) {
      las.emplace(path, *survey, o.no_clobber);
    } else {
      throw_usage(fmt::format(
          "{}: LAS files are not written before all points are known; give a .ply", path));
    }
  }

  bool text() const {
    return format == CloudFormat::kText || (format == CloudFormat::kPly && options.ascii);
  }
  char separator() const {
    return format == CloudFormat::kText && lower_extension(path) == ".csv" ? ',' : ' ';
  }
  std::string header(const SurfelCloud& first) const {
    if (format == CloudFormat::kText) {
      // Without this word numbers up to 1 are read as sRGB.
      const bool linear =
          !first.color.empty() && first.color_encoding == ColorEncoding::kFloatLinear;
      if (linear) return "# colors are linear light\n" + column_line(columns, separator());
      const bool bare = lower_extension(path) == ".xyz" && are_known_columns(columns);
      return bare ? std::string() : column_line(columns, separator());
    }
    if (format == CloudFormat::kObj) return {};
    if (format == CloudFormat::kPcd) {
      return pcd_header(columns, count, first.viewpoint, file_comments(first, true));
    }
    return cloud_ply_header(first, columns, count, first.tree.size(), options.ascii);
  }
};

CloudWriter::CloudWriter(std::string path, std::size_t count, const CloudWriteOptions& options)
    : impl_(std::make_unique<Impl>(std::move(path), count, std::nullopt, options)) {}
CloudWriter::CloudWriter(std::string path, CloudSurvey survey, const CloudWriteOptions& options)
    : impl_(std::make_unique<Impl>(std::move(path), survey.count, std::move(survey), options)) {}
CloudWriter::~CloudWriter() = default;

void CloudWriter::append(const SurfelCloud& piece) {
  static_assert(std::endian::native == std::endian::little, "records are written as they are");
  Impl& w = *impl_;
  piece.check_columns(w.path);
  const bool levels = !piece.tree.empty();
  if (levels && w.format != CloudFormat::kPly) {
    throw_usage(fmt::format("{}: levels of detail are written to PLY only; give a .ply", w.path));
  }
  if (levels && piece.size() != w.count) {
    throw_input(w.path, "a cloud with levels of detail cannot be written in pieces");
  }
  if (w.las) return w.las->append(piece, write_comments(piece, false));
  const CloudRecords records(piece,
                             {.pcl_names = w.format == CloudFormat::kPcd, .for_text = w.text()});
  if (w.columns.empty()) {
    w.columns = records.columns();
    w.file->write(w.header(piece));
  }
  if (!same_columns(w.columns, records.columns()))
    throw_input(w.path, "pieces of the cloud differ in their columns");
  if (w.format == CloudFormat::kObj) {
    write_text(
        piece.size(),
        [&](std::size_t begin, std::size_t end) { return obj_points(piece, begin, end); }, *w.file);
  } else if (w.text()) {
    write_text(records, piece.size(), w.separator(), *w.file);
  } else {
    write_binary(records, piece.size(), *w.file);
  }
  if (levels) write_tree(piece, w.options.ascii, *w.file);
  w.written += piece.size();
}

void CloudWriter::commit() {
  if (impl_->las) return impl_->las->commit();
  if (impl_->written != impl_->count) {
    throw_input(impl_->path, fmt::format("{} surfels were promised and {} written", impl_->count,
                                         impl_->written));
  }
  impl_->file->commit();
}

std::vector<std::string> columns_left_out(const SurfelCloud& cloud, const std::string& path) {
  return format_of(path) == CloudFormat::kObj ? columns_without_place_in_obj(cloud)
                                              : std::vector<std::string>();
}

void write_cloud(const SurfelCloud& cloud, const std::string& path,
                 const CloudWriteOptions& options) {
  cloud.check_columns(path);
  CloudSurvey survey(path);
  survey.add(cloud);
  CloudWriter writer(path, std::move(survey), options);
  writer.append(cloud);
  writer.commit();
}

}  // namespace surfel
