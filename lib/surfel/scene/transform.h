#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Maps world coordinates x to scale * (rotation * x) + translation.
struct Similarity {
  double scale = 1;                             ///< 1e-9..1e9.
  Quaternion rotation{Quaternion::Identity()};  ///< Unit.
  Vec3d translation{0, 0, 0};                   ///< Scene units.

  bool identity() const;
  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Moves a cloud: positions, in double, to an origin that suits them; normals, tangents and
/// derivatives are turned, lengths, variances and areas scaled, the viewpoint moved, `up` turned.
/// All other properties stay as they are. The identity changes nothing, not a bit. Throws
/// Error(kUsage) for an unusable similarity.
SURFEL_API void transform_cloud(SurfelCloud& cloud, const Similarity& similarity);

}  // namespace surfel
