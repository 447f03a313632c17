#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Does a file hold Gaussians in space, i.e. trained splats? PLY files are told by the properties
/// in their header, other formats by their first bytes (.spz) or the extension of the name.
/// False for "-", standard input, and for pipes, of which nothing is read. Throws Error (kIo,
/// kInput) naming the file where it cannot be read or its PLY header is broken.
SURFEL_API bool holds_gaussians(const std::string& path);
/// As above, for a file that is open; of a pipe the bytes stay to be read.
SURFEL_API bool holds_gaussians(const InputFile& input);

/// What may stop the reading of a file of Gaussians.
struct GaussianReadOptions {
  /// Called once, when a file has said how many Gaussians it has and of which degree, before memory
  /// is taken for them; it may throw. Unset: all are read.
  std::function<void(std::size_t count, const GaussianCloud& head)> accept = {};
};

/// Reads trained splats: PLY as 3D Gaussian splatting writes it (ascii, binary of either byte
/// order, spherical harmonics of degree 0 to 4), without the third scale as 2D Gaussian splatting
/// does, or with the 3D filter of Mip-Splatting, which is baked into scales and opacities;
/// compressed PLY (PlayCanvas), .splat, .spz (versions 1 to 4) and .ksplat. What a file says of the
/// renderer is kept (`rule`, `trained_with`).
///
/// All values are as GaussianCloud has them, whatever the file stores (logits, logarithms, bytes).
/// The axes are the axes of files of 3D Gaussian splatting, whose y mostly points down;
/// GaussianCloud::up is set only where the format says which way is up, as .spz does, whose axes
/// are turned to PLY's. Normals of splat files are not read: no program writes normals that
/// mean something. Of a file with levels of detail the finest is read (gaussian_levels.h).
///
/// Files of trained splats hold broken Gaussians now and then, which no renderer shows: a Gaussian
/// with a value that is not finite, or with a scale above kLargestExtent, is left out and counted
/// (GaussianCloud::unusable_skipped). A quaternion of zero length means no rotation, as the
/// renderer of 3D Gaussian splatting draws it. A scale's sign is ignored.
///
/// Throws Error (kIo, kInput) naming the file: it is truncated, its header promises more than it
/// holds, no usable Gaussian is left.
SURFEL_API GaussianCloud read_gaussians(const std::string& path,
                                        const GaussianReadOptions& options = {});
SURFEL_API GaussianCloud read_gaussians(InputFile input, const GaussianReadOptions& options = {});

/// How a file of Gaussians is written.
struct GaussianWriteOptions {
  bool no_clobber = false;
  std::vector<std::string> provenance = {};  ///< A PLY header gets a comment for each.
};

/// Writes Gaussians by the extension of the name: trained PLY (.ply or none; "-" is standard
/// output), .splat, which keeps of the colours the part that does not depend on direction, and 8
/// bits of colours, opacities and quaternions, or the text of a USD stage (.usda), a particle field
/// of OpenUSD 26.03, whose kernels are Gaussian surflets where all third scales are zero. Positions
/// are written relative to the cloud's origin, since viewers compute in float; a comment of a PLY
/// header and a transform of a stage tell the origin, .splat has no place for it. Densities get a
/// PLY property `density` instead of `opacity`; levels of detail are written as GaussianLevels
/// reads them. The file appears whole or not at all (OutputFile). Throws Error(kIo), and
/// Error(kUsage) for other extensions and for densities and levels in other formats.
SURFEL_API void write_gaussians(const GaussianCloud& cloud, const std::string& path,
                                const GaussianWriteOptions& options = {});

/// Has a name the extension of a format that is read and holds Gaussians alone (.splat, .spz,
/// .ksplat)?
SURFEL_API bool is_splat_name(const std::string& path);

}  // namespace surfel
