#include <cmath>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/scene.h>
#include <surfel/io/toml_reader.h>

namespace surfel {
namespace {

Light read_light(const TomlTable& table, const std::string& path) {
  Light light;
  std::string type = "headlight";
  table.read("type", type);
  table.read("color", light.color);
  if (type == "point") {
    light.type = Light::Type::kPoint;
    table.read("position", light.vector);
  } else if (type == "directional" || type == "headlight") {
    light.type = type == "headlight" ? Light::Type::kHeadlight : Light::Type::kDirectional;
    table.read("direction", light.vector);
    if (!(light.vector.norm() > 0)) throw_input(path, "a light's direction must not be zero");
  } else {
    throw_input(path, fmt::format("light type \"{}\" is unknown; known are directional, headlight "
                                  "and point",
                                  type));
  }
  if (!light.vector.allFinite() || !light.color.allFinite()) {
    throw_input(path, "a light's direction, position and color must be finite");
  }
  table.reject_unread();
  return light;
}

Material read_material(const TomlTable& table, const std::string& path) {
  Material material;
  double shininess = material.shininess;
  double opacity = material.opacity;
  table.read("name", material.name);
  table.read("ambient", material.ambient);
  table.read("diffuse", material.diffuse);
  table.read("specular", material.specular);
  table.read("shininess", shininess);
  table.read("opacity", opacity);
  table.reject_unread();
  if (!(shininess >= 0 && shininess <= 1e6)) {
    throw_input(path, fmt::format("shininess is {}; it must be in 0..1e6", shininess));
  }
  if (!(opacity >= 0 && opacity <= 1)) {
    throw_input(path, fmt::format("opacity is {}; it must be in 0..1", opacity));
  }
  for (const Vec3f& color : {material.ambient, material.diffuse, material.specular}) {
    if (!color.allFinite()) throw_input(path, "a material's colours must be finite");
  }
  material.shininess = static_cast<float>(shininess);
  material.opacity = static_cast<float>(opacity);
  return material;
}

}  // namespace

Scene read_scene(const std::string& path) {
  const TomlReader file = TomlReader::open(path);
  Scene scene;
  file.root().read("ambient", scene.ambient);
  if (!scene.ambient.allFinite()) throw_input(path, "ambient must be finite");
  const std::vector<TomlTable> lights = file.tables("light");
  if (!lights.empty()) scene.lights.clear();
  for (const TomlTable& table : lights) scene.lights.push_back(read_light(table, path));
  const std::vector<TomlTable> materials = file.tables("material");
  if (!materials.empty()) scene.materials.clear();
  for (const TomlTable& table : materials) scene.materials.push_back(read_material(table, path));
  file.root().reject_unread();
  return scene;
}

}  // namespace surfel
