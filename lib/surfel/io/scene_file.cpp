#include <cmath>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/io/named_file.h>
#include <surfel/io/scene_file.h>
#include <surfel/io/toml_reader.h>

namespace surfel {
namespace {

Light read_light(const TomlTable& table) {
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
    if (!(light.vector.norm() > 0)) {
      table.fail("direction", "a light's direction must not be zero");
    }
  } else {
    table.fail("type", fmt::format("light type \"{}\" is unknown; known are directional, "
                                   "headlight and point",
                                   type));
  }
  if (!light.vector.allFinite() || !light.color.allFinite()) {
    table.fail("color", "a light's direction, position and color must be finite");
  }
  table.reject_unread();
  return light;
}

Material read_material(const TomlTable& table) {
  // Far beyond any real material; squares stay far below float's range.
  constexpr double kLargest = 1e6;
  Material material;
  table.read("name", material.name);
  table.read("ambient", material.ambient, -kLargest, kLargest);
  table.read("diffuse", material.diffuse, -kLargest, kLargest);
  table.read("specular", material.specular, -kLargest, kLargest);
  table.read("shininess", material.shininess, 0, 1e6);
  table.read("opacity", material.opacity, 0, 1);
  if (table.has("ior")) {
    float ior = 1;
    table.read("ior", ior, 0.25, 4);
    material.ior = ior;
    material.reflectivity = Vec3f::Constant(portable::squared((ior - 1) / (ior + 1)));
  }
  table.read("reflectivity", material.reflectivity, 0, 1);
  table.read("dispersion", material.dispersion, 0, 0.5);
  if (material.dispersion > 0 && !material.ior) {
    table.fail("dispersion", "dispersion is there but no ior; nothing is refracted without one");
  }
  table.read("roughness", material.roughness, 0, 1);
  table.read("absorption", material.absorption, 0, 1);
  table.reject_unread();
  return material;
}

Environment read_environment(const TomlTable& table, const std::string& path) {
  Environment environment;
  table.read("image", environment.image);
  if (environment.image.empty()) table.fail("image", "the environment names no image");
  if (environment.image != kSkyName) {
    environment.image = named_path(path, environment.image);
    environment.named_by = path;
  }
  table.read("intensity", environment.intensity, 0, 1e6);
  table.read("rotation", environment.rotation, -3600, 3600);
  table.read("visible", environment.visible);
  table.reject_unread();
  return environment;
}

Sky read_sky(const TomlTable& table) {
  Sky sky;
  table.read("up", sky.up);
  if (sky.up && !(sky.up->allFinite() && sky.up->norm() > 0)) {
    table.fail("up", "up of the sky must be a direction, not zero");
  }
  table.read("color", sky.color, 0, 1e6);
  table.read("ground", sky.ground, 0, 1e6);
  table.reject_unread();
  return sky;
}

}  // namespace

Scene read_scene(const std::string& path) { return read_scene(open_toml(path)); }

Scene read_scene(const InputFile& file) {
  const TomlReader toml(file);
  Scene scene;
  toml.root().read("ambient", scene.ambient);
  if (!scene.ambient.allFinite()) toml.root().fail("ambient", "ambient must be finite");
  std::string refraction = "multi";
  toml.root().read("refraction", refraction);
  if (refraction != "single" && refraction != "multi") {
    toml.root().fail("refraction", fmt::format("refraction \"{}\" is unknown; known are single "
                                               "and multi",
                                               refraction));
  }
  scene.refraction = refraction == "single" ? Refraction::kSingle : Refraction::kMulti;
  if (const auto table = toml.table("sky")) scene.sky = read_sky(*table);
  if (const auto table = toml.table("environment")) {
    scene.environment = read_environment(*table, file.name());
  }
  const std::vector<TomlTable> lights = toml.tables("light");
  if (!lights.empty() || scene.sky) scene.lights.clear();
  for (const TomlTable& table : lights) scene.lights.push_back(read_light(table));
  const std::vector<TomlTable> materials = toml.tables("material");
  if (!materials.empty()) scene.materials.clear();
  for (const TomlTable& table : materials) scene.materials.push_back(read_material(table));
  toml.root().reject_unread();
  return scene;
}

}  // namespace surfel
