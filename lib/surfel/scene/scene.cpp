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
  check_rule(found, !sky || (sky->color.allFinite() && sky->ground.allFinite()),
             "the colors of the sky and of the ground must be finite");
  check_rule(found, !sky || !sky->up || (sky->up->allFinite() && sky->up->norm() > 0),
             "`up` of the sky must be a direction");
  check_rule(found,
             !environment ||
                 (std::isfinite(environment->intensity) && std::isfinite(environment->rotation)),
             "intensity and rotation of the environment must be finite");
  return found;
}

Scene default_scene() {
  Scene scene;
  scene.ambient = {0, 0, 0};
  // Light straight from the eye leaves all that faces it equally bright. From a little above and to
  // the left of it slopes of either sense differ, and the shades that it leaves stay narrow.
  scene.lights = {Light{Light::Type::kHeadlight, {0.4, 0.6, 1}, {0.57F, 0.56F, 0.54F}}};
  // Together with the headlight at most 1 where a surface is white, so that nothing saturates.
  scene.sky = Sky{{}, {0.40F, 0.415F, 0.44F}, {0.10F, 0.09F, 0.08F}};
  return scene;
}

}  // namespace surfel
