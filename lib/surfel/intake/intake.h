#pragma once

// Surfels of any files that can be read: what surfel-from-mesh, surfel-texture, surfel-estimate and
// surfel-convert do by default, in memory.

#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Does a file hold surfels that can be drawn as they are? Told from the header alone; false for
/// formats other than PLY.
/// Throws Error (kIo, kInput) naming the file if it cannot be read, or is of a format that is not
/// supported.
SURFEL_API bool holds_surfels(const std::string& path);

/// Files of any kind, to be made surfels of.
class SURFEL_API Intake {
 public:
  /// Surfels, and how they were made.
  struct Made {
    SurfelCloud cloud;
    std::vector<std::string> done;      ///< A line for each file that was not surfels already.
    std::vector<std::string> commands;  ///< Commands that do the same, for a shell.
    std::string file;                   ///< What the last command writes, or the only file.
  };

  /// Reads the files, one at least. Throws what read_mesh() and read_cloud() throw, and
  /// Error(kInput) for pictures.
  explicit Intake(const std::vector<std::string>& files);
  ~Intake();
  Intake(const Intake&) = delete;
  Intake& operator=(const Intake&) = delete;

  /// Bounds of the vertices of faces and of the points, world coordinates.
  Bounds bounds() const;
  /// Meshes are sampled and, where they have uv, textured by their materials; points without sizes
  /// are estimated, on the side of the file's viewpoint or else of its normals; several clouds are
  /// joined. Leaves nothing to be made again.
  /// \param spacing  of a mesh's samples, scene units, > 0; rounded to three digits, as commands
  ///     say it, and larger where a mesh would have more than 2^23 samples.
  /// Throws what these steps throw.
  Made surfels(double spacing);

 private:
  struct File;
  std::vector<File> files_;
};

}  // namespace surfel
