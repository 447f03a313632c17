#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <limits>
#include <mutex>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/curve_cell.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/cloud_sort.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/level_store.h>
#include <surfel/io/tree_records.h>
#include <surfel/lod/level_columns.h>
#include <surfel/lod/level_plan.h>
#include <surfel/lod/level_store_writer.h>
#include <surfel/lod/store_folder.h>
#include <surfel/lod/store_levels.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/level_sink.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/surfel_variance.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {
namespace {

namespace fs = std::filesystem;

/// Records of the sorted surfels that are read at a time.
constexpr std::size_t kReadAtOnce = std::size_t{1} << 14;

using Records = Array<std::byte>;

/// The records in another order.
Records gathered(const Records& records, std::size_t stride,
                 const std::vector<std::uint32_t>& order) {
  Records out(order.size() * stride);
  for (std::size_t i = 0; i < order.size(); ++i) {
    std::memcpy(out.data() + i * stride, records.data() + order[i] * stride, stride);
  }
  return out;
}

std::vector<std::uint32_t> numbers_to(std::size_t count) {
  std::vector<std::uint32_t> numbers(count);
  std::iota(numbers.begin(), numbers.end(), 0U);
  return numbers;
}

/// The new surfels, in the order of the curve.
class SortedRecords {
 public:
  SortedRecords(const std::string& path, const StoreLayout& layout)
      : layout_(layout), ply_(InputFile(path)), table_(ply_.scalars("vertex")) {}

  bool done() const { return at_ == table_.count; }
  /// The next record, which next() passes over; it stays until then.
  const std::byte* record() const { return buffer_ + (at_ - first_) * layout_.stride; }
  Vec3d position() {
    if (at_ == end_) read();
    return layout_.position(record());
  }
  void next() { ++at_; }

 private:
  void read() {
    first_ = at_;
    end_ = std::min(at_ + kReadAtOnce, table_.count);
    buffer_ = table_.read(first_, end_, scratch_);
  }

  const StoreLayout& layout_;
  PlyFile ply_;
  const RecordTable& table_;
  std::size_t at_ = 0, first_ = 0, end_ = 0;
  const std::byte* buffer_ = nullptr;
  Records scratch_;
};

/// Records along the curve, of which so many are in memory that a block can be cut off.
struct Window {
  Records records;
  std::vector<Vec3d> positions;

  std::size_t size() const { return positions.size(); }
  void add(const std::byte* record, std::size_t stride, const Vec3d& position) {
    records.insert(records.end(), record, record + stride);
    positions.push_back(position);
  }
  /// Takes the first records away.
  Records cut(std::size_t count, std::size_t stride) {
    const auto end = records.begin() + static_cast<std::ptrdiff_t>(count * stride);
    Records out(records.begin(), end);
    records.erase(records.begin(), end);
    positions.erase(positions.begin(), positions.begin() + static_cast<std::ptrdiff_t>(count));
    return out;
  }
};

/// Writes a version of a store: of new surfels, and of those that it has.
class StoreVersion {
 public:
  /// \param older    the store as it is; null: there is none, or it is replaced
  /// \param options  of the new version; with `older` the index decides
  StoreVersion(StoreFolder& folder, const LevelStoreIndex* older, const LevelStoreOptions& options,
               LevelStoreReport& report, const std::string& name);

  void sort(SurfelPieces pieces);
  void write_blocks();
  void write_top();
  void write_index();

 private:
  /// Records of a block that is yet to be written.
  struct Waiting {
    Records records;
    std::size_t block;
  };
  SurfelCloud usable(const SurfelCloud& piece, UnusableSurfels& dropped) const;
  void check_columns(const SurfelCloud& surfels);
  void check_meaning(const SurfelCloud& surfels) const;
  SurfelCloud cloud_of(const Records& records) const;
  Records read_finest(const LevelStoreBlock& block) const;
  void cut(Window& window, const std::optional<Vec3d>& next, FunctionRef<void()> fill);
  void add_block(Records records, const CurveCell& cell);
  void flush();
  void write_block(const Waiting& waiting);
  void write_part(LevelStorePart& part, const StoreLevels& levels, const std::string& begin);

  StoreFolder& folder_;
  const LevelStoreIndex* older_;
  LevelStoreReport& report_;
  const std::string& name_;
  HierarchyOptions hierarchy_;
  std::size_t most_ = 0;  ///< Surfels of a block.
  StoreLayout layout_;
  SurfelCloud head_;  ///< What the headers of all files tell.
  LevelStoreIndex index_;
  std::optional<Vec3d> before_;  ///< A place in the block before the next one along the curve.
  std::vector<Waiting> waiting_;
  std::size_t at_once_ = 1;  ///< Blocks that threads work on at the same time.
  std::mutex mutex_;         ///< Of the report.
};

StoreVersion::StoreVersion(StoreFolder& folder, const LevelStoreIndex* older,
                           const LevelStoreOptions& options, LevelStoreReport& report,
                           const std::string& name)
    : folder_(folder),
      older_(older),
      report_(report),
      name_(name),
      hierarchy_(options.hierarchy),
      most_(options.block_surfels) {
  hierarchy_.checkpoints = nullptr;
  hierarchy_.peers = nullptr;
  if (most_ == 0) most_ = most_block_surfels(hierarchy_.reduction);
  if (older_) {
    head_ = level_store_head(folder_.path());
    layout_ = StoreLayout(head_);
  }
  index_.reduction = hierarchy_.reduction;
  index_.normal_angle = hierarchy_.sheets.normal_angle;
  index_.sheet_weight = hierarchy_.sheets.sheet_weight;
  index_.most_surfels = static_cast<std::uint32_t>(most_);
}

/// The surfels of a piece that can be drawn, with the columns of levels.
SurfelCloud StoreVersion::usable(const SurfelCloud& piece, UnusableSurfels& dropped) const {
  if (!has_variance(piece)) {
    throw_input(name_,
                "the surfels have no variance (nor radius); make it with surfel-estimate or "
                "surfel-from-mesh");
  }
  Array<std::uint32_t> order(piece.size());
  std::iota(order.begin(), order.end(), 0U);
  dropped.add(remove_unusable(piece, false, order));
  SurfelCloud out = level_columns(piece, order);
  // Origins differ from file to file and from block to block: doubles tell positions apart from all
  // of them.
  out.double_positions = true;
  return out;
}

/// Refuses surfels of which something else holds than the headers of the store's files say of all.
void StoreVersion::check_meaning(const SurfelCloud& surfels) const {
  const auto refuse = [&](const char* what) {
    throw_input(name_, fmt::format("the surfels have {} than the store {}; convert them, or make a "
                                   "store of their own",
                                   what, folder_.path()));
  };
  const auto system = coordinate_system(head_.comments);
  if (system && coordinate_system(surfels.comments) != system) {
    refuse("another coordinate system");
  }
  if (surfels.color_light != head_.color_light) {
    refuse("colours of another meaning (recorded light, or the surface's own colours)");
  }
  if (surfels.basis_cutoff != head_.basis_cutoff) {
    refuse("coefficients for another cutoff of the kernels");
  }
}

/// Takes over the columns of the first surfels of a new store, and refuses others.
void StoreVersion::check_columns(const SurfelCloud& surfels) {
  const StoreLayout layout(surfels);
  if (layout_.columns.empty()) {
    layout_ = layout;
    head_ = surfels.gathered({});
    // What tells of single scans and runs would depend on the order in which they are added.
    head_.las.reset();
    head_.decimals.reset();
    head_.viewpoint.reset();
    head_.scan_viewpoints.clear();
    head_.provenance.clear();
    return;
  }
  check_meaning(surfels);
  // The first of some columns that is not among others.
  const auto lacking = [](const StoreLayout& has, const StoreLayout& lacks) {
    return std::find_if(has.columns.begin(), has.columns.end(), [&](const RecordColumn& column) {
      return std::none_of(lacks.columns.begin(), lacks.columns.end(),
                          [&](const RecordColumn& other) {
                            return other.name == column.name && other.type == column.type;
                          });
    });
  };
  if (const auto column = lacking(layout_, layout); column != layout_.columns.end()) {
    throw_input(name_, fmt::format("the surfels have no {} of the type {}, which the store {} has; "
                                   "give them the same columns, or make the store anew of all",
                                   column->name, scalar_name(column->type), folder_.path()));
  }
  if (const auto column = lacking(layout, layout_); column != layout.columns.end()) {
    throw_input(name_, fmt::format("the surfels have a column {}, which the store {} has not; "
                                   "keep the others alone, by surfel-convert",
                                   column->name, folder_.path()));
  }
  if (!same_columns(layout.columns, layout_.columns)) {
    throw_input(name_, fmt::format("the surfels have the columns of the store {} in another order; "
                                   "make the store anew of all",
                                   folder_.path()));
  }
}

/// Writes the new surfels to a file of their own, in the order of the curve.
void StoreVersion::sort(SurfelPieces pieces) {
  const std::string path = folder_ / kSortedFile;
  CloudSurvey survey(path);
  PositionSample sample;
  pieces([&](const SurfelCloud& piece) {
    const SurfelCloud surfels = usable(piece, report_.dropped);
    if (surfels.empty()) return;
    check_columns(surfels);
    survey.add(surfels);
    sample.add(surfels);
  });
  if (survey.count == 0) throw_input(name_, "holds no surfel that can be drawn");
  report_.added = survey.count;
  folder_.remove(kSortedFile);
  folder_.add(kSortedFile);
  std::optional<SortedCloudWriter> sorter;
  UnusableSurfels counted_before;
  pieces([&](const SurfelCloud& piece) {
    const SurfelCloud surfels = usable(piece, counted_before);
    if (surfels.empty()) return;
    if (!sorter) {
      CloudSortOptions options;
      options.memory = std::numeric_limits<std::uint64_t>::max();
      if (hierarchy_.memory > 0) options.memory = hierarchy_.memory;
      options.all_space = true;
      sorter.emplace(path, survey, sample, surfels, options);
    }
    sorter->append(surfels);
  });
  sorter->commit();
  report_.bytes_sorted = survey.count * layout_.stride;
}

/// A file of records in memory, read.
SurfelCloud StoreVersion::cloud_of(const Records& records) const {
  const std::string header =
      cloud_ply_header(head_, layout_.columns, layout_.count(records), 0, false);
  Records bytes(header.size() + records.size());
  std::memcpy(bytes.data(), header.data(), header.size());
  std::copy(records.begin(), records.end(),
            bytes.begin() + static_cast<std::ptrdiff_t>(header.size()));
  SurfelCloud cloud = read_cloud(InputFile(name_, bytes));
  const std::vector<std::uint32_t> numbers = numbers_to(cloud.size());
  ExtraProperty number{kRecordColumn, ScalarType::kUint32, {}};
  number.data.resize(numbers.size() * sizeof(numbers[0]));
  std::memcpy(number.data.data(), numbers.data(), number.data.size());
  cloud.extra.push_back(std::move(number));
  return cloud;
}

/// The surfels of a block along the curve.
Records StoreVersion::read_finest(const LevelStoreBlock& block) const {
  PlyFile file = open_part(folder_.path(), block);
  check_part(file, block);
  const RecordTable& table = file.scalars("vertex");
  Records scratch;
  const std::byte* const from =
      table.read(table.count - block.surfels.front(), table.count, scratch);
  const Records records(from, from + block.surfels.front() * layout_.stride);
  std::vector<std::uint32_t> order = numbers_to(block.surfels.front());
  const auto place = [&](std::uint32_t i) {
    return layout_.position(records.data() + i * layout_.stride);
  };
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return before_in_space(place(a), place(b)); });
  return gathered(records, layout_.stride, order);
}

/// Cuts blocks off the records of a window, which `fill` keeps full, until there are none. All lie
/// between the block before them and another one along the curve, neither of which changes.
/// \param next  a place in the next block; unset: there is none
void StoreVersion::cut(Window& window, const std::optional<Vec3d>& next, FunctionRef<void()> fill) {
  for (fill(); window.size() > 0; fill()) {
    const Vec3d first = window.positions.front();
    // The largest cell around the first surfel that has none of other blocks, and not too many.
    int side = CurveCell::kAllSpace;
    const auto leave_out = [&](const Vec3d& p) {
      side = std::min(side, common_side(first, p) - 1);
    };
    if (before_) leave_out(*before_);
    if (next) leave_out(*next);
    if (window.size() > most_) leave_out(window.positions[most_]);
    const auto inside = [&](const Vec3d& p) { return common_side(first, p) <= side; };
    const auto end = std::partition_point(window.positions.begin(), window.positions.end(), inside);
    const auto count = static_cast<std::size_t>(end - window.positions.begin());
    if (count == 0) {
      throw_input(name_, fmt::format("more than {} surfels lie at one place, ({}, {}, {}); remove "
                                     "copies",
                                     most_, first.x(), first.y(), first.z()));
    }
    before_ = window.positions[count - 1];
    add_block(window.cut(count, layout_.stride), cell_around(first, side));
  }
}

/// Joins the new surfels to the blocks that they lie in, and makes blocks of them where there are
/// none.
void StoreVersion::write_blocks() {
  std::vector<const LevelStoreBlock*> older;
  if (older_) {
    for (const LevelStoreBlock& block : older_->blocks) older.push_back(&block);
  }
  std::sort(older.begin(), older.end(), [](const LevelStoreBlock* a, const LevelStoreBlock* b) {
    return before_in_space(a->cell.center, b->cell.center);
  });
  at_once_ = static_cast<std::size_t>(thread_count());
  if (hierarchy_.memory > 0) {
    // The records as they are, as a file and as surfels, and with the levels.
    constexpr std::size_t kCopies = 8;
    const std::uint64_t each = std::uint64_t{kCopies} * most_ * layout_.stride;
    at_once_ =
        static_cast<std::size_t>(std::clamp<std::uint64_t>(hierarchy_.memory / each, 1, at_once_));
  }
  SortedRecords added(folder_ / kSortedFile, layout_);
  ProgressStage stage("making blocks", report_.added, "surfels");
  auto block = older.begin();
  const auto next_place = [&]() -> std::optional<Vec3d> {
    if (block == older.end()) return std::nullopt;
    return (*block)->cell.center;
  };
  while (!added.done()) {
    Window window;
    // Takes the next of the new surfels into the window.
    const auto take = [&] {
      window.add(added.record(), layout_.stride, added.position());
      added.next();
      stage.add(1);
    };
    const Vec3d p = added.position();
    const bool inside = block != older.end() && (*block)->cell.contains(p);
    if (!inside && block != older.end() && before_in_space((*block)->cell.center, p)) {
      // A block that nothing is added to.
      index_.blocks.push_back(**block);
      before_ = (*block++)->cell.center;
      continue;
    }
    if (!inside) {
      cut(window, next_place(), [&] {
        while (window.size() <= most_ && !added.done()) {
          const Vec3d q = added.position();
          if (block != older.end() &&
              ((*block)->cell.contains(q) || before_in_space((*block)->cell.center, q))) {
            return;
          }
          take();
        }
      });
      continue;
    }
    const LevelStoreBlock& divided = **block++;
    const Records records = read_finest(divided);
    std::size_t at = 0;
    cut(window, next_place(), [&] {
      while (window.size() <= most_) {
        const std::byte* const older_record = records.data() + at * layout_.stride;
        const bool more = at < divided.surfels.front();
        const bool added_more = !added.done() && divided.cell.contains(added.position());
        if (added_more &&
            (!more || before_in_space(added.position(), layout_.position(older_record)))) {
          take();
        } else if (more) {
          window.add(older_record, layout_.stride, layout_.position(older_record));
          ++at;
        } else {
          return;
        }
      }
    });
  }
  for (; block != older.end(); ++block) index_.blocks.push_back(**block);
  flush();
  folder_.remove(kSortedFile);
}

void StoreVersion::add_block(Records records, const CurveCell& cell) {
  waiting_.push_back({std::move(records), index_.blocks.size()});
  index_.blocks.emplace_back().cell = cell;
  if (waiting_.size() >= at_once_) flush();
}

void StoreVersion::flush() {
  parallel_each(waiting_.size(), 1, [&](std::size_t i) { write_block(waiting_[i]); });
  waiting_.clear();
}

void StoreVersion::write_block(const Waiting& waiting) {
  // Nothing may depend on the order in which surfels at one place came.
  const std::size_t stride = layout_.stride;
  std::vector<std::uint32_t> order = numbers_to(layout_.count(waiting.records));
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::memcmp(waiting.records.data() + a * stride, waiting.records.data() + b * stride,
                       stride) < 0;
  });
  const Records records = gathered(waiting.records, stride, order);
  HierarchyOptions options = hierarchy_;
  options.memory = 0;
  options.least_levels = static_cast<int>(levels_of_block(most_, hierarchy_.reduction));
  StoreLevels levels(layout_, records);
  const SurfelCloud cloud = cloud_of(records);
  build_hierarchy(OrderedCloud(cloud), options, levels, nullptr, name_);
  LevelStoreBlock& block = index_.blocks[waiting.block];
  write_part(block, levels, kBlockName + block.cell.name());
  const std::lock_guard lock(mutex_);
  ++report_.blocks_written;
}

/// Writes a file of the store, and completes its entry of the index.
/// \param begin  of its name, which goes on with its size and checksum: files of two versions,
/// which
///               differ in one of them, have different names
void StoreVersion::write_part(LevelStorePart& part, const StoreLevels& levels,
                              const std::string& begin) {
  part = levels.part();
  const std::string checksum = checksum_text(part.checksum);
  part.file = fmt::format("{}-{}-{}.ply", begin, part.surfels.front(), checksum);
  std::string header =
      cloud_ply_header(head_, layout_.columns, part.all_surfels(), part.all_clusters(), false);
  header.insert(header.find("element "),
                fmt::format("obj_info {} {}\n", kLevelStoreChecksum, checksum));
  folder_.add(part.file);
  OutputFile file(folder_ / part.file);
  file.write(header);
  file.write(levels.bytes().data(), levels.bytes().size());
  file.commit();
  const std::lock_guard lock(mutex_);
  report_.bytes_written += header.size() + levels.bytes().size();
}

/// Makes the levels above all blocks, and puts the blocks into the order of their roots.
void StoreVersion::write_top() {
  Records surfels;
  Records clusters;
  std::uint64_t finest = 0;
  for (const LevelStoreBlock& block : index_.blocks) {
    PlyFile file = open_part(folder_.path(), block);
    Records scratch;
    const RecordTable& rows = file.scalars("vertex");
    const std::byte* from = rows.read(0, block.surfels.back(), scratch);
    surfels.insert(surfels.end(), from, from + block.surfels.back() * rows.stride);
    const RecordTable& tree = file.scalars(kTreeElement);
    from = tree.read(0, 1, scratch);
    clusters.insert(clusters.end(), from, from + tree.stride);
    finest += block.all_surfels();
  }
  // Together with all coarser levels, 32-bit indices must do.
  if (finest + surfels.size() / layout_.stride * 2 > std::numeric_limits<std::uint32_t>::max()) {
    throw_input(name_,
                "together with the store's surfels these are more than 2.1 billion; make a second "
                "store");
  }
  if (hierarchy_.memory > 0) {
    // Records, surfels, and these on the way to be merged; the levels above have half as many.
    const std::uint64_t needed = surfels.size() * 6 + clusters.size() * 4;
    if (needed > hierarchy_.memory) {
      throw_input(name_,
                  fmt::format("the levels above {} blocks take {} MB of memory, and `memory` "
                              "is {} MB; give more",
                              index_.blocks.size(), (needed >> 20) + 1, hierarchy_.memory >> 20));
    }
  }
  const SurfelCloud roots = cloud_of(surfels);
  RecordTable table;
  table.data = clusters.data();
  table.columns = tree_columns();
  table.count = index_.blocks.size();
  table.stride = clusters.size() / table.count;
  ClusterTree trees = recentered_tree(clusters_from_records(table, name_), roots.origin);
  std::uint32_t begin = 0;
  for (std::size_t b = 0; b < trees.size(); ++b) {
    trees[b].begin = begin;
    trees[b].end = begin += index_.blocks[b].surfels.back();
  }
  StoreLevels levels(layout_, surfels);
  HierarchyOptions options = hierarchy_;
  options.memory = 0;
  const std::vector<std::size_t> places =
      join_hierarchies(roots, trees, index_.block_levels() - 1, options, levels, nullptr, name_);
  std::vector<LevelStoreBlock> blocks(places.size());
  for (std::size_t b = 0; b < places.size(); ++b) blocks[places[b]] = index_.blocks[b];
  index_.blocks = std::move(blocks);
  write_part(index_.top, levels, "top");
}

/// From here on the store is the new version.
void StoreVersion::write_index() {
  const std::string text = level_store_text(index_);
  OutputFile file(folder_ / kLevelStoreIndex);
  file.write(text);
  file.commit();
  folder_.keep();
  std::set<std::string> kept{index_.top.file};
  for (const LevelStoreBlock& block : index_.blocks) kept.insert(block.file);
  folder_.remove_all_but(kept);

  report_.bytes_written += text.size();
  report_.blocks = index_.blocks.size();
  report_.levels.assign(index_.block_levels() + index_.top.surfels.size() - 1, 0);
  const auto count = [&](const LevelStorePart& part, std::size_t first, std::size_t level) {
    for (std::size_t l = first; l < part.surfels.size(); ++l) {
      report_.levels[level + l] += part.surfels[l];
      report_.clusters += part.clusters[l];
    }
  };
  for (const LevelStoreBlock& block : index_.blocks) count(block, 0, 0);
  count(index_.top, 1, index_.block_levels() - 1);
}

void write_version(StoreFolder& folder, const LevelStoreIndex* older, SurfelPieces pieces,
                   const LevelStoreOptions& options, LevelStoreReport* report,
                   const std::string& name) {
  LevelStoreReport own;
  LevelStoreReport& r = report ? *report : own;
  r = {};
  StageTimer stage(r.stages);
  StoreVersion version(folder, older, options, r, name);
  version.sort(pieces);
  stage.end("sort");
  version.write_blocks();
  stage.end("blocks");
  version.write_top();
  version.write_index();
  stage.end("top");
}

}  // namespace

std::vector<std::string> LevelStoreOptions::problems() const {
  std::vector<std::string> found = hierarchy.problems();
  if (!found.empty()) return found;
  const std::size_t most = most_block_surfels(hierarchy.reduction);
  check_option(found, block_surfels <= most, "block_surfels", block_surfels,
               fmt::format("in 0..{}", most).c_str());
  return found;
}

void make_level_store(const std::string& folder, SurfelPieces pieces,
                      const LevelStoreOptions& options, LevelStoreReport* report,
                      const std::string& name) {
  require_usable(options);
  if (options.no_clobber && is_level_store(folder)) {
    throw_io(folder, "exists already and `no_clobber` is set; name another folder");
  }
  StoreFolder place(folder);
  if (!is_level_store(folder)) place.remove_all_but({});
  write_version(place, nullptr, pieces, options, report, name);
}

void append_to_level_store(const std::string& folder, SurfelPieces pieces, std::uint64_t memory,
                           LevelStoreReport* report, const std::string& name) {
  if (!is_level_store(folder)) {
    throw_input(folder,
                "is no store of levels of detail; make one first: surfel-lod surfels.ply -o "
                "store/");
  }
  StoreFolder place(folder);
  const LevelStoreIndex older = read_level_store(folder);
  std::set<std::string> kept{older.top.file};
  for (const LevelStoreBlock& block : older.blocks) kept.insert(block.file);
  place.remove_all_but(kept);
  LevelStoreOptions options;
  options.hierarchy.reduction = older.reduction;
  options.hierarchy.sheets = {older.normal_angle, older.sheet_weight};
  options.hierarchy.memory = memory;
  options.block_surfels = older.most_surfels;
  require_usable(options);
  write_version(place, &older, pieces, options, report, name);
}

SurfelCloud level_store_head(const std::string& folder) {
  const LevelStoreIndex index = read_level_store(folder);
  open_part(folder, index.top);
  return level_columns(CloudReader(path_in(folder, index.top.file)).first(), {0});
}

}  // namespace surfel
