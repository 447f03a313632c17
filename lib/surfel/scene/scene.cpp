#include <cmath>

#include <surfel/base/option_check.h>
#include <surfel/scene/scene.h>

namespace surfel {

std::vector<std::string> Scene::problems() const {
  std::vector<std::string> found;
  check_rule(found, !materials.empty(), "the scene has no materials; it needs one at least");
  check_rule(found, ambient.allFinite(), "`ambient` must be finite");
  for (const Light& light : lights) {
    check_rule(found, light.vector.allFinite() && light.color.allFinite(),
               "vectors and colors of lights must be finite");
  }
  check_rule(found,
             !environment ||
                 (std::isfinite(environment->intensity) && std::isfinite(environment->rotation)),
             "intensity and rotation of the environment must be finite");
  return found;
}

}  // namespace surfel
