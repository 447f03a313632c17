#include <cmath>

#include <surfel/base/coordinate_spread.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/transform.h>

namespace surfel {
namespace {

constexpr std::size_t kTransformGrain = 1 << 16;
constexpr double kMostScale = 1e9;  ///< Kilometres to micrometres: areas, which are scaled twice,
                                    ///< stay far inside float's range.

template <class T, class Change>
void change(Array<T>& column, Change&& to) {
  parallel_for(column.size(), kTransformGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) column[i] = to(column[i]);
  });
}

}  // namespace

bool Similarity::identity() const {
  return scale == 1 && translation.isZero(0) && rotation.vec().isZero(0);
}

std::vector<std::string> Similarity::problems() const {
  std::vector<std::string> found;
  check_option(found, scale >= 1 / kMostScale && scale <= kMostScale, "scale", scale,
               "in 1e-9..1e9");
  if (!(std::abs(rotation.norm() - 1) < 1e-9)) {
    found.emplace_back("`rotation` has an axis without direction; give one that is not 0,0,0");
  }
  if (!translation.allFinite()) found.emplace_back("the translation is not finite");
  return found;
}

void transform_cloud(SurfelCloud& cloud, const Similarity& similarity) {
  require_usable(similarity);
  if (similarity.identity()) return;
  const Eigen::Matrix3d rotation = similarity.rotation.toRotationMatrix();
  const Eigen::Matrix3d linear = similarity.scale * rotation;
  const auto moved = [&](const Vec3d& world) -> Vec3d {
    return linear * world + similarity.translation;
  };

  SurfelCloud at_old_origin;
  at_old_origin.origin = moved(cloud.origin);
  // Bounds of the new places as offsets from the old origin's new place; the offsets are small
  // enough for floats.
  at_old_origin.position = cloud.position;
  change(at_old_origin.position,
         [&](const Vec3f& p) -> Vec3f { return (linear * p.cast<double>()).cast<float>(); });
  CoordinateSpread spread;
  spread.add(at_old_origin.origin, at_old_origin.position);
  const Vec3d origin = float_origin(spread.core(at_old_origin.bounds()));
  const Vec3d shift = at_old_origin.origin - origin;
  parallel_each(cloud.size(), kTransformGrain, [&](std::size_t i) {
    Vec3f& p = cloud.position[i];
    if (cloud.exact.empty()) {
      p = (linear * p.cast<double>() + shift).cast<float>();
    } else {
      cloud.exact[i] = moved(cloud.world(i));
      p = (cloud.exact[i] - origin).cast<float>();
    }
  });
  cloud.origin = origin;

  const auto turned = [&](const Vec3f& v) -> Vec3f {
    return (rotation * v.cast<double>()).cast<float>();
  };
  const auto stretched = [&](const Vec3f& v) -> Vec3f {
    return (linear * v.cast<double>()).cast<float>();
  };
  const auto times = [](double factor) {
    return [factor](float v) { return static_cast<float>(factor * static_cast<double>(v)); };
  };
  const double square = similarity.scale * similarity.scale;
  change(cloud.normal, turned);
  change(cloud.shading_normal, turned);
  change(cloud.tangent, turned);
  change(cloud.clip1, turned);
  change(cloud.clip2, turned);
  change(cloud.dpdu, stretched);
  change(cloud.dpdv, stretched);
  change(cloud.variance, times(square));
  change(cloud.variance_u, times(square));
  change(cloud.variance_v, times(square));
  change(cloud.area, times(square));
  change(cloud.group_radius, times(similarity.scale));
  change(cloud.clip1_distance, times(similarity.scale));
  change(cloud.clip2_distance, times(similarity.scale));
  const auto move_view = [&](Viewpoint& view) {
    Vec4d& q = view.orientation;
    const Eigen::Quaterniond turned_view =
        similarity.rotation * Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    q = {turned_view.w(), turned_view.x(), turned_view.y(), turned_view.z()};
    view.position = moved(view.position);
  };
  if (cloud.viewpoint) move_view(*cloud.viewpoint);
  for (Viewpoint& view : cloud.scan_viewpoints) move_view(view);
  if (cloud.up) cloud.up = rotation * *cloud.up;
  // Moved coordinates are of no system.
  set_coordinate_system(cloud, std::nullopt);
  cloud.las.reset();
  cloud.decimals.reset();
}

}  // namespace surfel
