#include <algorithm>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/progress.h>
#include <surfel/io/cloud_comments.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_io.h>
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
#include <surfel/io/pcd.h>
#include <surfel/io/ply.h>
#include <surfel/io/ptx.h>
#include <surfel/io/range_grid.h>
#include <surfel/io/spz.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/tree_records.h>
#include <surfel/io/volume_io.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

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
    table_.step = finest_las_step(ply.header().comments, ply.name());
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
    if (options.levels || needs_all_points(ply)) return whole(PlyPoints(ply, options).read_all());
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

SurfelCloud read_cloud(PlyFile& ply, const CloudReadOptions& options) {
  return PlyPoints(ply, options).read_all();
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

}  // namespace surfel
