#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/named_file.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/texture/named_frequency.h>
#include <surfel/texture/texture_source.h>

namespace surfel {
namespace {

constexpr int kProceduralSize = 2048;      ///< Texels a side.
constexpr int kProceduralSamples = 2;      ///< Per texel and axis.
constexpr double kLeastFrequency = 0.01;   ///< The image shows a hundredth of a period.
constexpr double kLargestFrequency = 512;  ///< Leaves four texels a period.

/// What a material makes of the texels of its image.
struct TexelChange {
  std::array<float, 4> factor{1, 1, 1, 1};  ///< Of R, G, B and alpha.
  TextureAlpha alpha = TextureAlpha::kOpacity;
  float cutoff = 0;  ///< Of kMask; else 0, so that equal changes are equal.

  auto operator<=>(const TexelChange&) const = default;
  bool scales() const { return factor != std::array<float, 4>{1, 1, 1, 1}; }
  bool none() const { return !scales() && alpha == TextureAlpha::kOpacity; }

  /// Changes the alpha of texels whose full opacity is `full`.
  template <class T>
  void change_alpha(T* rgba, std::size_t texels, T full) const {
    if (alpha == TextureAlpha::kOpacity) return;
    const float least = cutoff * static_cast<float>(full);
    for (std::size_t i = 0; i < texels; ++i) {
      T& a = rgba[4 * i + 3];
      const bool there = alpha == TextureAlpha::kNothing || static_cast<float>(a) >= least;
      a = there ? full : T{};
    }
  }
  void change(float* rgba, std::size_t texels) const {
    change_alpha(rgba, texels, 1.0F);
    if (!scales()) return;
    for (std::size_t i = 0; i < 4 * texels; ++i) rgba[i] *= factor[i % 4];
  }
};

TexelChange change_of(const MeshMaterial& material) {
  const Vec3f& f = material.texture_factor;
  return {.factor = {f[0], f[1], f[2], material.opacity},
          .alpha = material.texture_alpha,
          .cutoff = material.texture_alpha == TextureAlpha::kMask ? material.alpha_cutoff : 0};
}

/// An image whose texels are changed on the way.
class ChangedImage : public ImageReader {
 public:
  ChangedImage(std::shared_ptr<ImageReader> image, const TexelChange& change)
      : image_(std::move(image)), change_(change), layout_(image_->layout()) {
    // Products of codes are no codes.
    layout_.coded = layout_.coded && !change.scales();
    layout_.alpha = (layout_.alpha && change.alpha != TextureAlpha::kNothing) || change.scales();
  }

  const Layout& layout() const override { return layout_; }

  void read(const Box& box, void* rgba) override {
    if (layout_.coded) {
      image_->read(box, rgba);
      change_.change_alpha(static_cast<std::uint8_t*>(rgba), box.pixels(), std::uint8_t{255});
      return;
    }
    auto* const texels = static_cast<float*>(rgba);
    if (image_->layout().coded) {
      coded_.resize(4 * box.pixels());
      image_->read(box, coded_.data());
      for (std::size_t i = 0; i < coded_.size(); ++i) {
        const bool is_alpha = i % 4 == 3;
        texels[i] = is_alpha ? static_cast<float>(coded_[i]) / 255 : srgb8_to_linear(coded_[i]);
      }
    } else {
      image_->read(box, rgba);
    }
    change_.change(texels, box.pixels());
  }

 private:
  std::shared_ptr<ImageReader> image_;
  TexelChange change_;
  Layout layout_;
  Array<std::uint8_t> coded_;
};

/// The map of an image that the user names.
TextureMap named_map(const TextureSourceOptions& options, WrapMode wrap) {
  if (options.whole || is_procedural_image(options.image)) {
    return {load_texture_image(options.image), wrap};
  }
  return {open_image(options.image), wrap};
}

TextureMap changed_map(InputFile file, const TexelChange& change, WrapMode wrap, bool whole) {
  if (whole) {
    Image image = read_image(std::move(file));
    change.change(image.data.data(), image.data.size() / 4);
    return {std::move(image), wrap};
  }
  std::shared_ptr<ImageReader> reader = open_image(std::move(file));
  if (!change.none()) reader = std::make_shared<ChangedImage>(std::move(reader), change);
  return {std::move(reader), wrap};
}

/// One map per image and what is made of it, however many materials share it.
void add_material_maps(TextureSet& textures, const TriangleMesh& mesh,
                       const TextureSourceOptions& options, const std::string& mesh_name) {
  std::map<std::tuple<std::string, WrapMode, TexelChange>, std::size_t> known;
  for (const MeshMaterial& material : mesh.material) {
    textures.multiplied.push_back(mesh.colors_multiply(material));
    if (material.texture.empty()) {
      const Vec3f color = textures.multiplied.back() ? Vec3f(1, 1, 1) : material.diffuse;
      textures.map_of_material.push_back(textures.maps.size());
      textures.maps.push_back(TextureMap::constant(color, material.opacity));
      continue;
    }
    const WrapMode wrap = options.wrap.value_or(material.wrap.value_or(WrapMode::kRepeat));
    const TexelChange change = change_of(material);
    const auto [place, is_new] =
        known.try_emplace({material.texture, wrap, change}, textures.maps.size());
    if (is_new) {
      textures.maps.push_back(
          changed_map(material_image(mesh, material, material.texture, mesh_name), change, wrap,
                      options.whole));
    }
    textures.map_of_material.push_back(place->second);
  }
}

/// The colours of materials that all leave light are light; some of a mesh, and nothing can be
/// told of all.
ColorLight light_of(const std::vector<MeshMaterial>& materials) {
  const auto unlit = std::count_if(materials.begin(), materials.end(),
                                   [](const MeshMaterial& material) { return material.unlit; });
  if (unlit == 0) return ColorLight::kReflectance;
  return unlit == std::ssize(materials) ? ColorLight::kRecorded : ColorLight::kMixed;
}

/// The embedded image of that name, or null.
const EmbeddedImage* find_embedded(const TriangleMesh& mesh, const std::string& image) {
  const auto found = std::find_if(mesh.embedded.begin(), mesh.embedded.end(),
                                  [&](const EmbeddedImage& e) { return e.name == image; });
  return found == mesh.embedded.end() ? nullptr : &*found;
}

/// The images of a material.
template <class Material>
auto images_of(Material& material) {
  return std::array{&material.texture, &material.normal_map, &material.bump_map};
}

/// What keeps an image of a material from being read, as the end of a sentence; empty if nothing
/// does.
std::string problem_of(const TriangleMesh& mesh, const MeshMaterial& material,
                       const std::string& image) {
  if (image.empty() || find_embedded(mesh, image)) return "";
  if (!material.named_by.empty()) return named_problem(material.named_by, image);
  std::error_code error;
  return std::filesystem::exists(image, error) ? "" : "is not there";
}

}  // namespace

InputFile material_image(const TriangleMesh& mesh, const MeshMaterial& material,
                         const std::string& image, const std::string& mesh_name) {
  if (const EmbeddedImage* const embedded = find_embedded(mesh, image)) {
    return {image, std::span(embedded->bytes->data(), embedded->bytes->size())};
  }
  const std::string problem = problem_of(mesh, material, image);
  if (!problem.empty()) {
    throw_input(material.named_by.empty() ? mesh_name : material.named_by,
                fmt::format("names the image {}, which {}; put it beside this file, or give an "
                            "image with `image`",
                            image, problem));
  }
  return material.named_by.empty() ? InputFile(image) : open_named(material.named_by, image);
}

std::vector<std::string> leave_out_missing_images(TriangleMesh& mesh, const std::string& mesh_name,
                                                  const std::string& image) {
  std::vector<std::string> sentences;
  std::set<std::string> told;
  for (MeshMaterial& material : mesh.material) {
    for (std::string* const named : images_of(material)) {
      const std::string problem = problem_of(mesh, material, *named);
      if (problem.empty()) continue;
      const std::string missing = std::exchange(*named, "");
      const bool is_texture = named == &material.texture;
      if ((is_texture && !image.empty()) || !told.insert(missing).second) continue;
      sentences.push_back(
          fmt::format("{}: names the image {}, which {}; the material {} is shown without it{}",
                      material.named_by.empty() ? mesh_name : material.named_by, missing, problem,
                      material.name.empty() ? "without a name" : material.name,
                      is_texture ? "; `image` gives another" : ""));
    }
  }
  return sentences;
}

std::vector<std::string> image_files(const TriangleMesh& mesh) {
  std::vector<std::string> files;
  for (const MeshMaterial& material : mesh.material) {
    for (const std::string* const image : images_of(material)) {
      if (image->empty() || find_embedded(mesh, *image)) continue;
      if (problem_of(mesh, material, *image).empty()) files.push_back(*image);
    }
  }
  return files;
}

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
  const WrapMode wrap = options.wrap.value_or(WrapMode::kRepeat);
  TextureSet textures;
  if (mesh && mesh->wedge_uv.empty()) {
    throw_input(mesh_name, "the mesh has no texture coordinates, so no image can be put on it");
  }
  if (!options.image.empty()) {
    textures.maps.push_back(named_map(options, wrap));
  } else if (!mesh) {
    throw_usage("there is neither an image nor a mesh whose materials name some");
  } else if (mesh->material.empty()) {
    throw_input(mesh_name, "the mesh has no materials to take images from; give an image");
  } else {
    add_material_maps(textures, *mesh, options, mesh_name);
    textures.light = light_of(mesh->material);
  }
  if (mesh && options.charts) textures.charts.emplace(*mesh);
  return textures;
}

}  // namespace surfel
