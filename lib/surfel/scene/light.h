#pragma once

#include <surfel/base/types.h>

namespace surfel {

/// Light source; colours are linear and unbounded.
struct Light {
  enum class Type {
    kDirectional,  ///< `vector` points from the light into the scene, world axes.
    kHeadlight,    ///< A directional light whose vector is in camera axes (x right, y down, z
                   ///< forward): it moves with the camera.
    kPoint,        ///< `vector` is the light's place in the world; no fall-off.
  };
  Type type = Type::kHeadlight;
  Vec3d vector{0, 0, 1};
  Vec3f color{1, 1, 1};
};

}  // namespace surfel
