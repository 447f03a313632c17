#include <algorithm>
#include <bit>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <mutex>
#include <system_error>
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

/// An entry of a journal.
struct Entry {
  KeptPart head;
  std::vector<KeptSpan> spans;
  std::size_t state_at;  ///< Where the state begins.
};

std::optional<Entry> entry_of(const std::string& entry) {
  Entry out{};
  if (entry.size() < sizeof(out.head)) return std::nullopt;
  std::memcpy(&out.head, entry.data(), sizeof(out.head));
  if (out.head.spans > (entry.size() - sizeof(out.head)) / sizeof(KeptSpan)) return std::nullopt;
  out.spans.resize(out.head.spans);
  out.state_at = sizeof(out.head) + out.spans.size() * sizeof(KeptSpan);
  if (!out.spans.empty()) {
    std::memcpy(out.spans.data(), entry.data() + sizeof(out.head),
                out.spans.size() * sizeof(KeptSpan));
  }
  return out;
}

constexpr const char* kListSuffix = "-parts";

/// The lists of parts that runs of one or several processes have left: the first process's, and the
/// lists of the other processes, which have a number behind its name, in the order of the numbers.
std::vector<std::string> lists_beside(const std::string& list) {
  namespace fs = std::filesystem;
  std::vector<std::string> found;
  const std::string prefix = fs::path(list).filename().string() + "-";
  const fs::path folder = fs::path(list).parent_path();
  std::error_code error;
  std::vector<int> numbers;
  for (fs::directory_iterator at(folder.empty() ? "." : folder, error), end; !error && at != end;
       at.increment(error)) {
    const std::string name = at->path().filename().string();
    constexpr std::size_t kMostDigits = 9;
    if (!name.starts_with(prefix) || name.size() - prefix.size() > kMostDigits) continue;
    const std::string digits = name.substr(prefix.size());
    if (digits.empty() || digits.find_first_not_of("0123456789") != std::string::npos) continue;
    numbers.push_back(std::stoi(digits));
  }
  std::sort(numbers.begin(), numbers.end());
  found.push_back(list);
  for (const int number : numbers) found.push_back(list + "-" + std::to_string(number));
  return found;
}

}  // namespace

struct RowFile::Impl {
  std::string name;
  RowFileOptions options;
  std::optional<OutputFile> file;
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

  Impl(const std::string& path, const RowFileOptions& o);
  bool follows() const { return options.peers && options.peers->rank() > 0; }
  void share();
  std::uint64_t checksum(const RowSpan& span) const;
  bool is_there(const std::string& entry) const;
  void take(const std::string& entry);
  void take_parts();
};

RowFile::Impl::Impl(const std::string& path, const RowFileOptions& o) : name(path), options(o) {
  if (!follows()) {
    file.emplace(path, o.no_clobber, o.job.empty() ? Unfinished::kRemoved : Unfinished::kKept);
  }
  if (options.peers) share();
  if (options.job.empty()) return;
  const std::string list = file->temporary() + kListSuffix;
  for (const std::string& some : lists_beside(list)) {
    std::vector<std::string> kept = ResumeJournal(some, options.job).take_entries();
    std::move(kept.begin(), kept.end(), std::back_inserter(entries));
  }
  journal.emplace(follows() ? list + "-" + std::to_string(options.peers->rank()) : list,
                  options.job);
  journal->take_entries();
  std::erase_if(entries, [&](const std::string& entry) {
    const std::optional<Entry> read = entry_of(entry);
    if (read && read->spans.empty()) take(entry);
    return !read || read->spans.empty();
  });
}

/// Tells the other processes which file they write to, and the job.
void RowFile::Impl::share() {
  Peers& peers = *options.peers;
  std::vector<Bytes> to(static_cast<std::size_t>(peers.count()));
  if (!follows()) {
    const std::string told = file->temporary() + '\0' + options.job;
    for (Bytes& bytes : to) append_values(told.data(), told.size(), bytes);
  }
  const std::vector<char> told = values_of<char>(peers.exchange(std::move(to)).front());
  const auto end = std::find(told.begin(), told.end(), '\0');
  if (!follows()) return;
  file.emplace(std::string(told.begin(), end), false, Unfinished::kElsewhere);
  options.job = end == told.end() ? std::string() : std::string(end + 1, told.end());
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

/// Are the rows of a part that an earlier run made there?
bool RowFile::Impl::is_there(const std::string& entry) const {
  const std::optional<Entry> read = entry_of(entry);
  if (!read || read->head.header != header) return false;
  return std::all_of(read->spans.begin(), read->spans.end(), [&](const KeptSpan& span) {
    return span.rows.begin <= span.rows.end && span.rows.end <= rows &&
           span.checksum == checksum(span.rows);
  });
}

/// Takes over a part whose rows are there, or that has none.
void RowFile::Impl::take(const std::string& entry) {
  const std::optional<Entry> read = entry_of(entry);
  std::uint64_t count = 0;
  for (const KeptSpan& span : read->spans) count += span.rows.end - span.rows.begin;
  const bool is_new = (read->spans.empty() ? facts : parts)
                          .insert_or_assign(read->head.part, entry.substr(read->state_at))
                          .second;
  if (is_new) rows_kept += count;
}

/// Takes over the parts whose rows are there. Each process looks at some, and all learn of all.
void RowFile::Impl::take_parts() {
  const auto count = static_cast<std::size_t>(options.peers ? options.peers->count() : 1);
  const auto rank = static_cast<std::size_t>(options.peers ? options.peers->rank() : 0);
  std::vector<std::uint8_t> mine;
  for (std::size_t e = rank; e < entries.size(); e += count) {
    mine.push_back(is_there(entries[e]) ? 1 : 0);
  }
  const std::vector<std::vector<std::uint8_t>> there = gather_lists(options.peers, mine);
  std::vector<std::string> left;
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const std::vector<std::uint8_t>& looked = there[e % count];
    if (e / count < looked.size() && looked[e / count] != 0) {
      take(entries[e]);
      // States may take as much memory as the result of the work: they are there once.
      std::string().swap(entries[e]);
    } else {
      left.push_back(std::move(entries[e]));
    }
  }
  entries = std::move(left);
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
  if (!f.options.job.empty()) f.take_parts();
  if (!f.follows()) {
    if (f.rows_kept == 0) f.file->clear();
    f.file->write_at(0, header.data(), header.size());
  }
  // No process writes before the file has been cleared.
  if (f.options.peers) gather_lists(f.options.peers, std::vector<char>());
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
  if (impl_->options.job.empty()) return;
  for (const std::string& list : lists_beside(impl_->file->temporary() + kListSuffix)) {
    ResumeJournal(list, impl_->options.job).remove();
  }
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
