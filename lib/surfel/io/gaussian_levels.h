#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

class PlyFile;

/// Has a file Gaussians with levels of detail, as surfel-lod writes them? Throws as
/// holds_gaussians() does.
SURFEL_API bool has_gaussian_levels(const std::string& path);

/// A file of Gaussians with levels of detail, of which pictures read the clusters that they draw:
/// a PLY file whose element `vertex` is the finest level, which is all that other programs see,
/// `surfel_merged` all coarser ones, coarsest first, and `surfel_cluster` the tree.
class SURFEL_API GaussianLevels {
 public:
  /// Reads the header and the tree. Throws Error (kIo, kInput) naming the file where it has no
  /// levels, or broken ones.
  explicit GaussianLevels(const std::string& path);
  explicit GaussianLevels(InputFile file);
  ~GaussianLevels();
  GaussianLevels(const GaussianLevels&) = delete;
  GaussianLevels& operator=(const GaussianLevels&) = delete;

  const std::string& name() const;
  /// What the file says of all Gaussians, and the tree; no Gaussians.
  const GaussianCloud& head() const;
  std::size_t size() const { return size_; }              ///< Gaussians of all levels.
  std::size_t finest() const { return size_ - merged_; }  ///< Gaussians of the finest level.

  /// The Gaussians of some clusters, one cluster after the other; Gaussians that cannot be drawn
  /// are left out (GaussianCloud::unusable_skipped). Throws Error(kInput) naming the file where
  /// memory is short or no usable Gaussian is left. One call at a time.
  GaussianCloud read(std::span<const std::uint32_t> clusters) const;

 private:
  std::unique_ptr<PlyFile> ply_;
  std::unique_ptr<GaussianCloud> head_;
  std::size_t merged_ = 0;
  std::size_t size_ = 0;
};

}  // namespace surfel
