#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Writes a cloud piece by piece to binary PLY, as write_cloud() would, without knowing how many
/// surfels will come: what the header needs. The pieces wait on a scratch file beside the target,
/// which takes as much as the target, and is gone however the process ends.
class SURFEL_API SpooledWriter {
 public:
  /// Throws Error(kUsage) for a target that is not written as binary PLY, Error(kIo) where there is
  /// no place for the scratch file.
  explicit SpooledWriter(std::string path, bool no_clobber = false);
  ~SpooledWriter();
  SpooledWriter(const SpooledWriter&) = delete;
  SpooledWriter& operator=(const SpooledWriter&) = delete;

  /// Takes the next surfels. All pieces have the same columns, of the same types. Throws
  /// Error(kIo), and Error(kInput) where the columns differ.
  void append(const SurfelCloud& piece);
  std::size_t surfels() const;
  /// Writes the file. Throws Error(kIo).
  void commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
