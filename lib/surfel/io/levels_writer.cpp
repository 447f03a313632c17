#include <algorithm>
#include <bit>
#include <span>
#include <utility>

#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/levels_writer.h>
#include <surfel/io/tree_records.h>

namespace surfel {
namespace {

/// Records that one thread makes at a time: they fit into its cache.
constexpr std::size_t kRecords = 4096;

}  // namespace

struct LevelsWriter::Impl {
  std::string provenance;
  OutputFile file;
  Vec3d origin{0, 0, 0};
  std::uint64_t surfels_at = 0;  ///< Where the records of the surfels begin in the file.

  Impl(std::string path, std::string line, bool no_clobber)
      : provenance(std::move(line)), file(std::move(path), no_clobber) {}
};

LevelsWriter::LevelsWriter(std::string path, std::string provenance, bool no_clobber)
    : impl_(std::make_unique<Impl>(std::move(path), std::move(provenance), no_clobber)) {}
LevelsWriter::~LevelsWriter() = default;

void LevelsWriter::begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) {
  static_assert(std::endian::native == std::endian::little, "records are written as they are");
  SurfelCloud described = like.gathered({});
  if (!impl_->provenance.empty()) described.provenance.push_back(impl_->provenance);
  const CloudRecords records(like, {});
  impl_->origin = like.origin;
  impl_->file.write(cloud_ply_header(described, records.columns(), surfels, clusters, false));
  impl_->surfels_at = impl_->file.reserve(std::uint64_t{surfels} * records.stride());
}

void LevelsWriter::put(const SurfelCloud& part, std::size_t begin, std::size_t end,
                       std::size_t at) {
  const CloudRecords records(part, {});
  const std::size_t stride = records.stride();
  parallel_for(end - begin, kRecords, [&](std::size_t first, std::size_t last, int) {
    static thread_local Array<std::byte> buffer;
    buffer.resize(kRecords * stride);
    records.encode(begin + first, begin + last, buffer.data());
    impl_->file.write_at(impl_->surfels_at + (at + first) * stride, buffer.data(),
                         (last - first) * stride);
  });
}

void LevelsWriter::finish(ClusterTree tree) {
  for (std::size_t begin = 0; begin < tree.size(); begin += kRecords) {
    const std::span<const TreeCluster> clusters =
        std::span(tree).subspan(begin, std::min(kRecords, tree.size() - begin));
    const Array<std::byte> records = tree_to_records(clusters, impl_->origin);
    impl_->file.write(records.data(), records.size());
  }
}

void LevelsWriter::commit() { impl_->file.commit(); }

}  // namespace surfel
