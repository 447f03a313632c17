#include <cmath>

#include <surfel/scene/scene.h>

namespace surfel {

std::vector<std::string> Scene::problems() const {
  std::vector<std::string> found;
  const auto check = [&](bool ok, const std::string& message) {
    if (!ok) found.push_back(message);
  };
  check(!materials.empty(), "the scene has no materials; it needs one at least");
  check(ambient.allFinite(), "`ambient` must be finite");
  for (const Light& light : lights) {
    check(light.vector.allFinite() && light.color.allFinite(),
          "vectors and colors of lights must be finite");
  }
  check(!environment ||
            (std::isfinite(environment->intensity) && std::isfinite(environment->rotation)),
        "intensity and rotation of the environment must be finite");
  return found;
}

}  // namespace surfel
