#include <algorithm>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/scratch_file.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/row_file.h>
#include <surfel/io/spooled_writer.h>

namespace surfel {
namespace {

/// Surfels whose records are made, or moved, at a time.
constexpr std::size_t kSpooledRows = 1 << 14;
constexpr std::size_t kSpooledGrain = 1 << 10;

}  // namespace

struct SpooledWriter::Impl {
  std::string path;
  bool no_clobber;
  ScratchFile scratch;
  SurfelCloud like;
  std::vector<RecordColumn> columns;
  std::size_t stride = 0;
  std::size_t count = 0;

  Impl(std::string to, bool keep) : path(std::move(to)), no_clobber(keep), scratch(path) {}
};

SpooledWriter::SpooledWriter(std::string path, bool no_clobber) {
  const std::string extension = lower_extension(path);
  if (!extension.empty() && extension != ".ply") {
    throw_usage(
        fmt::format("{}: surfels that do not fit into memory are written as PLY; give a "
                    ".ply",
                    path));
  }
  impl_ = std::make_unique<Impl>(std::move(path), no_clobber);
}
SpooledWriter::~SpooledWriter() = default;

void SpooledWriter::append(const SurfelCloud& piece) {
  Impl& w = *impl_;
  if (piece.empty()) return;
  piece.check_columns(w.path);
  const CloudRecords records(piece, {});
  if (w.columns.empty()) {
    w.columns = records.columns();
    w.stride = records.stride();
    w.like = piece.gathered({0});
  }
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

void SpooledWriter::commit() {
  Impl& w = *impl_;
  RowFile file(w.path, {.no_clobber = w.no_clobber});
  file.begin(w.like, w.count);
  Array<std::byte> bytes;
  for (std::size_t first = 0; first < w.count; first += kSpooledRows) {
    const std::size_t count = std::min(kSpooledRows, w.count - first);
    bytes.resize(count * w.stride);
    w.scratch.read_at(first * w.stride, bytes.data(), bytes.size());
    file.put_records(bytes.data(), count, first);
  }
  file.commit();
}

}  // namespace surfel
