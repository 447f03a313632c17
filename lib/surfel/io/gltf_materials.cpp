// Khronos, "glTF 2.0 specification", section 3.9, and the extensions KHR_texture_transform,
// KHR_materials_unlit, KHR_materials_emissive_strength, KHR_materials_pbrSpecularGlossiness and
// EXT_texture_webp.

#include <algorithm>
#include <filesystem>
#include <limits>
#include <memory>
#include <span>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/io/gltf_materials.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/uri.h>

namespace surfel {
namespace {

Vec3f rgb(const Vec4d& factor) { return factor.head<3>().cast<float>(); }

/// Where a texture's image stands, in PNG or JPEG, or else in WebP.
JsonView source_of(const JsonView& texture) {
  const JsonView plain = texture["source"];
  return plain ? plain : texture["extensions"]["EXT_texture_webp"]["source"];
}

}  // namespace

const GltfMaterials::Use& GltfMaterials::use(const JsonView& reference) {
  const std::string place = reference ? file_.referred("materials", reference).place() : "";
  const auto [entry, is_new] = use_.try_emplace(place);
  Use& use = entry->second;
  if (!is_new) return use;
  if (material.size() > std::numeric_limits<std::uint16_t>::max()) {
    throw_input(file_.name(), "more than 65536 materials are not supported");
  }
  use.material = static_cast<std::uint16_t>(material.size());
  MeshMaterial& to = material.emplace_back();
  to.vertex_factor = vertex_colors_;
  to.named_by = file_.name();
  if (reference) read(file_.referred("materials", reference), to, use);
  return use;
}

void GltfMaterials::read(const JsonView& from, MeshMaterial& to, Use& use) {
  to.name = from["name"].text("");
  const JsonView extensions = from["extensions"];
  const JsonView glossy = extensions["KHR_materials_pbrSpecularGlossiness"];
  const JsonView rough = from["pbrMetallicRoughness"];
  JsonView texture = glossy ? glossy["diffuseTexture"] : rough["baseColorTexture"];
  Vec4d factor(1, 1, 1, 1);
  (glossy ? glossy["diffuseFactor"] : rough["baseColorFactor"]).numbers(factor);
  to.unlit = static_cast<bool>(extensions["KHR_materials_unlit"]);
  Vec3d emissive(0, 0, 0);
  from["emissiveFactor"].numbers(emissive);
  if (factor.head<3>().isZero(0) && !emissive.isZero(0)) {
    // A black surface that glows shows nothing else.
    factor.head<3>() =
        emissive * extensions["KHR_materials_emissive_strength"]["emissiveStrength"].number(1);
    texture = from["emissiveTexture"];
    to.unlit = true;
  }
  to.diffuse = to.texture_factor = rgb(factor);
  read_alpha(from, std::clamp(factor[3], 0.0, 1.0), to);
  if (texture) {
    const Image image = this->image(texture);
    to.texture = image.name;
    to.wrap = image.wrap;
    use.coordinates = image.at.coordinates;
    use.transform = image.at.transform;
    use.textured = !image.name.empty();
  }
  read_normal_map(from["normalTexture"], to, use);
}

void GltfMaterials::read_alpha(const JsonView& from, double alpha, MeshMaterial& to) const {
  const std::string mode = from["alphaMode"].text("OPAQUE");
  if (mode == "BLEND") {
    to.opacity = static_cast<float>(alpha);
    return;
  }
  to.texture_alpha = TextureAlpha::kNothing;
  if (mode != "MASK") return;
  const double cutoff = from["alphaCutoff"].number(0.5);
  to.texture_alpha = TextureAlpha::kMask;
  // The image's alpha is compared before the factor multiplies it.
  to.alpha_cutoff = alpha > 0 ? static_cast<float>(cutoff / alpha) : 2.0F;
  const bool textured = from["pbrMetallicRoughness"]["baseColorTexture"] ||
                        from["extensions"]["KHR_materials_pbrSpecularGlossiness"]["diffuseTexture"];
  if (!textured && alpha < cutoff) to.opacity = 0;
}

/// A mesh has one set of texture coordinates: the colours', if there are any.
void GltfMaterials::read_normal_map(const JsonView& from, MeshMaterial& to, Use& use) {
  if (!from) return;
  const Image image = this->image(from);
  if (image.name.empty()) return;
  const bool fits =
      image.at.coordinates == use.coordinates && image.at.transform.isApprox(use.transform, 1e-9);
  if (use.textured && (!fits || image.wrap != to.wrap)) {
    notes.push_back(
        fmt::format("the normal map of {} lies in another way than its colours, and "
                    "is left out",
                    from.place()));
    return;
  }
  to.normal_map = image.name;
  if (use.textured) return;
  to.wrap = image.wrap;
  use.coordinates = image.at.coordinates;
  use.transform = image.at.transform;
}

GltfMaterials::Image GltfMaterials::image(const JsonView& texture_info) {
  Image result;
  const JsonView texture = file_.referred("textures", texture_info["index"]);
  std::uint64_t set = texture_info["texCoord"].count(0);
  const JsonView moved = texture_info["extensions"]["KHR_texture_transform"];
  if (moved) {
    set = moved["texCoord"].count(set);
    Vec2d offset(0, 0);
    Vec2d scale(1, 1);
    moved["offset"].numbers(offset);
    moved["scale"].numbers(scale);
    const double angle = moved["rotation"].number(0);
    const double c = portable::cos(angle);
    const double s = portable::sin(angle);
    result.at.transform << c * scale.x(), s * scale.y(), offset.x(),  //
        -s * scale.x(), c * scale.y(), offset.y();
  }
  result.at.coordinates = fmt::format("TEXCOORD_{}", set);
  const JsonView sampler = texture["sampler"];
  if (sampler) result.wrap = wrap_of(file_.referred("samplers", sampler));
  const JsonView source = source_of(texture);
  if (!source) {
    notes.push_back(
        fmt::format("{} has no image of a kind that is read, and is left out", texture.place()));
    return result;
  }
  result.name = image_name(file_.referred("images", source));
  return result;
}

/// The image's name as materials have it; bytes inside of the file become an EmbeddedImage.
std::string GltfMaterials::image_name(const JsonView& image) {
  const auto [entry, is_new] = name_.try_emplace(image.place());
  if (!is_new) return entry->second;
  const JsonView uri = image["uri"];
  const std::string text = uri.text("");
  if (uri && !is_data_uri(text)) return entry->second = file_.path_of(uri);
  auto bytes = std::make_shared<Array<std::byte>>();
  if (uri) {
    auto decoded = decode_data_uri(text);
    if (!decoded) uri.fail("is no base64 data, or damaged; export the file again");
    *bytes = std::move(*decoded);
  } else {
    const auto stored = file_.view_bytes(file_.referred("bufferViews", image["bufferView"]));
    bytes->assign(stored.begin(), stored.end());
  }
  const std::string name = image["name"].text("");
  entry->second = fmt::format("{}: {}{}", file_.name(), image.place(),
                              name.empty() ? "" : " " + quoted_excerpt(name));
  embedded.push_back({entry->second, std::move(bytes)});
  return entry->second;
}

/// OpenGL's numbers.
WrapMode GltfMaterials::wrap_of(const JsonView& sampler) {
  const auto mode = [&](const char* axis) {
    constexpr std::uint64_t kClampToEdge = 33071;
    constexpr std::uint64_t kMirroredRepeat = 33648;
    constexpr std::uint64_t kRepeat = 10497;
    const std::uint64_t number = sampler[axis].count(kRepeat);
    return number == kClampToEdge      ? WrapMode::kClamp
           : number == kMirroredRepeat ? WrapMode::kMirror
                                       : WrapMode::kRepeat;
  };
  const WrapMode across = mode("wrapS");
  if (mode("wrapT") != across) {
    notes.push_back(
        fmt::format("{} continues images in another way across than along; they are "
                    "continued alike here, as across",
                    sampler.place()));
  }
  return across;
}

}  // namespace surfel
