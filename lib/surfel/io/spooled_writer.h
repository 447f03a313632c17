#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Where a SpooledWriter keeps rows until it writes them.
struct SpoolOptions {
  bool no_clobber = false;
  /// RowFileOptions::job. If there is one, the scratch file is FILE.unfinished-scratch, and stays
  /// where a run ends early.
  std::string job = {};
};

/// Writes a cloud piece by piece to binary PLY, as write_cloud() would, without knowing how many
/// surfels will come: what the header needs. The pieces wait on a scratch file beside the target,
/// which takes as much as the target; without a job it is gone however the process ends.
class SURFEL_API SpooledWriter final : public Checkpoints {
 public:
  /// Throws Error(kUsage) for a target that is not written as binary PLY, Error(kIo) where there is
  /// no place for the scratch file.
  explicit SpooledWriter(std::string path, const SpoolOptions& options = {});
  ~SpooledWriter() override;

  /// Tells the columns of all pieces, and what holds for the whole cloud.
  /// \param like  a surfel or some
  void begin(const SurfelCloud& like);
  /// Takes the next surfels. All pieces have the same columns, of the same types. Throws
  /// Error(kIo), and Error(kInput) where the columns differ.
  void append(const SurfelCloud& piece);
  std::size_t surfels() const;
  /// Surfels that an earlier run has made, of the parts that have been asked for.
  std::size_t kept() const;
  /// Writes the file. Throws Error(kIo).
  void commit();

  // A part is what has been appended since the part before was finished: parts with rows, of which
  // begin and end count for nothing, come in the same order in every run. Once one of them is not
  // there, those behind it are not there either.
  std::optional<std::string> finished(std::uint64_t part) override;
  void finish(std::uint64_t part, std::span<const RowSpan> rows, const std::string& state) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
