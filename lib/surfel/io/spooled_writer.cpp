#include <algorithm>
#include <cstring>
#include <filesystem>
#include <optional>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/scratch_file.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/row_file.h>
#include <surfel/io/spooled_writer.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

/// Surfels whose records are made, or moved, at a time.
constexpr std::size_t kSpooledRows = 1 << 14;
constexpr std::size_t kSpooledGrain = 1 << 10;

/// The head of what is kept of a part; the state follows.
struct KeptSpool {
  std::uint64_t with_rows;
  std::uint64_t header;      ///< Checksum of the columns.
  std::uint64_t begin, end;  ///< Rows on the scratch file.
  std::uint64_t checksum;    ///< Of these.
};

}  // namespace

struct SpooledWriter::Impl {
  std::string path;
  RowFile file;
  ScratchFile scratch;
  bool keeps;
  std::uint64_t left = 0;  ///< Bytes on the scratch file that an earlier run has left.
  SurfelCloud like;
  std::vector<RecordColumn> columns;
  std::uint64_t header = 0;
  std::size_t stride = 0;
  std::size_t count = 0;
  std::size_t finished = 0;  ///< Surfels of finished parts.
  std::size_t kept = 0;
  bool follows = true;  ///< All parts that have been asked for were there.

  Impl(std::string to, const SpoolOptions& options)
      : path(std::move(to)),
        file(path, {.no_clobber = options.no_clobber, .job = options.job}),
        scratch(path, options.job.empty() ? std::string() : path + ".unfinished-scratch"),
        keeps(!options.job.empty()) {
    std::error_code none;
    if (keeps) left = std::filesystem::file_size(path + ".unfinished-scratch", none);
    if (none) left = 0;
  }

  std::uint64_t checksum(std::size_t begin, std::size_t end) const;
  void drop_rest();
};

/// A checksum of the checksums of pieces.
std::uint64_t SpooledWriter::Impl::checksum(std::size_t begin, std::size_t end) const {
  std::vector<std::uint32_t> sums;
  Array<std::byte> bytes;
  for (std::size_t first = begin; first < end; first += kSpooledRows) {
    bytes.resize(std::min(kSpooledRows, end - first) * stride);
    scratch.read_at(first * stride, bytes.data(), bytes.size());
    sums.push_back(crc32c(bytes));
  }
  return crc32c(std::as_bytes(std::span(sums)));
}

/// From here on parts are made anew.
void SpooledWriter::Impl::drop_rest() {
  if (!follows) return;
  follows = false;
  if (!scratch.keep(count * stride)) throw_io(path, "what was written beside it cannot be cut");
}

SpooledWriter::SpooledWriter(std::string path, const SpoolOptions& options) {
  const std::string extension = lower_extension(path);
  if (!extension.empty() && extension != ".ply") {
    throw_usage(fmt::format(
        "{}: surfels that are made block by block are written as PLY; give a .ply", path));
  }
  impl_ = std::make_unique<Impl>(std::move(path), options);
}
SpooledWriter::~SpooledWriter() = default;

void SpooledWriter::begin(const SurfelCloud& like) {
  Impl& w = *impl_;
  const CloudRecords records(like, {});
  w.columns = records.columns();
  w.stride = records.stride();
  w.like = like;
  const std::string header = cloud_ply_header(like.gathered({}), w.columns, 0, 0, false);
  w.header = crc32c(std::as_bytes(std::span(header.data(), header.size())));
}

void SpooledWriter::append(const SurfelCloud& piece) {
  Impl& w = *impl_;
  if (piece.empty()) return;
  w.drop_rest();
  piece.check_columns(w.path);
  const CloudRecords records(piece, {});
  if (!same_columns(w.columns, records.columns()))
    throw_input(w.path, "pieces of the cloud differ in their columns");
  Array<std::byte> bytes;
  for (std::size_t first = 0; first < piece.size(); first += kSpooledRows) {
    const std::size_t count = std::min(kSpooledRows, piece.size() - first);
    bytes.resize(count * w.stride);
    parallel_for(count, kSpooledGrain, [&](std::size_t begin, std::size_t end, int) {
      records.encode(first + begin, first + end, bytes.data() + begin * w.stride);
    });
    w.scratch.append(bytes.data(), bytes.size());
  }
  w.count += piece.size();
}

std::size_t SpooledWriter::surfels() const { return impl_->count; }
std::size_t SpooledWriter::kept() const { return impl_->kept; }

void SpooledWriter::commit() {
  Impl& w = *impl_;
  w.file.begin(w.like, w.count);
  Array<std::byte> bytes;
  for (std::size_t first = 0; first < w.count; first += kSpooledRows) {
    const std::size_t count = std::min(kSpooledRows, w.count - first);
    bytes.resize(count * w.stride);
    w.scratch.read_at(first * w.stride, bytes.data(), bytes.size());
    w.file.put_records(bytes.data(), count, first);
  }
  w.file.commit();
  w.scratch.remove();
}

std::optional<std::string> SpooledWriter::finished(std::uint64_t part) {
  Impl& w = *impl_;
  const std::optional<std::string> found = w.file.finished(part);
  KeptSpool head{};
  if (!found || found->size() < sizeof(head)) return std::nullopt;
  std::memcpy(&head, found->data(), sizeof(head));
  std::string state = found->substr(sizeof(head));
  if (head.with_rows == 0) return state;
  const bool there = w.follows && head.header == w.header && head.begin == w.count &&
                     head.end >= head.begin && head.end * w.stride <= w.left &&
                     head.checksum == w.checksum(head.begin, head.end);
  if (!there) return std::nullopt;
  w.count = w.finished = head.end;
  w.kept += head.end - head.begin;
  return state;
}

void SpooledWriter::finish(std::uint64_t part, std::span<const RowSpan> rows,
                           const std::string& state) {
  Impl& w = *impl_;
  if (!w.keeps) return;
  KeptSpool head{};
  if (!rows.empty()) {
    head = {1, w.header, w.finished, w.count, w.checksum(w.finished, w.count)};
    w.finished = w.count;
  }
  w.file.finish(part, {}, std::string(reinterpret_cast<const char*>(&head), sizeof(head)) + state);
}

}  // namespace surfel
