#include <algorithm>
#include <cstring>
#include <deque>
#include <mutex>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/level_store.h>
#include <surfel/io/level_store_bytes.h>
#include <surfel/io/record_table.h>
#include <surfel/io/tree_records.h>

namespace surfel {
namespace {

/// Files that are open at a time; systems allow a process some thousand.
constexpr std::size_t kMostOpen = 128;

/// Bytes of the whole file that follow one another in one file of the store.
struct Segment {
  std::uint64_t begin;     ///< In the whole file; the segment ends where the next one begins.
  std::uint32_t file;      ///< 0: the top; else the block before it in number.
  bool clusters;           ///< Clusters, not surfels.
  std::uint8_t levels;     ///< To be added to clusters' levels.
  std::uint32_t first;     ///< First surfel or cluster in the file.
  std::uint32_t surfels;   ///< To be added to clusters' first surfels.
  std::uint32_t children;  ///< To be added to the first children of clusters that have some.
};

/// Changes a number in a record.
template <class T>
void add_to(std::byte* at, T more) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  value = static_cast<T>(value + more);
  std::memcpy(at, &value, sizeof(T));
}

class LevelStoreBytes final : public InputParts {
 public:
  explicit LevelStoreBytes(const std::string& folder);

  std::size_t size() const override { return segments_.back().begin; }
  void read(std::byte* to, std::size_t offset, std::size_t size) const override;
  void expect(std::size_t offset, std::size_t size) const noexcept override;

 private:
  /// A file of the store that is open.
  struct Open {
    InputFile file;
    std::size_t rows;  ///< Where its surfels begin.
  };
  const LevelStorePart& part(std::uint32_t file) const {
    return file == 0 ? index_.top : index_.blocks[file - 1];
  }
  void lay_out();
  void add(const Segment& segment, std::uint64_t records);
  std::shared_ptr<const Open> open(std::uint32_t file) const;
  void read_clusters(const Segment& segment, std::byte* to, std::size_t offset,
                     std::size_t size) const;
  std::uint64_t place(const Segment& segment, const Open& open) const;
  std::size_t segment_at(std::size_t offset) const;

  std::string folder_;
  LevelStoreIndex index_;
  std::vector<RecordColumn> columns_;
  std::size_t stride_ = 0;
  std::size_t cluster_stride_ = 0;
  std::string header_;
  std::vector<Segment> segments_;  ///< Behind the header; a last one is empty.
  mutable std::mutex mutex_;
  mutable std::vector<std::shared_ptr<const Open>> open_;  ///< By file; null: not open.
  mutable std::vector<std::size_t> rows_;    ///< Where a file's surfels begin; 0: not known yet.
  mutable std::deque<std::uint32_t> order_;  ///< Files that are open, in the order of opening.
};

LevelStoreBytes::LevelStoreBytes(const std::string& folder)
    : folder_(folder),
      index_(read_level_store(folder)),
      open_(index_.blocks.size() + 1),
      rows_(index_.blocks.size() + 1) {
  PlyFile top = open_part(folder_, index_.top);
  const RecordTable& rows = top.scalars("vertex");
  columns_ = rows.columns;
  stride_ = rows.stride;
  cluster_stride_ = top.scalars(kTreeElement).stride;
  header_ = "ply\nformat binary_little_endian 1.0\n";
  for (const std::string& comment : top.header().comments) header_ += "comment " + comment + "\n";
  lay_out();
}

/// Appends a segment of so many records.
void LevelStoreBytes::add(const Segment& segment, std::uint64_t records) {
  const std::uint64_t begin = segments_.back().begin;
  if (records == 0) return;
  segments_.back() = segment;
  segments_.back().begin = begin;
  segments_.push_back({});
  segments_.back().begin = begin + records * (segment.clusters ? cluster_stride_ : stride_);
}

/// Makes the header, and says where all its surfels and clusters are.
void LevelStoreBytes::lay_out() {
  const LevelStorePart& top = index_.top;
  const std::size_t levels = index_.block_levels();
  std::uint64_t surfels = top.all_surfels() - top.surfels.front();
  std::uint64_t clusters = top.all_clusters() - top.clusters.front();
  const auto above_surfels = static_cast<std::uint32_t>(surfels);
  const auto above_clusters = static_cast<std::uint32_t>(clusters);
  // The first surfel and cluster of each block in each level, in the whole file.
  struct Start {
    std::uint32_t surfel, cluster;
  };
  std::vector<Start> starts(index_.blocks.size() * levels);
  for (std::size_t l = levels; l-- > 0;) {
    for (std::size_t b = 0; b < index_.blocks.size(); ++b) {
      starts[b * levels + l] = {static_cast<std::uint32_t>(surfels),
                                static_cast<std::uint32_t>(clusters)};
      surfels += index_.blocks[b].surfels[l];
      clusters += index_.blocks[b].clusters[l];
    }
  }
  header_ += ply_element("vertex", columns_, surfels);
  header_ += ply_element(kTreeElement, tree_columns(), clusters);
  header_ += "end_header\n";

  segments_.push_back({});
  segments_.back().begin = header_.size();
  add({}, above_surfels);
  for (const bool of_clusters : {false, true}) {
    // The levels of the top count from the blocks' coarsest one.
    if (of_clusters) {
      add({.begin = 0,
           .file = 0,
           .clusters = true,
           .levels = static_cast<std::uint8_t>(levels - 1),
           .first = 0,
           .surfels = 0,
           .children = 0},
          above_clusters);
    }
    // What a block has of its coarser levels, which come first in its file.
    std::vector<Start> before(index_.blocks.size());
    for (std::size_t l = levels; l-- > 0;) {
      for (std::size_t b = 0; b < index_.blocks.size(); ++b) {
        const LevelStoreBlock& block = index_.blocks[b];
        Start& own = before[b];
        const Start& start = starts[b * levels + l];
        const std::uint32_t own_children = own.cluster + block.clusters[l];
        add({.begin = 0,
             .file = static_cast<std::uint32_t>(b + 1),
             .clusters = of_clusters,
             .levels = 0,
             .first = of_clusters ? own.cluster : own.surfel,
             .surfels = start.surfel - own.surfel,
             .children = l == 0 ? 0 : starts[b * levels + l - 1].cluster - own_children},
            of_clusters ? block.clusters[l] : block.surfels[l]);
        own = {own.surfel + block.surfels[l], own_children};
      }
    }
  }
}

std::shared_ptr<const LevelStoreBytes::Open> LevelStoreBytes::open(std::uint32_t file) const {
  const std::lock_guard lock(mutex_);
  if (open_[file]) return open_[file];
  const std::string path = path_in(folder_, part(file).file);
  if (rows_[file] == 0) {
    PlyFile ply = open_part(folder_, part(file));
    const RecordTable& rows = ply.scalars("vertex");
    const auto alike = [](const RecordColumn& a, const RecordColumn& b) {
      return a.name == b.name && a.type == b.type;
    };
    if (!std::equal(rows.columns.begin(), rows.columns.end(), columns_.begin(), columns_.end(),
                    alike) ||
        rows.swapped || ply.scalars(kTreeElement).stride != cluster_stride_) {
      throw_input(path,
                  "has other columns than the store; put the file back, or make the store anew "
                  "with surfel-lod");
    }
    rows_[file] = rows.offset;
  }
  open_[file] = std::make_shared<const Open>(Open{InputFile(path), rows_[file]});
  order_.push_back(file);
  if (order_.size() > kMostOpen) {
    open_[order_.front()].reset();
    order_.pop_front();
  }
  return open_[file];
}

/// Index of the segment that holds a byte behind the header.
std::size_t LevelStoreBytes::segment_at(std::size_t offset) const {
  const auto next =
      std::upper_bound(segments_.begin(), segments_.end(), offset,
                       [](std::size_t at, const Segment& segment) { return at < segment.begin; });
  return static_cast<std::size_t>(next - segments_.begin()) - 1;
}

/// Where a segment begins in its file.
std::uint64_t LevelStoreBytes::place(const Segment& segment, const Open& open) const {
  if (!segment.clusters) return open.rows + std::uint64_t{segment.first} * stride_;
  return open.rows + part(segment.file).all_surfels() * stride_ +
         std::uint64_t{segment.first} * cluster_stride_;
}

/// Reads bytes of clusters: whole records are read, changed, and what was asked for is taken.
void LevelStoreBytes::read_clusters(const Segment& segment, std::byte* to, std::size_t offset,
                                    std::size_t size) const {
  const std::size_t first = offset / cluster_stride_;
  const std::size_t last = (offset + size + cluster_stride_ - 1) / cluster_stride_;
  const std::shared_ptr<const Open> file = open(segment.file);
  Array<std::byte> records((last - first) * cluster_stride_);
  Array<std::byte> scratch;
  const std::byte* const from =
      file->file.read_at(place(segment, *file) + first * cluster_stride_, records.size(), scratch);
  std::copy_n(from, records.size(), records.begin());
  // In this order: begin, count, first_child, child_count, level.
  static const std::vector<RecordColumn> columns = tree_columns();
  for (std::size_t at = 0; at < records.size(); at += cluster_stride_) {
    std::byte* const record = records.data() + at;
    const auto children = load_scalar<std::uint32_t, false>(record + columns[3].offset);
    add_to(record + columns[0].offset, segment.surfels);
    if (children > 0) add_to(record + columns[2].offset, segment.children);
    add_to(record + columns[4].offset, segment.levels);
  }
  std::copy_n(records.begin() + static_cast<std::ptrdiff_t>(offset - first * cluster_stride_), size,
              to);
}

void LevelStoreBytes::read(std::byte* to, std::size_t offset, std::size_t size) const {
  if (offset < header_.size() && size > 0) {
    const std::size_t count = std::min(size, header_.size() - offset);
    std::memcpy(to, header_.data() + offset, count);
    to += count;
    offset += count;
    size -= count;
  }
  for (std::size_t s = size > 0 ? segment_at(offset) : 0; size > 0; ++s) {
    const Segment& segment = segments_[s];
    const std::size_t within = offset - segment.begin;
    const std::size_t count = std::min<std::size_t>(size, segments_[s + 1].begin - offset);
    if (segment.clusters) {
      read_clusters(segment, to, within, count);
    } else {
      static thread_local Array<std::byte> scratch;
      const std::shared_ptr<const Open> file = open(segment.file);
      const std::byte* const from =
          file->file.read_at(place(segment, *file) + within, count, scratch);
      std::memcpy(to, from, count);
    }
    to += count;
    offset += count;
    size -= count;
  }
}

void LevelStoreBytes::expect(std::size_t offset, std::size_t size) const noexcept {
  const std::size_t end = offset + size;
  for (std::size_t s = segment_at(std::max(offset, header_.size()));
       s + 1 < segments_.size() && segments_[s].begin < end; ++s) {
    const Segment& segment = segments_[s];
    // A file that cannot be opened is reported where it is read.
    std::shared_ptr<const Open> file;
    try {
      file = open(segment.file);
    } catch (const Error&) {
      return;
    }
    const std::size_t from = std::max<std::size_t>(offset, segment.begin);
    const std::size_t to = std::min<std::size_t>(end, segments_[s + 1].begin);
    file->file.expect(place(segment, *file) + (from - segment.begin), to - from);
  }
}

}  // namespace

std::unique_ptr<const InputParts> open_level_store(const std::string& folder) {
  return std::make_unique<LevelStoreBytes>(folder);
}

}  // namespace surfel
