#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <surfel/base/export.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

struct CloudLoadOptions {
  RenderColumns columns = {};  ///< Of the method.
  /// Bytes that the surfels and what is made of them for a picture may take; more surfels stay in
  /// their file and are streamed from it. Unset: three quarters of what the machine has left.
  std::optional<std::uint64_t> memory = {};
  bool may_stream =
      true;  ///< False: the picture needs all surfels in memory, as it does for groups.
  /// Most surfels streamed at once of a file without levels of detail: of these as many as fit.
  std::size_t batch = std::size_t{1} << 20;
};

/// Surfels of a file, ready to be rendered: in memory, or streamed from it.
class SURFEL_API LoadedCloud {
 public:
  /// Reads any file that read_cloud() reads and makes the same of it as RenderCloud does of that
  /// cloud with all its levels of detail; binary PLY without a SurfelCloud in between, several
  /// times as fast, faster still where the surfels stand in the file as morton_order() has them.
  /// Throws as both do; messages name the file. Throws Error(kInput) if none of the surfels can be
  /// used, or if they do not fit into the memory given and cannot be streamed (CloudStream): they
  /// can from a binary PLY file of its usual types, with levels of detail, or without copies of
  /// splats where consecutive surfels lie close together. Levels of detail are always streamed,
  /// where that may be: a picture wants few of them.
  LoadedCloud(const std::string& path, const CloudLoadOptions& options);
  ~LoadedCloud();
  LoadedCloud(const LoadedCloud&) = delete;
  LoadedCloud& operator=(const LoadedCloud&) = delete;

  const RenderCloud& surfels() const;
  /// What pictures are drawn from: the surfels in memory, or a stream of the file.
  ClusterStore& store() const;
  /// The file has levels of detail, whether they were asked for or not.
  bool has_levels() const;
  /// SurfelCloud::basis_cutoff.
  std::optional<double> basis_cutoff() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
