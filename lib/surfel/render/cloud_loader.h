#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <surfel/base/export.h>
#include <surfel/render/render_cloud.h>

namespace surfel {

class CloudStream;

struct CloudLoadOptions {
  RenderColumns columns = {};  ///< Of the method.
  /// Bytes that the surfels and what is made of them for a picture may take; more surfels stay in
  /// their file and are streamed from it. Unset: three quarters of what the machine has left.
  std::optional<std::uint64_t> memory = {};
  bool may_stream =
      true;  ///< False: the picture needs all surfels in memory, as it does for groups.
  std::size_t batch = std::size_t{1} << 20;  ///< Most surfels streamed at once.
};

/// Surfels of a file, ready to be rendered: in memory, or streamed from it.
class SURFEL_API LoadedCloud {
 public:
  /// Reads any file that read_cloud() reads and makes the same of it as RenderCloud does of that
  /// cloud with all its levels of detail; binary PLY without these and without a SurfelCloud in
  /// between, several times as fast, faster still where the surfels stand in the file as
  /// morton_order() has them. Throws as both do; messages name the file. Throws Error(kInput) if
  /// none of the surfels can be used, or if they do not fit into the memory given and cannot be
  /// streamed: they can from a binary PLY file of its usual types, without levels of detail and
  /// copies of splats, in which consecutive surfels lie close together (CloudStream).
  LoadedCloud(const std::string& path, const CloudLoadOptions& options);
  ~LoadedCloud();
  LoadedCloud(const LoadedCloud&) = delete;
  LoadedCloud& operator=(const LoadedCloud&) = delete;

  const RenderCloud& surfels() const;
  /// Null if all surfels are in memory.
  CloudStream* stream() const;
  /// The file has levels of detail, whether they were asked for or not.
  bool has_levels() const;
  /// SurfelCloud::basis_cutoff.
  std::optional<double> basis_cutoff() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
