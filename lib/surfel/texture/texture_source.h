#pragma once

#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/image.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// The image that a user names: a file, or "NAME" or "NAME:FREQUENCY" for the unit square of a
/// procedural texture (procedural_image.h; frequency 0.01 to 512, default 16) on 2048 x 2048
/// texels. A file of such a name is reached as "./NAME". Throws Error (kUsage, kIo, kInput).
SURFEL_API Image load_texture_image(const std::string& name);

/// Does load_texture_image() make the image of this name instead of reading a file?
SURFEL_API bool is_procedural_image(const std::string& name);

/// An image that a material of the mesh names, in its file or in the mesh's. Throws Error(kInput)
/// naming the file that names the image where there is no such file, else as InputFile does.
/// \param mesh       The mesh, which may hold images itself.
/// \param material   The material that names the image.
/// \param image      The name, as the material has it.
/// \param mesh_name  The mesh's file.
SURFEL_API InputFile material_image(const TriangleMesh& mesh, const MeshMaterial& material,
                                    const std::string& image, const std::string& mesh_name);

/// Takes the images that are not there off the mesh's materials, which are left with their colours.
/// Returns a sentence for each, which starts with the name of the file that names the image; for
/// none that `image`, if it is not empty, replaces.
SURFEL_API std::vector<std::string> leave_out_missing_images(TriangleMesh& mesh,
                                                             const std::string& mesh_name,
                                                             const std::string& image = {});
/// The files among the images that the mesh's materials name, of those that can be read.
SURFEL_API std::vector<std::string> image_files(const TriangleMesh& mesh);

/// Where the texture comes from, and how it is repeated.
struct TextureSourceOptions {
  /// Image for all surfels; empty = the images that the mesh's materials name.
  std::string image{};
  /// Not kNothing. Unset: as each material says, or kRepeat.
  std::optional<WrapMode> wrap{};
  bool charts = true;  ///< Keep kernels within the mesh's charts.
  bool whole = true;   ///< Image files in memory; else opened, for TextureMap::load().
};

/// Textures of surfels that were sampled from `mesh`, or, without one, of any surfels. Materials
/// that name no image have their diffuse colour. The mesh must outlive the result.
/// \param options    The image for all materials, or none, and how it is read.
/// \param mesh       May be null where there is an image.
/// \param mesh_name  Starts messages about the mesh.
///
/// Throws Error: kUsage without image and mesh, kInput where the mesh has no texture coordinates,
/// or neither image nor materials; kIo and kInput for the images.
SURFEL_API TextureSet load_textures(const TextureSourceOptions& options, const TriangleMesh* mesh,
                                    const std::string& mesh_name);

}  // namespace surfel
