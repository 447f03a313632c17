#include <algorithm>
#include <bit>
#include <memory>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/input_file.h>
#include <surfel/io/ply.h>
#include <surfel/render/cloud_loader.h>
#include <surfel/render/cloud_stream.h>
#include <surfel/render/record_source.h>

namespace surfel {
namespace {

/// Bytes of a surfel in memory, roughly: its columns, its share of a cluster.
constexpr std::uint64_t kSurfelBytes = 64;
/// Bytes of a cluster that stays in its file, and of a surfel in flight: its columns, its splat and
/// the tiles that it touches.
constexpr std::uint64_t kStreamedClusterBytes = 240;
constexpr std::uint64_t kFlightBytes = 512;
constexpr std::size_t kLeastBatch = std::size_t{1} << 14;

/// The points as records, if the file is a binary PLY file of scalars; else null.
const RecordTable* binary_records(PlyFile& ply) {
  const PlyElement* vertex = ply.header().find("vertex");
  const bool plain = vertex && ply.header().format == PlyFormat::kBinaryLittleEndian &&
                     std::none_of(vertex->properties.begin(), vertex->properties.end(),
                                  [](const PlyProperty& property) { return property.is_list(); });
  return plain ? &ply.scalars("vertex") : nullptr;
}

}  // namespace

struct LoadedCloud::Impl {
  // Each refers to the one before.
  std::optional<PlyFile> ply;
  std::unique_ptr<RecordSource> source;
  std::unique_ptr<CloudStream> stream;
  std::optional<RenderCloud> surfels;
  std::optional<double> basis_cutoff;
  std::size_t batch = 0;

  bool load_records(InputFile& input, const CloudLoadOptions& options);
  void make_stream(const CloudLoadOptions& options, std::uint64_t memory);
};

/// False if the file is to be read as a SurfelCloud.
bool LoadedCloud::Impl::load_records(InputFile& input, const CloudLoadOptions& options) {
  if (!PlyFile::matches(input.bytes())) return false;
  ply.emplace(std::move(input));
  const RecordTable* table = binary_records(*ply);
  source = table ? RecordSource::make(ply->file(), *table) : nullptr;
  if (!source) return false;
  SurfelCloud header;
  read_comments(ply->header().comments, ply->name(), header);
  basis_cutoff = header.basis_cutoff;
  const std::uint64_t available = available_memory_bytes();
  const std::uint64_t memory = options.memory.value_or(available / 4 * 3);
  if (source->size() > memory / kSurfelBytes) {
    if (options.may_stream && !options.columns.groups) make_stream(options, memory);
    if (stream) return true;
    if (options.memory || source->size() > available / kSurfelBytes) {
      throw_input(
          ply->name(),
          fmt::format("{} surfels need more than the {} MB of --memory, and {}", source->size(),
                      memory >> 20,
                      options.may_stream && !options.columns.groups
                          ? "consecutive ones do not lie close together, as streaming wants; "
                            "raise it, or sort them"
                          : "what is asked for wants all of them at once; raise it, or use "
                            "--method abuffer"));
    }
  }
  surfels.emplace(*source, options.columns, ply->name());
  source.reset();
  return true;
}

void LoadedCloud::Impl::make_stream(const CloudLoadOptions& options, std::uint64_t memory) {
  const std::uint64_t index = source->size() / RenderCloud::kClusterSize * kStreamedClusterBytes;
  const std::uint64_t left = memory > index ? (memory - index) / kFlightBytes : 0;
  if (left < kLeastBatch) {
    throw_input(ply->name(),
                fmt::format("{} surfels cannot be streamed with {} MB of --memory; give {} MB at "
                            "least",
                            source->size(), memory >> 20,
                            ((index + kLeastBatch * kFlightBytes) >> 20) + 1));
  }
  batch = std::min<std::size_t>(options.batch, std::bit_floor(left));
  stream = CloudStream::make(*source, batch);
}

LoadedCloud::LoadedCloud(const std::string& path, const CloudLoadOptions& options)
    : impl_(std::make_unique<Impl>()) {
  InputFile input(path);
  const std::string name = input.name();
  if (impl_->load_records(input, options)) return;
  const SurfelCloud cloud = impl_->ply ? read_cloud(*impl_->ply) : read_cloud(std::move(input));
  if (cloud.variance.empty() && !cloud.anisotropic()) throw_no_variance(name);
  if (options.memory && cloud.size() > *options.memory / kSurfelBytes) {
    throw_input(name, fmt::format("{} surfels need more than the {} MB of --memory, and only "
                                  "binary PLY files are streamed; raise it, or convert the file",
                                  cloud.size(), *options.memory >> 20));
  }
  CloudSource source(cloud);
  impl_->surfels.emplace(source, options.columns, name);
  impl_->basis_cutoff = cloud.basis_cutoff;
  impl_->ply.reset();
}

LoadedCloud::~LoadedCloud() = default;

const RenderCloud& LoadedCloud::surfels() const {
  return impl_->stream ? impl_->stream->cloud() : *impl_->surfels;
}
CloudStream* LoadedCloud::stream() const { return impl_->stream.get(); }
std::optional<double> LoadedCloud::basis_cutoff() const { return impl_->basis_cutoff; }
std::size_t LoadedCloud::batch() const { return impl_->batch; }

}  // namespace surfel
