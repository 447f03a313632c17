#include <algorithm>
#include <bit>
#include <cstring>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/resume_journal.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/row_file.h>
#include <surfel/io/tree_records.h>

namespace surfel {
namespace {

/// Records that one thread makes at a time: they fit into its cache.
constexpr std::size_t kRowGrain = 4096;
/// Bytes that are read at a time to be checked.
constexpr std::size_t kCheckedBytes = std::size_t{1} << 20;

/// The head of a journal's entry; after it come `spans` of KeptSpan, then the state.
struct KeptPart {
  std::uint64_t part;
  std::uint64_t spans;
};
struct KeptSpan {
  RowSpan rows;
  std::uint64_t checksum;
};

}  // namespace

struct RowFile::Impl {
  std::string name;
  RowFileOptions options;
  OutputFile file;
  ResumeJournal journal;
  Vec3d origin{0, 0, 0};
  std::uint64_t rows = 0;
  std::uint64_t rows_at = 0;  ///< Where they begin in the file.
  std::size_t stride = 0;
  std::mutex mutex;  ///< Of the journal.
  std::map<std::uint64_t, std::string> kept;
  std::uint64_t rows_kept = 0;

  Impl(const std::string& path, const RowFileOptions& o)
      : name(path),
        options(o),
        file(path, o.no_clobber, o.job.empty() ? Unfinished::kRemoved : Unfinished::kKept),
        journal(file.temporary() + "-parts") {}
  std::uint64_t checksum(const RowSpan& span) const;
  void take(const std::string& entry);
};

/// A checksum of the checksums of pieces.
std::uint64_t RowFile::Impl::checksum(const RowSpan& span) const {
  std::vector<std::uint32_t> sums;
  Array<std::byte> bytes(kCheckedBytes);
  const std::uint64_t end = rows_at + span.end * stride;
  for (std::uint64_t at = rows_at + span.begin * stride; at < end; at += kCheckedBytes) {
    const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(kCheckedBytes, end - at));
    const std::size_t got = file.read_at(at, bytes.data(), wanted);
    sums.push_back(crc32c(std::span<const std::byte>(bytes).first(got)));
  }
  return crc32c(std::as_bytes(std::span(sums)));
}

/// Takes over a part that an earlier run made, if its rows are there.
void RowFile::Impl::take(const std::string& entry) {
  KeptPart head{};
  if (entry.size() < sizeof(head)) return;
  std::memcpy(&head, entry.data(), sizeof(head));
  const std::size_t room = (entry.size() - sizeof(head)) / sizeof(KeptSpan);
  if (head.spans > room) return;
  std::uint64_t count = 0;
  for (std::size_t s = 0; s < head.spans; ++s) {
    KeptSpan span{};
    std::memcpy(&span, entry.data() + sizeof(head) + s * sizeof(span), sizeof(span));
    if (span.rows.begin > span.rows.end || span.rows.end > rows) return;
    if (span.checksum != checksum(span.rows)) return;
    count += span.rows.end - span.rows.begin;
  }
  kept[head.part] = entry.substr(sizeof(head) + head.spans * sizeof(KeptSpan));
  rows_kept += count;
}

RowFile::RowFile(const std::string& path, const RowFileOptions& options)
    : impl_(std::make_unique<Impl>(path, options)) {}
RowFile::~RowFile() = default;

void RowFile::begin(const SurfelCloud& like, std::uint64_t rows, std::uint64_t clusters) {
  static_assert(std::endian::native == std::endian::little, "records are written as they are");
  Impl& f = *impl_;
  const CloudRecords records(like, {});
  const std::string header =
      cloud_ply_header(like.gathered({}), records.columns(), rows, clusters, false);
  f.origin = like.origin;
  f.rows = rows;
  f.rows_at = header.size();
  f.stride = records.stride();
  f.kept.clear();
  f.rows_kept = 0;
  if (!f.options.job.empty()) {
    for (const std::string& entry : f.journal.open(f.options.job + "\n" + header)) f.take(entry);
  }
  if (f.kept.empty()) f.file.clear();
  f.file.write_at(0, header.data(), header.size());
}

std::size_t RowFile::stride() const { return impl_->stride; }

void RowFile::put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::uint64_t at) {
  const CloudRecords records(part, {});
  if (records.stride() != impl_->stride) {
    throw_input(impl_->name, "parts of the cloud differ in their columns");
  }
  parallel_for(end - begin, kRowGrain, [&](std::size_t first, std::size_t last, int) {
    static thread_local Array<std::byte> buffer;
    buffer.resize(kRowGrain * records.stride());
    records.encode(begin + first, begin + last, buffer.data());
    put_records(buffer.data(), last - first, at + first);
  });
}

void RowFile::put_records(const std::byte* records, std::size_t count, std::uint64_t at) {
  impl_->file.write_at(impl_->rows_at + at * impl_->stride, records, count * impl_->stride);
}

void RowFile::put_tree(const ClusterTree& tree) {
  std::uint64_t at = impl_->rows_at + impl_->rows * impl_->stride;
  for (std::size_t begin = 0; begin < tree.size(); begin += kRowGrain) {
    const std::span<const TreeCluster> clusters =
        std::span(tree).subspan(begin, std::min(kRowGrain, tree.size() - begin));
    const Array<std::byte> records = tree_to_records(clusters, impl_->origin);
    impl_->file.write_at(at, records.data(), records.size());
    at += records.size();
  }
}

void RowFile::commit() {
  impl_->file.commit();
  if (!impl_->options.job.empty()) impl_->journal.remove();
}

std::optional<std::string> RowFile::finished(std::uint64_t part) {
  const std::lock_guard lock(impl_->mutex);
  const auto found = impl_->kept.find(part);
  if (found == impl_->kept.end()) return std::nullopt;
  std::string state = std::move(found->second);
  impl_->kept.erase(found);
  return state;
}

void RowFile::finish(std::uint64_t part, std::span<const RowSpan> rows, const std::string& state) {
  if (impl_->options.job.empty()) return;
  const KeptPart head{part, rows.size()};
  std::string entry(reinterpret_cast<const char*>(&head), sizeof(head));
  for (const RowSpan& span : rows) {
    const KeptSpan kept{span, impl_->checksum(span)};
    entry.append(reinterpret_cast<const char*>(&kept), sizeof(kept));
  }
  entry += state;
  const std::lock_guard lock(impl_->mutex);
  impl_->journal.add(entry);
}

std::uint64_t RowFile::rows_kept() const { return impl_->rows_kept; }

}  // namespace surfel
