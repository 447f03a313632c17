#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/lat_long.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/sample/procedural_sky.h>

namespace surfel {
namespace {

/// A rectangle that faces the origin, its lower side horizontal.
struct Softbox {
  double azimuth, height;          ///< Of its centre: radians from +z towards +x, and upwards.
  double half_width, half_height;  ///< At distance 1.
  Vec3f radiance;
};

constexpr double kDegree = std::numbers::pi / 180;

const std::vector<Softbox>& softboxes() {
  static const std::vector<Softbox> boxes{
      {-50 * kDegree, 32 * kDegree, 0.28, 0.40, {3.2F, 2.3F, 1.4F}},   // Key, warm.
      {62 * kDegree, 22 * kDegree, 0.14, 0.50, {0.35F, 1.0F, 3.2F}},   // Fill, blue.
      {165 * kDegree, 28 * kDegree, 0.55, 0.10, {3.2F, 0.7F, 0.15F}},  // Rim, orange.
      {-120 * kDegree, 20 * kDegree, 0.12, 0.45, {0.2F, 2.4F, 0.9F}},  // Side, green.
  };
  return boxes;
}

bool hits(const Softbox& box, const Vec3d& direction) {
  const double across = std::cos(box.height);
  const Vec3d center(across * std::sin(box.azimuth), std::sin(box.height),
                     across * std::cos(box.azimuth));
  const double along = direction.dot(center);
  if (along <= 0) return false;
  const Vec3d right = Vec3d::UnitY().cross(center).normalized();
  const Vec3d up = center.cross(right);
  return std::abs(direction.dot(right)) < box.half_width * along &&
         std::abs(direction.dot(up)) < box.half_height * along;
}

Vec3f mixed(const Vec3f& a, const Vec3f& b, double part) {
  return a + static_cast<float>(part) * (b - a);
}

}  // namespace

Vec3f procedural_sky_radiance(const Vec3d& toward) {
  const Vec3d direction = toward.normalized();
  const Vec3f horizon(0.70F, 0.72F, 0.74F);
  if (direction.y() < 0) {
    // The floor, y = -1, fading into the horizon.
    const double x = direction.x() / -direction.y();
    const double z = direction.z() / -direction.y();
    const double square = std::floor(2 * x) + std::floor(2 * z);
    const bool dark = std::fmod(square, 2) == 0;
    const Vec3f floor = dark ? Vec3f(0.05F, 0.04F, 0.04F) : Vec3f(0.55F, 0.47F, 0.38F);
    return mixed(horizon, floor, std::exp(-std::hypot(x, z) / 25));
  }
  for (const Softbox& box : softboxes()) {
    if (hits(box, direction)) return box.radiance;
  }
  const Vec3f zenith(0.10F, 0.24F, 0.62F);
  Vec3f sky = mixed(horizon, zenith, std::pow(direction.y(), 0.6));
  const Vec3d sun = Vec3d(0.35, 0.62, 0.70).normalized();
  const double angle = std::atan2(direction.cross(sun).norm(), direction.dot(sun)) / kDegree;
  sky += 1.5F * static_cast<float>(std::exp(-angle / 6)) * Vec3f(1, 0.9F, 0.7F);
  if (angle < 2) sky += 60 * Vec3f(1, 0.92F, 0.8F);
  return sky;
}

Image procedural_sky(int width, int height) {
  if (width != 2 * height) {
    throw_usage(
        fmt::format("a lat-long map of {}x{} pixels cannot be made; it is twice as wide as "
                    "high",
                    width, height));
  }
  return rasterize(
      [](double u, double v) { return procedural_sky_radiance(lat_long_direction(u, 1 - v)); },
      width, height);
}

}  // namespace surfel
