#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/cloud_io.h>
#include <surfel/scene/image.h>

namespace surfel {

/// A picture of a file.
struct Preview {
  std::string caption;  ///< Plain text.
  Image image;          ///< Premultiplied, over nothing.
};

/// Size of preview_pictures(), what they show, and the memory for them.
struct PreviewOptions {
  int size = 480;           ///< Pixels along a side, 16..4096.
  CloudReadOptions part{};  ///< Of surfels and points: what is shown.
  /// Points that are not surfels yet are thinned to so many before surfels are made of them, >= 1.
  std::size_t most_points = 2000000;
  /// Of volumes with more voxels the means of cubes of voxels are shown, >= 1.
  std::size_t most_voxels = 4000000;
  /// Bytes that surfels may take; see CloudLoadOptions::memory.
  std::optional<std::uint64_t> memory{};
};

/// Pictures of a file of surfels, points, meshes, Gaussians or a volume from four sides, as
/// surfel-render makes them: surfels are made of meshes and points first, and Gaussians of volumes
/// by likely_transfer_function(); terrain without colours is shown by elevation. A picture is its
/// own preview. Throws what reading and rendering throw.
SURFEL_API std::vector<Preview> preview_pictures(const std::string& path,
                                                 const PreviewOptions& options = {});

}  // namespace surfel
