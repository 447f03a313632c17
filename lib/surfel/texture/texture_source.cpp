#include <algorithm>
#include <map>

#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/texture/named_frequency.h>
#include <surfel/texture/texture_source.h>

namespace surfel {
namespace {

constexpr int kProceduralSize = 2048;      ///< Texels a side.
constexpr int kProceduralSamples = 2;      ///< Per texel and axis.
constexpr double kLeastFrequency = 0.01;   ///< The image shows a hundredth of a period.
constexpr double kLargestFrequency = 512;  ///< Leaves four texels a period.

TextureMap file_map(const std::string& path, const TextureSourceOptions& options) {
  if (options.whole) return {read_image(path), options.wrap};
  return {open_image(path), options.wrap};
}

/// One map per image that the materials name, however many share it.
void add_material_maps(TextureSet& textures, const TriangleMesh& mesh,
                       const TextureSourceOptions& options) {
  std::map<std::string, std::size_t> map_of_image;
  for (const MeshMaterial& material : mesh.material) {
    if (material.texture.empty()) {
      textures.map_of_material.push_back(textures.maps.size());
      textures.maps.push_back(TextureMap::constant(material.diffuse));
      continue;
    }
    const auto [place, is_new] = map_of_image.try_emplace(material.texture, textures.maps.size());
    if (is_new) textures.maps.push_back(file_map(material.texture, options));
    textures.map_of_material.push_back(place->second);
  }
}

}  // namespace

bool is_procedural_image(const std::string& name) {
  const std::vector<std::string>& known = procedural_texture_names();
  return std::find(known.begin(), known.end(), name.substr(0, name.find(':'))) != known.end();
}

Image load_texture_image(const std::string& name) {
  if (!is_procedural_image(name)) return read_image(name);
  const NamedFrequency named =
      parse_named_frequency("image", name, kLeastFrequency, kLargestFrequency);
  ProceduralTextureOptions options;
  options.frequency = named.frequency.value_or(options.frequency);
  return rasterize(procedural_texture(named.name, options), kProceduralSize, kProceduralSize,
                   kProceduralSamples);
}

TextureSet load_textures(const TextureSourceOptions& options, const TriangleMesh* mesh,
                         const std::string& mesh_name) {
  if (options.wrap == WrapMode::kNothing) {
    throw_usage("`wrap` must say what lies beyond the image's borders; it cannot be nothing");
  }
  TextureSet textures;
  if (mesh && mesh->wedge_uv.empty()) {
    throw_input(mesh_name, "the mesh has no texture coordinates, so no image can be put on it");
  }
  if (!options.image.empty()) {
    textures.maps.push_back(is_procedural_image(options.image)
                                ? TextureMap(load_texture_image(options.image), options.wrap)
                                : file_map(options.image, options));
  } else if (!mesh) {
    throw_usage("there is neither an image nor a mesh whose materials name some");
  } else if (mesh->material.empty()) {
    throw_input(mesh_name, "the mesh has no materials to take images from; give an image");
  } else {
    add_material_maps(textures, *mesh, options);
  }
  if (mesh && options.charts) textures.charts.emplace(*mesh);
  return textures;
}

}  // namespace surfel
