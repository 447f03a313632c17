#include <algorithm>
#include <array>
#include <cmath>

#include <surfel/io/mtl.h>
#include <surfel/io/named_file.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

float finite_or_one(const std::optional<double>& value) {
  return value && std::isfinite(static_cast<float>(*value)) ? static_cast<float>(*value) : 1.0F;
}

/// An image that a material names.
struct NamedImage {
  std::string_view name;  ///< Without the options in front of it.
  float multiplier = 1;   ///< Value of the option -bm.
  Vec2f scale{1, 1};      ///< -s, of u and v.
  Vec2f offset{0, 0};     ///< -o.
  bool clamped = false;   ///< -clamp on.
};

/// Takes the name of a file from "-s 1 1 1 -clamp on wood 1.png". The options -o, -s and -t take up
/// to three numbers, -mm two values, the others one. Numbers that are not finite are not heeded.
NamedImage named_image(std::string_view text) {
  NamedImage image;
  TextScanner words({}, text);
  std::size_t name = 0;
  while (words.peek() == '-') {
    const std::string_view option = words.word();
    if (option == "-o" || option == "-s" || option == "-t") {
      for (int i = 0; i < 3; ++i) {
        const auto value = parse_number(words.peek_word());
        if (!value) break;
        words.word();
        if (i == 2 || !std::isfinite(static_cast<float>(*value))) continue;
        if (option == "-s") image.scale[i] = static_cast<float>(*value);
        if (option == "-o") image.offset[i] = static_cast<float>(*value);
      }
    } else {
      const std::string_view value = words.word();
      if (option == "-bm") image.multiplier = finite_or_one(parse_number(value));
      if (option == "-mm") words.word();
      if (option == "-clamp") image.clamped = value == "on";
    }
    if (words.at_line_end()) break;  // A name that starts with a dash.
    name = words.position();
  }
  text.remove_prefix(name);
  if (text.size() > 1 && text.front() == '"' && text.back() == '"') {
    text = text.substr(1, text.size() - 2);
  }
  image.name = text;
  return image;
}

/// Is the statement "bump"? Programs also write it like the names of maps, with either letter.
bool names_bump(std::string_view keyword) {
  return keyword == "bump" || keyword == "map_bump" || keyword == "map_Bump";
}

/// Three numbers, or one for all; colours given as spectra or CIE XYZ are left out.
void read_diffuse(TextScanner& in, Vec3f& diffuse) {
  std::array<double, 3> value{};
  std::size_t count = 0;
  for (; count < 3 && !in.at_line_end(); ++count) {
    value[count] = parse_number(in.word()).value_or(std::nan(""));
    if (!std::isfinite(value[count])) return;
  }
  if (count == 1) value[1] = value[2] = value[0];
  if (count == 1 || count == 3) diffuse = Vec3d(value[0], value[1], value[2]).cast<float>();
}

}  // namespace

std::string texture_name_from(const std::filesystem::path& folder, const std::string& texture) {
  namespace fs = std::filesystem;
  const fs::path file = fs::weakly_canonical(fs::absolute(texture));
  const fs::path relative = file.lexically_relative(fs::weakly_canonical(fs::absolute(folder)));
  return relative.empty() || *relative.begin() == ".." ? file.string() : relative.string();
}

std::vector<MtlMaterial> read_mtl(const InputFile& file) {
  std::vector<MtlMaterial> materials;
  TextScanner in(file.name(), as_text(file.bytes()), kMeshText);
  for (; in.skip_to_content(); in.next_line()) {
    const std::string_view keyword = in.word();
    if (keyword == "newmtl") {
      MeshMaterial& material = materials.emplace_back().material;
      material.name = std::string(in.rest_of_line());
      material.named_by = file.name();
    } else if (materials.empty()) {
      continue;
    } else if (keyword == "Kd") {
      read_diffuse(in, materials.back().material.diffuse);
    } else if (keyword == "map_Kd" || keyword == "norm" || names_bump(keyword)) {
      const NamedImage image = named_image(in.rest_of_line());
      if (image.name.empty()) continue;
      MeshMaterial& material = materials.back().material;
      std::string& path = keyword == "map_Kd" ? material.texture
                          : keyword == "norm" ? material.normal_map
                                              : material.bump_map;
      path = named_path(file.name(), image.name);
      if (names_bump(keyword)) material.bump_scale = image.multiplier;
      if (image.clamped) material.wrap = WrapMode::kClamp;
      if (keyword != "map_Kd") continue;
      materials.back().uv_scale = image.scale;
      materials.back().uv_offset = image.offset;
    }
  }
  return materials;
}

}  // namespace surfel
