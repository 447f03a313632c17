#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/io/gltf_file.h>
#include <surfel/io/json_view.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// The materials of a glTF file that its faces use. Internal to the io module.
class GltfMaterials {
 public:
  /// How a primitive's faces find their place in the material's images.
  struct Use {
    std::uint16_t material = 0;  ///< Row of the mesh's table.
    bool textured = false;
    std::string coordinates = "TEXCOORD_0";  ///< The attribute that holds them.
    Eigen::Matrix<double, 2, 3> transform = Eigen::Matrix<double, 2, 3>::Identity();

    /// The file's coordinates in the image, whose first row is at v = 0 there and at 1 here.
    Vec2f place(const float* uv) const {
      const Vec2d at = transform * Vec3d(uv[0], uv[1], 1);
      return {static_cast<float>(at.x()), static_cast<float>(1 - at.y())};
    }
  };

  /// \param vertex_colors  Some faces of the mesh have vertex colours.
  GltfMaterials(GltfFile& file, bool vertex_colors) : file_(file), vertex_colors_(vertex_colors) {}

  /// The material of a primitive, whose `material` may be missing.
  const Use& use(const JsonView& reference);

  std::vector<MeshMaterial> material;
  std::vector<EmbeddedImage> embedded;
  std::vector<std::string> notes;

 private:
  struct Image {
    std::string name;
    Use at;
    WrapMode wrap = WrapMode::kRepeat;
  };

  void read(const JsonView& from, MeshMaterial& to, Use& use);
  void read_alpha(const JsonView& from, double alpha, MeshMaterial& to) const;
  void read_normal_map(const JsonView& from, MeshMaterial& to, Use& use);
  Image image(const JsonView& texture_info);
  std::string image_name(const JsonView& image);
  WrapMode wrap_of(const JsonView& sampler);

  GltfFile& file_;
  bool vertex_colors_;
  std::unordered_map<std::string, Use> use_;           ///< By the material's place.
  std::unordered_map<std::string, std::string> name_;  ///< Of images, by their place.
};

}  // namespace surfel
