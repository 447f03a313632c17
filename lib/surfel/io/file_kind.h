#pragma once

#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// The kind of data that a file holds.
enum class FileKind {
  kCloud,      ///< Surfels or points.
  kMesh,       ///< Triangles.
  kImage,      ///< A picture.
  kGaussians,  ///< Gaussians in space, i.e. trained splats (gaussian_io.h).
  kVolume,     ///< A scalar field on a grid (volume_io.h).
};

/// Tells the kind of a file from its name's extension, and for PLY from the header: a file with
/// faces or triangle strips is a mesh, a file with points alone is a cloud, or Gaussians where the
/// points have their properties. Standard input ("-") is always taken for a cloud.
/// Throws Error (kIo, kInput) naming the file if it cannot be read, is empty, or is of a format
/// that is not supported.
SURFEL_API FileKind file_kind(const std::string& path);

/// "; `COMMAND` converts it (PROGRAM)" for the end of a message about a file of a format that is
/// not read; empty where no converter is known.
std::string converter_advice(const std::string& path);

/// Throws Error(kInput): a file that was taken for surfels or points holds Gaussians in space.
[[noreturn]] SURFEL_API void refuse_gaussians(const std::string& file);

/// Throws Error(kInput): a file that was taken for surfels or points holds a volume.
[[noreturn]] SURFEL_API void refuse_volume(const std::string& file);

/// Throws Error(kUsage) for names that end in .copc.laz, which other programs take for COPC: it is
/// read, and not written.
SURFEL_API void refuse_copc_name(const std::string& path);

/// Whether a name has the extension of LAS or LAZ files, of E57 files, of a format that holds
/// meshes alone, or pictures alone.
bool is_las_name(const std::string& path);
bool is_e57_name(const std::string& path);
bool is_mesh_name(const std::string& path);
SURFEL_API bool is_image_name(const std::string& path);

}  // namespace surfel
