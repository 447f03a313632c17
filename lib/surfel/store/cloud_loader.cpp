#include <algorithm>
#include <bit>
#include <memory>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/option_check.h>
#include <surfel/io/cloud_comments.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/input_file.h>
#include <surfel/io/ply.h>
#include <surfel/io/tree_records.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/store/cloud_stream.h>
#include <surfel/store/record_source.h>

namespace surfel {
namespace {

/// Bytes of a surfel in memory, roughly: a row of all columns, and its share of a cluster.
constexpr std::uint64_t kSurfelBytes = 64;
/// Bytes of a cluster that stays in its file: its bounds, and its entries in a picture's lists.
constexpr std::uint64_t kStreamedClusterBytes = 280;
/// Bytes of a surfel in flight: its columns, its splat and the tiles that it touches.
constexpr std::uint64_t kFlightBytes = 512;
/// One in so many bytes of the memory that the clusters leave is for A-buffers.
constexpr std::uint64_t kPicturePart = 4;
/// Fewest surfels of a batch: 64 clusters, so that a fetch reads more than it seeks.
constexpr std::size_t kLeastBatch = std::size_t{1} << 14;

/// The points as records, if the file is a binary PLY file of scalars; else null.
const RecordTable* binary_records(PlyFile& ply) {
  const PlyElement* vertex = ply.header().find("vertex");
  const bool plain = vertex && ply.header().format != PlyFormat::kAscii &&
                     std::none_of(vertex->properties.begin(), vertex->properties.end(),
                                  [](const PlyProperty& property) { return property.is_list(); });
  return plain ? &ply.scalars("vertex") : nullptr;
}

/// Surfels [first, second) of the coarsest level of detail that has as many as a sample holds, or
/// else of the finest.
std::pair<std::size_t, std::size_t> sampled_level(std::span<const TreeLevel> levels) {
  const auto enough = std::find_if(levels.begin(), levels.end() - 1, [](const TreeLevel& level) {
    return level.end_surfel - level.first_surfel >= SurfaceSampler::kPoints;
  });
  return {enough->first_surfel, enough->end_surfel};
}

/// Throws if a cloud has surfels, but none that can be drawn.
void require_drawable(const RenderCloud& surfels, const std::string& name) {
  const auto& dropped = surfels.dropped();
  if (surfels.size() > 0 || dropped.total() == 0) return;
  throw_input(name,
              fmt::format("none of the {} visible surfels can be used: {} with positions, {} with "
                          "variances, {} with colours that are not usable numbers",
                          dropped.total(), dropped.position, dropped.variance, dropped.color));
}

}  // namespace

struct LoadedCloud::Impl {
  CloudLoadOptions options;
  // Each of the next six members may refer to the ones before it.
  std::optional<PlyFile> ply;
  std::unique_ptr<RecordSource> records;
  std::unique_ptr<SurfelSource> wrapped;  ///< Null: the records themselves.
  ClusterTree tree;                       ///< Empty where there are no levels.
  std::vector<TreeLevel> levels;          ///< Of the tree.
  std::unique_ptr<CloudStream> stream;
  std::optional<RenderCloud> surfels;
  std::optional<double> basis_cutoff;
  std::optional<Viewpoint> viewpoint;
  std::optional<Vec3d> up;
  ColorLight color_light = ColorLight::kUnsaid;
  SurfaceSample sample;
  bool has_levels = false;

  explicit Impl(const CloudLoadOptions& o) : options(o) {}
  bool load_records(InputFile& input);
  void load_cloud(const SurfelCloud& cloud, const std::string& name);
  bool open_records();
  std::size_t wanted() const;
  std::uint64_t memory_bytes() const;
  static std::size_t batch(std::uint64_t memory, std::uint64_t index);
  std::uint64_t index_bytes() const;
  const char* why_in_memory() const;
  SurfelSource& source() const { return wrapped ? *wrapped : *records; }
  void make_stream(std::uint64_t memory);
  void take_header(const SurfelCloud& header, const SurfelSource& from);
  void wrap(SurfelSource& inner);
  void sample_resident();
};

/// Why the records must not be streamed; null if they may.
const char* LoadedCloud::Impl::why_in_memory() const {
  if (!options.may_stream || options.columns.groups) {
    return "what is asked for wants all of them at once; raise it, or use `method` abuffer";
  }
  if (levels.empty() && source().attributes().source && !options.columns.copies) {
    return "copies of splats are found among all of them at once; raise it, or render the surfels "
           "as they were before surfel-group";
  }
  return nullptr;
}

/// Finds the surfels, and their levels of detail. False if records are not decoded directly.
bool LoadedCloud::Impl::open_records() {
  const RecordTable* table = binary_records(*ply);
  if (!table) return false;
  if (!ply->header().find(kTreeElement)) {
    records = std::make_unique<RecordSource>(*table, ply->name());
    return true;
  }
  const RecordTable& clusters = ply->scalars(kTreeElement);
  TreeRecords all = tree_from_records(clusters, table->count, ply->name());
  records = std::make_unique<RecordSource>(*table, ply->name(), all.reach.front());
  tree = recentered_tree(std::move(all), records->origin());
  levels = levels_of(tree);
  return true;
}

/// Number of surfels of the levels that are asked for.
std::size_t LoadedCloud::Impl::wanted() const {
  if (levels.empty() || options.columns.levels) return source().size();
  return source().size() - levels.back().first_surfel;
}

/// Bytes that a stream's clusters take.
std::uint64_t LoadedCloud::Impl::index_bytes() const {
  const std::size_t clusters =
      levels.empty() ? source().size() / RenderCloud::kClusterSize : tree.size();
  return clusters * kStreamedClusterBytes;
}

/// Bytes that the surfels and their pictures may take.
std::uint64_t LoadedCloud::Impl::memory_bytes() const {
  return options.memory.value_or(available_memory_bytes() / 4 * 3);
}

/// Surfels that a stream may have in memory at a time, beside the index of its clusters: a power of
/// two.
std::size_t LoadedCloud::Impl::batch(std::uint64_t memory, std::uint64_t index) {
  const std::uint64_t left = memory > index ? memory - index : 0;
  return std::bit_floor((left - left / kPicturePart) / kFlightBytes);
}

/// False if the file is to be read as a SurfelCloud.
bool LoadedCloud::Impl::load_records(InputFile& input) {
  if (!PlyFile::matches(input.head(4))) return false;
  ply.emplace(std::move(input));
  if (!open_records()) return false;
  SurfelCloud header;
  read_comments(ply->header().comments, ply->name(), header);
  take_header(header, *records);
  has_levels = !levels.empty();
  if (options.sample && has_levels) {
    const auto [begin, end] = sampled_level(levels);
    sample = CloudStream::sample(source(), begin, end);
  }
  wrap(*records);
  const std::uint64_t available = available_memory_bytes();
  const std::uint64_t memory = memory_bytes();
  const char* why = why_in_memory();
  const bool fits = wanted() <= memory / kSurfelBytes;
  // Levels of detail stay in the file even if they fit, because a picture needs few of them.
  const bool few =
      has_levels && options.columns.levels && batch(memory, index_bytes()) >= kLeastBatch;
  if (!why && (few || !fits)) make_stream(memory);
  if (stream) {
    if (options.sample && !has_levels) sample = CloudStream::sample(source(), 0, source().size());
    return true;
  }
  if (!fits && (options.memory || wanted() > available / kSurfelBytes)) {
    throw_input(ply->name(),
                fmt::format("{} surfels need more than the {} MB of `memory`, and {}", wanted(),
                            memory >> 20,
                            why ? why
                                : "consecutive ones do not lie close together, as streaming "
                                  "wants; raise it, or " +
                                      range_advice(ply->name())));
  }
  if (has_levels) {
    surfels.emplace(source(), tree, options.columns, ply->name());
  } else {
    surfels.emplace(source(), options.columns, ply->name());
    sample_resident();
  }
  wrapped.reset();
  records.reset();
  return true;
}

void LoadedCloud::Impl::make_stream(std::uint64_t memory) {
  const std::size_t flight = batch(memory, index_bytes());
  if (flight < kLeastBatch) {
    const std::uint64_t streamed =
        index_bytes() + kLeastBatch * kFlightBytes * kPicturePart / (kPicturePart - 1);
    const std::uint64_t least = std::min(streamed, wanted() * kSurfelBytes);
    throw_input(ply->name(),
                fmt::format("{} surfels cannot be streamed with {} MB of `memory`; give {} MB at "
                            "least{}",
                            wanted(), memory >> 20, (least >> 20) + 1,
                            has_levels ? ", to each process where several draw them" : ""));
  }
  const std::uint64_t picture = (memory - index_bytes()) / kPicturePart;
  if (has_levels) {
    stream = CloudStream::make(
        source(), tree, options.columns.levels,
        {.batch = flight, .picture_bytes = picture, .places = options.columns.places}, ply->name());
  } else {
    stream = CloudStream::make(source(), {.batch = std::min(options.batch, flight),
                                          .picture_bytes = picture,
                                          .places = options.columns.places});
  }
}

void LoadedCloud::Impl::take_header(const SurfelCloud& header, const SurfelSource& from) {
  basis_cutoff = header.basis_cutoff;
  viewpoint = header.viewpoint;
  up = header.up;
  color_light = meaning_of_colors(header.color_light, from.attributes().color);
  // Recorded light differs from place to place; some programs write a colour that nobody chose.
  const bool unsaid = header.color_light == ColorLight::kUnsaid;
  if (unsaid && from.attributes().color && CloudStream::have_one_color(from)) {
    color_light = ColorLight::kReflectance;
  }
}

/// Lets the caller put another source in place of one.
void LoadedCloud::Impl::wrap(SurfelSource& inner) {
  if (!options.wrap) return;
  const auto take_sample = [&] {
    const auto [begin, end] =
        levels.empty() ? std::pair{std::size_t{0}, inner.size()} : sampled_level(levels);
    return CloudStream::sample(inner, begin, end);
  };
  wrapped = options.wrap({.source = inner,
                          .first_finest = levels.empty() ? 0 : levels.back().first_surfel,
                          .viewpoint = viewpoint,
                          .up = up,
                          .sample = take_sample});
}

/// Samples surfels in memory that have no levels of detail.
void LoadedCloud::Impl::sample_resident() {
  if (!options.sample) return;
  const RenderCloud& cloud = *surfels;
  const std::size_t total = cloud.size() + cloud.dropped().total() + cloud.copies();
  sample = sample_surface(cloud.size(), total, cloud.origin(),
                          [&](std::size_t i) { return cloud.sample_point(i); });
}

void LoadedCloud::Impl::load_cloud(const SurfelCloud& cloud, const std::string& name) {
  if (options.memory && cloud.size() > *options.memory / kSurfelBytes) {
    throw_input(name, fmt::format("{} surfels need more than the {} MB of `memory`, and only "
                                  "binary PLY files are streamed; raise it, or convert the file",
                                  cloud.size(), *options.memory >> 20));
  }
  levels = levels_of(cloud.tree);
  has_levels = !levels.empty();
  CloudSource all(cloud, name);
  take_header(cloud, all);
  wrap(all);
  SurfelSource& drawn = wrapped ? *wrapped : all;
  if (has_levels) {
    surfels.emplace(drawn, cloud.tree, options.columns, name);
  } else {
    surfels.emplace(drawn, options.columns, name);
  }
  wrapped.reset();
  if (!has_levels) return sample_resident();
  if (!options.sample) return;
  const auto [begin, end] = sampled_level(levels);
  sample = CloudStream::sample(all, begin, end);
}

std::vector<std::string> CloudLoadOptions::problems() const {
  return CloudStreamOptions{.batch = batch}.problems();
}

LoadedCloud::LoadedCloud(const std::string& path, const CloudLoadOptions& options)
    : impl_(std::make_unique<Impl>(options)) {
  require_usable(options);
  InputFile input(path);
  const std::string name = input.name();
  if (!impl_->load_records(input)) {
    // All levels are read even if the finest is drawn alone, so that all levels frame the picture
    // alike.
    const CloudReadOptions kLevels{.levels = true};
    impl_->load_cloud(
        impl_->ply ? read_cloud(*impl_->ply, kLevels) : read_cloud(std::move(input), kLevels),
        name);
    impl_->ply.reset();
  }
  require_drawable(surfels(), name);
}

LoadedCloud::LoadedCloud(const SurfelCloud& cloud, const std::string& name,
                         const CloudLoadOptions& options)
    : impl_(std::make_unique<Impl>(options)) {
  require_usable(options);
  impl_->load_cloud(cloud, name);
  require_drawable(surfels(), name);
}

LoadedCloud::~LoadedCloud() = default;

const RenderCloud& LoadedCloud::surfels() const {
  return impl_->stream ? impl_->stream->cloud() : *impl_->surfels;
}
ClusterStore& LoadedCloud::store() const {
  if (impl_->stream) return *impl_->stream;
  return *impl_->surfels;
}
std::optional<double> LoadedCloud::basis_cutoff() const { return impl_->basis_cutoff; }
const std::optional<Viewpoint>& LoadedCloud::viewpoint() const { return impl_->viewpoint; }
const std::optional<Vec3d>& LoadedCloud::up() const { return impl_->up; }
ColorLight LoadedCloud::color_light() const { return impl_->color_light; }
const SurfaceSample& LoadedCloud::sample() const { return impl_->sample; }
bool LoadedCloud::has_levels() const { return impl_->has_levels; }

}  // namespace surfel
