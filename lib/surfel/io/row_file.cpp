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
#include <surfel/io/text_scanner.h>
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
  std::uint64_t header;  ///< Checksum of the file's header.
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
  std::optional<OutputFile> file;  ///< Of a process that follows another none before begin().
  std::optional<ResumeJournal> journal;
  Vec3d origin{0, 0, 0};
  std::uint64_t rows = 0;
  std::uint64_t rows_at = 0;  ///< Where they begin in the file.
  std::vector<RecordColumn> columns;
  std::size_t stride = 0;
  std::uint64_t header = 0;                           ///< Checksum of the header.
  std::vector<std::string> entries;                   ///< Of earlier runs.
  std::mutex mutex;                                   ///< Of the journal.
  std::map<std::uint64_t, std::string> parts, facts;  ///< States of parts with rows, and without.
  std::uint64_t rows_kept = 0;

  Impl(const std::string& path, const RowFileOptions& o) : name(path), options(o) {
    if (follows()) return;
    file.emplace(path, o.no_clobber, o.job.empty() ? Unfinished::kRemoved : Unfinished::kKept);
    if (options.job.empty()) return;
    journal.emplace(file->temporary() + "-parts", options.job);
    entries = journal->take_entries();
    std::erase_if(entries, [&](const std::string& entry) { return take(entry, false); });
  }
  bool follows() const { return options.peers && options.peers->rank() > 0; }
  void share();
  std::uint64_t checksum(const RowSpan& span) const;
  bool take(const std::string& entry, bool with_rows);
};

/// Tells the other processes which file they write to.
void RowFile::Impl::share() {
  Peers& peers = *options.peers;
  std::vector<Bytes> to(static_cast<std::size_t>(peers.count()));
  if (!follows()) {
    const std::string& temporary = file->temporary();
    for (Bytes& bytes : to) append_values(temporary.data(), temporary.size(), bytes);
  }
  const std::vector<char> path = values_of<char>(peers.exchange(std::move(to)).front());
  if (follows()) file.emplace(std::string(path.begin(), path.end()), false, Unfinished::kElsewhere);
}

/// A checksum of the checksums of pieces.
std::uint64_t RowFile::Impl::checksum(const RowSpan& span) const {
  std::vector<std::uint32_t> sums;
  Array<std::byte> bytes(kCheckedBytes);
  const std::uint64_t end = rows_at + span.end * stride;
  for (std::uint64_t at = rows_at + span.begin * stride; at < end; at += kCheckedBytes) {
    const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(kCheckedBytes, end - at));
    const std::size_t got = file->read_at(at, bytes.data(), wanted);
    sums.push_back(crc32c(std::span<const std::byte>(bytes).first(got)));
  }
  return crc32c(std::as_bytes(std::span(sums)));
}

/// Takes over a part that an earlier run made: one with rows, if these are there, or one without.
/// Did it?
bool RowFile::Impl::take(const std::string& entry, bool with_rows) {
  KeptPart head{};
  if (entry.size() < sizeof(head)) return false;
  std::memcpy(&head, entry.data(), sizeof(head));
  const std::size_t room = (entry.size() - sizeof(head)) / sizeof(KeptSpan);
  if (head.spans > room || (head.spans > 0) != with_rows) return false;
  if (with_rows && head.header != header) return false;
  std::uint64_t count = 0;
  for (std::size_t s = 0; s < head.spans; ++s) {
    KeptSpan span{};
    std::memcpy(&span, entry.data() + sizeof(head) + s * sizeof(span), sizeof(span));
    if (span.rows.begin > span.rows.end || span.rows.end > rows) return false;
    if (span.checksum != checksum(span.rows)) return false;
    count += span.rows.end - span.rows.begin;
  }
  const bool is_new =
      (with_rows ? parts : facts)
          .insert_or_assign(head.part, entry.substr(sizeof(head) + head.spans * sizeof(KeptSpan)))
          .second;
  if (is_new) rows_kept += count;
  return true;
}

RowFile::RowFile(const std::string& path, const RowFileOptions& options) {
  const std::string extension = lower_extension(path);
  if (!extension.empty() && extension != ".ply") {
    throw_usage(path + ": parts are written to binary PLY alone; give a .ply");
  }
  impl_ = std::make_unique<Impl>(path, options);
}
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
  f.columns = records.columns();
  f.stride = records.stride();
  f.header = crc32c(std::as_bytes(std::span(header.data(), header.size())));
  f.parts.clear();
  f.rows_kept = 0;
  // States may take as much memory as the result of the work: they are there once.
  std::erase_if(f.entries, [&](const std::string& entry) { return f.take(entry, true); });
  if (!f.follows()) {
    if (f.rows_kept == 0) f.file->clear();
    f.file->write_at(0, header.data(), header.size());
  }
  if (f.options.peers) f.share();
}

std::size_t RowFile::stride() const { return impl_->stride; }

void RowFile::put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::uint64_t at) {
  const CloudRecords records(part, {});
  if (!same_columns(impl_->columns, records.columns())) {
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
  impl_->file->write_at(impl_->rows_at + at * impl_->stride, records, count * impl_->stride);
}

void RowFile::put_tree(const ClusterTree& tree) {
  std::uint64_t at = impl_->rows_at + impl_->rows * impl_->stride;
  for (std::size_t begin = 0; begin < tree.size(); begin += kRowGrain) {
    const std::span<const TreeCluster> clusters =
        std::span(tree).subspan(begin, std::min(kRowGrain, tree.size() - begin));
    const Array<std::byte> records = tree_to_records(clusters, impl_->origin);
    impl_->file->write_at(at, records.data(), records.size());
    at += records.size();
  }
}

void RowFile::commit() {
  // All others have written what they had to.
  if (impl_->options.peers) gather_lists(impl_->options.peers, std::vector<char>());
  if (impl_->follows()) return;
  impl_->file->commit();
  if (!impl_->options.job.empty()) impl_->journal->remove();
}

std::optional<std::string> RowFile::finished(std::uint64_t part) {
  const std::lock_guard lock(impl_->mutex);
  for (auto* const states : {&impl_->parts, &impl_->facts}) {
    if (auto found = states->extract(part)) return std::move(found.mapped());
  }
  return std::nullopt;
}

void RowFile::finish(std::uint64_t part, std::span<const RowSpan> rows, const std::string& state) {
  if (impl_->options.job.empty()) return;
  const KeptPart head{part, impl_->header, rows.size()};
  std::string entry(reinterpret_cast<const char*>(&head), sizeof(head));
  for (const RowSpan& span : rows) {
    const KeptSpan kept{span, impl_->checksum(span)};
    entry.append(reinterpret_cast<const char*>(&kept), sizeof(kept));
  }
  entry += state;
  const std::lock_guard lock(impl_->mutex);
  impl_->journal->add(entry);
}

std::uint64_t RowFile::rows_kept() const { return impl_->rows_kept; }

}  // namespace surfel
