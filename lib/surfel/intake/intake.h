#pragma once

// Surfels of any files that can be read: what surfel-from-mesh, surfel-texture, surfel-estimate and
// surfel-convert do by default, in memory.

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/io/cloud_io.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// Does a file hold surfels that can be drawn as they are? Told from the header alone; false for
/// formats other than PLY.
/// Throws Error (kIo, kInput) naming the file if it cannot be read, or is of a format that is not
/// supported.
SURFEL_API bool holds_surfels(const std::string& path);

/// The command that makes surfels of raw points, for a shell: normals look to the file's viewpoint,
/// or else to the side of the file's normals.
/// \param points  The points, of which only the columns and the header count.
/// \param path    The file with the points.
/// \param part    The part of the file that was read.
/// \param voxel   The edge of cells in which points are averaged, as a command says it; empty:
///                none.
SURFEL_API std::string estimate_command(const SurfelCloud& points, const std::string& path,
                                        const CloudReadOptions& part = {},
                                        const std::string& voxel = {});

/// The command that makes a first picture of a file of any kind, for a shell.
SURFEL_API std::string picture_command(const std::string& path);

/// What meshes are textured by.
struct IntakeOptions {
  /// Image for all meshes, as load_texture_image() takes it; empty = the images that the materials
  /// of each mesh name.
  std::string image{};
  std::optional<WrapMode> wrap{};  ///< Of all images, as TextureSourceOptions::wrap.
  /// Normal or bump map for all meshes; empty = those that the materials of each mesh name. Its
  /// `wrap` and `charts` are not heeded: `wrap` above counts, and kernels stay within charts.
  NormalMapOptions relief{};
  bool no_relief = false;  ///< Leave out the materials' normal and bump maps.
  double lowpass = 1;      ///< RenderOptions::lowpass of the pictures.
  double cutoff = 1;       ///< RenderOptions::cutoff.
  /// The distance of the nearest surface from the eye, over the distance at which the spacing of
  /// the surfels is half a pixel.
  double nearest = 1;
};

/// Files of any kind, to be made surfels of.
class SURFEL_API Intake {
 public:
  /// Surfels, and how they were made.
  struct Made {
    SurfelCloud cloud;
    std::vector<std::string> done;  ///< A line for each file that was not surfels already.
    /// What meshes hold or name that could not be taken into account, a line each.
    std::vector<std::string> warnings;
    std::vector<std::string> commands;  ///< Commands that do the same, for a shell.
    std::string file;                   ///< What the last command writes, or the only file.
    bool textured = false;              ///< A mesh has got an image, or a normal or bump map.
    /// Files that lacked a column of others, which was filled with a default (join_clouds()), each
    /// with the column's name.
    std::vector<std::pair<std::string, std::string>> filled;
  };

  /// Reads the files, one at least. Throws what read_mesh() and read_cloud() throw, and
  /// Error(kInput) for pictures.
  /// \param files  Paths of point clouds, surfels and meshes.
  /// \param part   The part of clouds to read. Meshes are read whole.
  explicit Intake(const std::vector<std::string>& files, const CloudReadOptions& part = {});
  ~Intake();
  Intake(const Intake&) = delete;
  Intake& operator=(const Intake&) = delete;

  /// What a picture shows, roughly: bounds of the vertices of faces, and of the points without the
  /// outermost ones on each side, as stray points may lie anywhere. World coordinates.
  Bounds bounds() const;
  bool has_meshes() const;
  /// The image files that the meshes' materials name.
  std::vector<std::string> images() const;
  /// Meshes are sampled and textured, by the options or, where they have uv, by their materials;
  /// points without sizes are estimated, on the side of the file's viewpoint or else of its
  /// normals, where there are more than 2^20 of them after they have been averaged in cells;
  /// several clouds are joined. Leaves nothing to be made again.
  /// \param spacing  Spacing of a mesh's samples, scene units, > 0, and half of the edge of points'
  ///                 cells; rounded to three digits, as commands say it, and larger where a mesh
  ///                 would have more than 2^23 samples.
  /// \param options  Images and relief of meshes.
  ///
  /// Throws what these steps throw, and Error(kUsage) for options of maps that no mesh has.
  Made surfels(double spacing, const IntakeOptions& options = {});

 private:
  struct File;
  struct ReliefKinds;
  std::vector<File> files_;
  CloudReadOptions part_;
};

}  // namespace surfel
