#include <algorithm>

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

std::vector<CutSurfel> within_either(const CutSurfel& surfel, double deviation) {
  const double reach = kMirrorReach * deviation;
  // The line of the first half-plane parts what is left, or, where the two lines turn little, the
  // line between them: half-planes that are nearly at right angles are cut by most exactly.
  constexpr double kLittleTurn = 0.5;  // Cosine of 60 degrees.
  const Vec3d& a = surfel.cut[0].direction;
  const Vec3d& b = surfel.cut[1].direction;
  const double cosine = a.dot(b);
  const bool bisect = cosine > kLittleTurn;
  const auto parted_by = [&](const CutSurfel& s) {
    if (!bisect) return s.cut[0];
    // The corner's offset from the centre is p a + q b.
    const double p = s.cut[0].distance - cosine * s.cut[1].distance;
    const double q = s.cut[1].distance - cosine * s.cut[0].distance;
    const Vec3d direction = (a - b).normalized();
    const double distance = (p * a + q * b).dot(direction) / (1 - cosine * cosine);
    return HalfPlane{direction, distance};
  };
  const auto part = [&](const CutSurfel& s, std::size_t j) {
    const HalfPlane parting = parted_by(s);
    CutSurfel result{s.position, s.tangent, {s.cut[j], HalfPlane{}}};
    if (j == 1) result.cut[1] = {-parting.direction, -parting.distance};
    if (j == 0 && bisect) result.cut[1] = parting;
    return result;
  };
  const auto matters = [&](const CutSurfel& s) {
    return std::all_of(s.cut.begin(), s.cut.end(), [&](const HalfPlane& plane) {
      return !plane.cuts() || plane.distance > -reach;
    });
  };
  const std::size_t own = parted_by(surfel).distance >= 0 ? 0 : 1;
  std::vector<CutSurfel> parts{part(surfel, own)};
  const auto add = [&](const CutSurfel& s) {
    if (matters(s)) parts.push_back(s);
  };
  add(part(surfel, 1 - own));
  // Only where no surface is, beyond both lines, images stand in for its surfels.
  for (std::size_t j = 0; j < 2; ++j) {
    const double distance = surfel.cut[j].distance;
    if (distance < 0 || distance >= reach) continue;
    const CutSurfel image = mirror_image(surfel, j);
    if (image.cut[0].distance < 0 && image.cut[1].distance < 0) add(part(image, j));
  }
  return parts;
}

}  // namespace surfel
