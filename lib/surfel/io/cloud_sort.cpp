#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/scratch_file.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_sort.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/row_file.h>

namespace surfel {
namespace {

constexpr std::size_t kSortGrain = std::size_t{1} << 14;
constexpr std::uint64_t kLeastMemory = std::uint64_t{1} << 16;
/// Bytes that a part collects before they go to the scratch file: the most, and the least.
constexpr std::uint64_t kMostChunk = std::uint64_t{1} << 20;
constexpr std::uint64_t kLeastChunk = std::uint64_t{1} << 14;
/// What sorting a surfel takes beside its record and a copy of it: its position, key and place in
/// the order, and the scratch memory of sort_keys().
constexpr std::uint64_t kSortBytes = sizeof(Vec3f) + 2 * sizeof(std::uint64_t) + 32;
/// Parts are cut by a sample, and this much smaller than memory allows.
constexpr std::uint64_t kSpare = 2;
constexpr std::uint64_t kMostParts = 4096;
/// Checkpoints of the distribution have numbers from here on, parts of the curve smaller ones.
constexpr std::uint64_t kDistribution = std::uint64_t{1} << 32;

/// A place along the curve through a grid.
struct CurvePlace {
  std::uint64_t code;
  Vec3f position;

  CurvePlace(const Vec3f& p, const MortonGrid& grid)
      : code(p.allFinite() ? grid.code(p) : std::numeric_limits<std::uint64_t>::max()),
        position(p) {}
  /// As morton_order() orders points; what is not finite comes last.
  bool operator<(const CurvePlace& other) const {
    if (code != other.code) return code < other.code;
    return position.allFinite() && before_on_curve(position, other.position);
  }
};

/// A part of the curve: its records in the order in which they came, in the scratch file first,
/// then in memory.
struct Part {
  struct Extent {
    std::uint64_t offset;
    std::uint64_t bytes;
    std::uint64_t checksum;
  };
  std::vector<Extent> extents;
  std::size_t kept_extents = 0;  ///< Those that a checkpoint has.
  Array<std::byte> tail;
  std::size_t tail_bytes = 0;
  std::uint64_t records = 0;
};

}  // namespace

void PositionSample::add(const SurfelCloud& piece) {
  const std::uint64_t end = count_ + piece.size();
  for (std::uint64_t i = (count_ + step_ - 1) / step_ * step_; i < end; i += step_) {
    const Vec3f& p = piece.position[i - count_];
    if (p.allFinite()) positions_.emplace_back(piece.origin + p.cast<double>());
  }
  count_ = end;
  while (positions_.size() > kMost) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < positions_.size(); i += 2) positions_[kept++] = positions_[i];
    positions_.resize(kept);
    step_ *= 2;
  }
}

struct SortedCloudWriter::Impl {
  std::string path;
  SurfelCloud head;  ///< A surfel with all columns of the file.
  std::optional<RowFile> file;
  std::uint64_t count;
  std::uint64_t memory;
  std::size_t stride = 0;
  Vec3d origin{0, 0, 0};
  MortonGrid grid;
  std::optional<RecordPositions> positions;
  std::vector<CurvePlace> first;  ///< Of each part but the first: where it begins.
  std::vector<Part> parts;
  std::optional<ScratchFile> scratch;
  bool resumable;
  std::uint64_t kept_bytes;
  std::uint64_t taken = 0;             ///< Records that were appended.
  std::uint64_t distributed = 0;       ///< Records that an earlier run had distributed.
  std::uint64_t checkpoints = 0;       ///< How many the distribution has made.
  std::uint64_t since_checkpoint = 0;  ///< Bytes.
  Array<std::byte> records;            ///< Of a piece.
  std::vector<std::uint16_t> part_of;

  Impl(std::string to, const CloudSurvey& survey, const PositionSample& sample,
       const SurfelCloud& like, const CloudSortOptions& options);
  void place(const CloudSurvey& survey, const SurfelCloud& like);
  void cut(const PositionSample& sample, std::size_t parts_wanted);
  void put(Part& part, const std::byte* record);
  void flush(Part& part);
  void keep_distribution();
  void restore_distribution();
  Array<std::byte> read(Part& part) const;
  void write(Part& part, std::uint64_t at);
  Vec3f placed(const Vec3d& world) const;
  CurvePlace place_of(const Vec3d& world) const { return {placed(world), grid}; }
  Array<std::uint32_t> order_of(const std::byte* from, std::size_t size) const;
  std::uint64_t bytes_to_sort(std::uint64_t surfels) const {
    return surfels * (2 * stride + kSortBytes);
  }
};

/// The origin and the grid that a reader of the file will find.
void SortedCloudWriter::Impl::place(const CloudSurvey& survey, const SurfelCloud& like) {
  const Bounds& box = survey.box;
  if (box.empty()) return;
  const bool doubles = CloudRecords(like, {}).columns().front().type == ScalarType::kFloat64;
  const Bounds core = doubles ? survey.core() : box;
  origin =
      place_points(core, like.las.has_value(), doubles ? survey.decimals : std::nullopt).origin;
  grid = MortonGrid((box.min - origin).cast<float>(), (box.max - origin).cast<float>());
}

/// Where a reader of the file will find a point.
Vec3f SortedCloudWriter::Impl::placed(const Vec3d& world) const {
  return (world - origin).cast<float>();
}

/// Cuts the curve so that parts have about as many surfels as each other.
void SortedCloudWriter::Impl::cut(const PositionSample& sample, std::size_t parts_wanted) {
  std::vector<CurvePlace> places;
  places.reserve(sample.positions().size());
  for (const Vec3d& p : sample.positions()) places.push_back(place_of(p));
  std::sort(places.begin(), places.end());
  for (std::size_t k = 1; k < parts_wanted; ++k) {
    const std::size_t i = places.size() * k / parts_wanted;
    if (i < places.size() && (first.empty() || first.back() < places[i])) {
      first.push_back(places[i]);
    }
  }
}

SortedCloudWriter::Impl::Impl(std::string to, const CloudSurvey& survey,
                              const PositionSample& sample, const SurfelCloud& like,
                              const CloudSortOptions& options)
    : path(std::move(to)),
      head(like.gathered({0})),
      count(survey.count),
      memory(std::max(options.memory, kLeastMemory)),
      resumable(!options.job.empty()),
      kept_bytes(options.kept_bytes) {
  const CloudRecords made(like, {});
  stride = made.stride();
  place(survey, like);
  positions.emplace(made);
  if (bytes_to_sort(count) > memory) {
    const std::uint64_t wanted = kSpare * bytes_to_sort(count) / memory + 1;
    cut(sample, static_cast<std::size_t>(std::min(wanted, kMostParts)));
  }
  // Where parts end depends on the memory.
  file.emplace(path,
               RowFileOptions{options.no_clobber,
                              resumable ? fmt::format("{}; {} parts", options.job, first.size())
                                        : std::string()});
  file->begin(head, count);
  parts.resize(first.size() + 1);
  if (bytes_to_sort(count) > memory) {
    scratch.emplace(path, resumable ? path + ".unfinished-scratch" : std::string());
    restore_distribution();
    const std::uint64_t needed = 2 * count * stride - scratch->size() - file->rows_kept() * stride;
    if (scratch->free_bytes() < needed) {
      throw_io(path, fmt::format("sorting {} surfels takes {:.3g} GB on its disk, half of which "
                                 "is free again after it, and {:.3g} GB are left; make room, or "
                                 "give more `memory`",
                                 count, static_cast<double>(needed) / 1e9,
                                 static_cast<double>(scratch->free_bytes()) / 1e9));
    }
  }
  const std::uint64_t chunk = std::clamp(memory / (4 * parts.size()), kLeastChunk, kMostChunk);
  for (Part& part : parts) {
    part.tail.resize(scratch ? std::max<std::uint64_t>(1, chunk / stride) * stride
                             : count * stride);
  }
}

/// Writes what a part has collected to the scratch file.
void SortedCloudWriter::Impl::flush(Part& part) {
  if (part.tail_bytes == 0) return;
  const std::span<const std::byte> bytes(part.tail.data(), part.tail_bytes);
  const std::uint64_t checksum = resumable ? crc32c(bytes) : 0;
  part.extents.push_back({scratch->append(bytes.data(), bytes.size()), bytes.size(), checksum});
  since_checkpoint += bytes.size();
  part.tail_bytes = 0;
}

/// Keeps what has been distributed for a later run: the extents since the checkpoint before.
void SortedCloudWriter::Impl::keep_distribution() {
  if (!resumable || !scratch) return;
  std::vector<std::uint64_t> state{taken, 0};
  for (std::size_t k = 0; k < parts.size(); ++k) {
    Part& part = parts[k];
    flush(part);
    for (; part.kept_extents < part.extents.size(); ++part.kept_extents) {
      const Part::Extent& extent = part.extents[part.kept_extents];
      state.insert(state.end(), {k, extent.offset, extent.bytes, extent.checksum});
    }
  }
  state[1] = scratch->size();
  file->finish(kDistribution + checkpoints++, {},
               {reinterpret_cast<const char*>(state.data()), state.size() * sizeof(state[0])});
  since_checkpoint = 0;
}

/// Goes on where an earlier run stopped to distribute, if what it wrote is still there.
void SortedCloudWriter::Impl::restore_distribution() {
  std::uint64_t scratch_bytes = 0;
  while (const std::optional<std::string> kept = file->finished(kDistribution + checkpoints)) {
    std::vector<std::uint64_t> state(kept->size() / sizeof(std::uint64_t));
    std::memcpy(state.data(), kept->data(), state.size() * sizeof(state[0]));
    for (std::size_t at = 2; at < state.size(); at += 4) {
      Part& part = parts[state[at]];
      part.extents.push_back({state[at + 1], state[at + 2], state[at + 3]});
      part.records += state[at + 2] / stride;
      ++part.kept_extents;
    }
    distributed = state[0];
    scratch_bytes = state[1];
    ++checkpoints;
  }
  if (scratch->keep(scratch_bytes)) return;
  scratch->keep(0);
  parts.assign(parts.size(), {});
  distributed = checkpoints = 0;
}

void SortedCloudWriter::Impl::put(Part& part, const std::byte* record) {
  if (part.tail_bytes == part.tail.size()) {
    if (!scratch) throw_input(path, "more surfels come than were promised");
    flush(part);
  }
  std::memcpy(part.tail.data() + part.tail_bytes, record, stride);
  part.tail_bytes += stride;
  ++part.records;
}

SortedCloudWriter::SortedCloudWriter(std::string path, const CloudSurvey& survey,
                                     const PositionSample& sample, const SurfelCloud& first,
                                     const CloudSortOptions& options)
    : impl_(std::make_unique<Impl>(std::move(path), survey, sample, first, options)) {}
SortedCloudWriter::~SortedCloudWriter() = default;

std::uint64_t SortedCloudWriter::scratch_bytes() const {
  return impl_->scratch ? impl_->count * impl_->stride : 0;
}

std::uint64_t SortedCloudWriter::kept() const {
  return std::max(impl_->distributed, impl_->file->rows_kept());
}

void SortedCloudWriter::append(const SurfelCloud& piece) {
  Impl& w = *impl_;
  piece.check_columns(w.path);
  // What an earlier run distributed is passed over.
  const auto skipped = static_cast<std::size_t>(
      std::min<std::uint64_t>(piece.size(), w.distributed - std::min(w.distributed, w.taken)));
  w.taken += piece.size();
  if (skipped == piece.size()) return;
  const CloudRecords made(piece, {});
  if (made.stride() != w.stride) throw_input(w.path, "pieces of the cloud differ in their columns");
  w.records.resize(piece.size() * w.stride);
  w.part_of.resize(piece.size());
  parallel_for(piece.size(), kSortGrain, [&](std::size_t begin, std::size_t end, int) {
    std::byte* const from = w.records.data() + begin * w.stride;
    made.encode(begin, end, from);
    for (std::size_t i = begin; i < end && !w.first.empty(); ++i) {
      const CurvePlace place = w.place_of((*w.positions)(from, i - begin));
      const auto next = std::upper_bound(w.first.begin(), w.first.end(), place);
      w.part_of[i] = static_cast<std::uint16_t>(next - w.first.begin());
    }
  });
  for (std::size_t i = skipped; i < piece.size(); ++i) {
    w.put(w.parts[w.first.empty() ? 0 : w.part_of[i]], w.records.data() + i * w.stride);
  }
  if (w.since_checkpoint >= w.kept_bytes) w.keep_distribution();
}

/// All records of a part, which it then has no more.
Array<std::byte> SortedCloudWriter::Impl::read(Part& part) const {
  if (part.extents.empty()) return std::move(part.tail);
  Array<std::byte> all(part.records * stride);
  std::byte* to = all.data();
  for (const Part::Extent& extent : part.extents) {
    scratch->read_at(extent.offset, to, extent.bytes);
    if (resumable && extent.checksum != crc32c({to, extent.bytes})) {
      throw_io(path,
               "what an earlier run left beside it is damaged; remove its files .unfinished, "
               ".unfinished-parts and .unfinished-scratch, and begin anew");
    }
    to += extent.bytes;
  }
  std::memcpy(to, part.tail.data(), part.tail_bytes);
  part = {};
  return all;
}

/// The order of records along the curve.
Array<std::uint32_t> SortedCloudWriter::Impl::order_of(const std::byte* from,
                                                       std::size_t size) const {
  Array<Vec3f> position(size);
  parallel_each(size, kSortGrain,
                [&](std::size_t i) { position[i] = placed((*positions)(from, i)); });
  return morton_order(position, grid);
}

/// Sorts a part, and writes it as the rows from `at` on.
void SortedCloudWriter::Impl::write(Part& part, std::uint64_t at) {
  const auto size = static_cast<std::size_t>(part.records);
  if (size == 0) return;
  if (bytes_to_sort(size) > memory) {
    throw_input(path, fmt::format("{} surfels lie so near to each other that they are sorted "
                                  "together, in {:.3g} MB; give more `memory`",
                                  size, static_cast<double>(bytes_to_sort(size)) / 1e6));
  }
  const Array<std::byte> from = read(part);
  const Array<std::uint32_t> order = order_of(from.data(), size);
  Array<std::byte> sorted(size * stride);
  parallel_each(size, kSortGrain, [&](std::size_t i) {
    std::memcpy(sorted.data() + i * stride, from.data() + order[i] * stride, stride);
  });
  file->put_records(sorted.data(), size, at);
}

void SortedCloudWriter::commit() {
  Impl& w = *impl_;
  w.records = {};
  w.part_of = {};
  if (w.taken != w.count) {
    throw_input(w.path, fmt::format("{} surfels were promised and {} came", w.count, w.taken));
  }
  w.keep_distribution();
  ProgressStage stage("sorting", w.count, "surfels");
  std::uint64_t at = 0;
  for (std::size_t k = 0; k < w.parts.size(); ++k) {
    const RowSpan rows{at, at + w.parts[k].records};
    if (!w.file->finished(k)) {
      w.write(w.parts[k], at);
      w.file->finish(k, {&rows, 1}, {});
    }
    at = rows.end;
    stage.add(rows.end - rows.begin);
  }
  w.file->commit();
  if (w.scratch) w.scratch->remove();
}

}  // namespace surfel
