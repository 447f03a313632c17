#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/base/peers.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// How a RowFile is written: in one go or taken up again, alone or by several processes.
struct RowFileOptions {
  bool no_clobber = false;
  /// What is made of what, in words that differ where the result would. If there are any, a run
  /// that ends early leaves FILE.unfinished and FILE.unfinished-parts, with which the next run of
  /// the same job goes on; of several processes each has a list of its own (-parts-1 and so on),
  /// and the next run may have any number of processes. Of these the first one's job counts.
  std::string job = {};
  /// Processes that write the file together, each some parts: all of them make a RowFile and call
  /// begin() and commit() with the same arguments, and the first one's file is what the others
  /// write to, on a disk that all share. Null: this process alone.
  Peers* peers = nullptr;
};

/// A binary PLY file whose rows are written in any order, part by part, without holding them in
/// memory: the bytes that write_cloud() writes of all rows together.
class SURFEL_API RowFile final : public Checkpoints {
 public:
  /// Opens a file, as OutputFile does; "-" is standard output, where nothing can be kept. Throws
  /// Error(kUsage) for names of other formats.
  explicit RowFile(const std::string& path, const RowFileOptions& options = {});
  ~RowFile() override;

  /// Begins the file. What was written after an earlier call is void.
  /// \param like      A row or some with the columns of all, and what holds for the whole cloud.
  /// \param rows      Number of rows that will be written.
  /// \param clusters  Clusters of the tree that finish_tree() will write.
  void begin(const SurfelCloud& like, std::uint64_t rows, std::uint64_t clusters = 0);
  std::size_t stride() const;  ///< Bytes of a row.
  /// Writes the rows [begin, end) of a cloud as the file's rows from `at` on. Several threads may
  /// call it at once, as they may the next one.
  void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::uint64_t at);
  /// The same for rows that are records already.
  void put_records(const std::byte* records, std::size_t count, std::uint64_t at);
  void put_tree(const ClusterTree& tree);
  /// Completes the file: until then there is none.
  void commit();

  // Without a job nothing is kept. Parts with rows are there once begin() has been called with the
  // columns that they were written with, and are void with other columns; all others always. All
  // processes have the parts of all.
  std::optional<std::string> finished(std::uint64_t part) override;
  void finish(std::uint64_t part, std::span<const RowSpan> rows, const std::string& state) override;
  /// Rows that earlier runs have made.
  std::uint64_t rows_kept() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
