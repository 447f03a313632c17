#include <surfel/scene/clips.h>

namespace surfel {
namespace {

/// Surfels nearer to a line than this, in standard deviations, go on beyond it: the others have
/// less than 1.5 % of their kernels there.
constexpr double kMirrorReach = 2.2;

}  // namespace

HalfPlane half_plane(const SurfelCloud& cloud, std::size_t i, int which) {
  const Array<Vec3f>& column = which == 0 ? cloud.clip1 : cloud.clip2;
  if (column.empty() || column[i].isZero(0) || cloud.normal.empty()) return {};
  const double distance = (which == 0 ? cloud.clip1_distance : cloud.clip2_distance)[i];
  const Vec3d n = cloud.normal[i].cast<double>();
  const double length2 = n.squaredNorm();
  if (!(length2 > 0)) return {};
  const Vec3d given = column[i].cast<double>();
  const Vec3d across = given - n * (n.dot(given) / length2);
  const double length = across.norm();
  if (!(length > 0) || !std::isfinite(length) || !std::isfinite(distance)) return {};
  return {across / length, distance};
}

CutSurfel cut_surfel(const SurfelCloud& cloud, std::size_t i) {
  return {cloud.position[i].cast<double>(),
          cloud.anisotropic() ? Vec3d(cloud.tangent[i].cast<double>()) : Vec3d(0, 0, 0),
          {half_plane(cloud, i, 0), half_plane(cloud, i, 1)}};
}

void put_cut_surfel(const CutSurfel& surfel, SurfelCloud& cloud, std::size_t i) {
  cloud.position[i] = surfel.position.cast<float>();
  if (cloud.anisotropic()) cloud.tangent[i] = surfel.tangent.cast<float>();
  const auto put = [i](const HalfPlane& plane, Array<Vec3f>& direction, Array<float>& distance) {
    if (direction.empty()) return;
    direction[i] = plane.direction.cast<float>();
    distance[i] = static_cast<float>(plane.distance);
  };
  put(surfel.cut[0], cloud.clip1, cloud.clip1_distance);
  put(surfel.cut[1], cloud.clip2, cloud.clip2_distance);
}

CutSurfel mirror_image(const CutSurfel& surfel, std::size_t which) {
  const HalfPlane& mirror = surfel.cut[which];
  CutSurfel image = surfel;
  image.position += 2 * mirror.distance * mirror.direction;
  image.tangent -= 2 * mirror.direction.dot(surfel.tangent) * mirror.direction;
  for (HalfPlane& plane : image.cut) {
    plane.distance -= 2 * mirror.distance * mirror.direction.dot(plane.direction);
  }
  return image;
}

std::vector<CutSurfel> mirror_images(const CutSurfel& surfel,
                                     const std::array<double, 2>& deviation) {
  std::vector<CutSurfel> images;
  const auto near = [&](std::size_t j) {
    return surfel.cut[j].cuts() && surfel.cut[j].distance < kMirrorReach * deviation[j];
  };
  const auto add = [&](const CutSurfel& from, std::size_t j) {
    const CutSurfel image = mirror_image(from, j);
    for (std::size_t k = 0; k < 2; ++k) {
      if (image.cut[k].distance < -kMirrorReach * deviation[k]) return false;
    }
    images.push_back(image);
    return true;
  };
  if (near(0)) add(surfel, 0);
  if (!near(1) || !add(surfel, 1) || !near(0)) return images;
  const CutSurfel second = images.back();
  if (second.cut[0].distance > 0) add(second, 0);
  return images;
}

}  // namespace surfel
