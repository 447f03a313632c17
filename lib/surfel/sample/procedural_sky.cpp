#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/procedural_sky.h>
#include <surfel/scene/lat_long.h>

namespace surfel {
namespace {

/// A rectangle that faces the origin, its lower side horizontal.
struct Softbox {
  double azimuth, height;          ///< Direction of its centre: radians from +z to +x, and up.
  double half_width, half_height;  ///< At distance 1.
  Vec3f radiance;
};

constexpr double kDegree = std::numbers::pi / 180;

/// A softbox as rays meet it.
struct Panel {
  Vec3d center, right, up;  ///< Unit; centre: the direction to it.
  double half_width, half_height;
  Vec3f radiance;

  explicit Panel(const Softbox& box)
      : half_width(box.half_width), half_height(box.half_height), radiance(box.radiance) {
    const double across = portable::cos(box.height);
    center = {across * portable::sin(box.azimuth), portable::sin(box.height),
              across * portable::cos(box.azimuth)};
    right = Vec3d::UnitY().cross(center).normalized();
    up = center.cross(right);
  }

  bool hit(const Vec3d& direction) const {
    const double along = direction.dot(center);
    return along > 0 && std::abs(direction.dot(right)) < half_width * along &&
           std::abs(direction.dot(up)) < half_height * along;
  }
};

const std::array<Panel, 4>& panels() {
  static const std::array<Panel, 4> all{{
      Panel({-50 * kDegree, 32 * kDegree, 0.28, 0.40, {3.2F, 2.3F, 1.4F}}),   // Key, warm.
      Panel({62 * kDegree, 22 * kDegree, 0.14, 0.50, {0.35F, 1.0F, 3.2F}}),   // Fill, blue.
      Panel({165 * kDegree, 28 * kDegree, 0.55, 0.10, {3.2F, 0.7F, 0.15F}}),  // Rim, orange.
      Panel({-120 * kDegree, 20 * kDegree, 0.12, 0.45, {0.2F, 2.4F, 0.9F}}),  // Side, green.
  }};
  return all;
}

Vec3f mixed(const Vec3f& a, const Vec3f& b, double part) {
  return a + static_cast<float>(part) * (b - a);
}

/// The part of the sky in a direction.
struct Seen {
  Vec3f radiance;
  int part;
  double distance = 0;  ///< On the floor, from the point below the eye.
};

// Numbers of the parts.
constexpr int kSky = 0;
constexpr int kSun = 1;
constexpr int kFloor = 2;   ///< And the dark squares next.
constexpr int kPanels = 4;  ///< The first of them.

Seen seen(const Vec3d& direction) {
  const Vec3f horizon(0.70F, 0.72F, 0.74F);
  if (direction.y() < 0) {
    // The floor, y = -1, fading into the horizon.
    const double x = direction.x() / -direction.y();
    const double z = direction.z() / -direction.y();
    const double square = std::floor(2 * x) + std::floor(2 * z);
    const bool dark = std::fmod(square, 2) == 0;
    const Vec3f floor = dark ? Vec3f(0.05F, 0.04F, 0.04F) : Vec3f(0.55F, 0.47F, 0.38F);
    const double distance = portable::hypot(x, z);
    return {mixed(horizon, floor, portable::exp(-distance / 25)), kFloor + (dark ? 1 : 0),
            distance};
  }
  for (std::size_t i = 0; i < panels().size(); ++i) {
    if (panels()[i].hit(direction)) return {panels()[i].radiance, kPanels + static_cast<int>(i)};
  }
  const Vec3f zenith(0.10F, 0.24F, 0.62F);
  static const Vec3d sun = Vec3d(0.35, 0.62, 0.70).normalized();
  Vec3f sky = mixed(horizon, zenith, portable::pow(direction.y(), 0.6));
  const double angle = portable::atan2(direction.cross(sun).norm(), direction.dot(sun)) / kDegree;
  sky += 1.5F * static_cast<float>(portable::exp(-angle / 6)) * Vec3f(1, 0.9F, 0.7F);
  if (angle < 2) return {sky + 60 * Vec3f(1, 0.92F, 0.8F), kSun};
  return {sky, kSky};
}

/// Distance on the floor from which on its squares may be hidden between the pixels' centres: a
/// square of 1/2 is seen at a distance d under 1 / (2 d^2).
double farthest_plain_floor(int height) {
  constexpr double kPixels = 2;  // To a square.
  return std::sqrt(height / (2 * kPixels * std::numbers::pi));
}

/// Mean of 6 x 6 points around a pixel's centre, in a tent that falls to nothing at the centres
/// next to it. Interpolated linearly as it was filtered, an edge has no steps.
Vec3f filtered(int x, int y, int width, int height) {
  constexpr int kPoints = 6;
  Vec3f sum(0, 0, 0);
  float total = 0;
  for (int j = 0; j < kPoints; ++j) {
    for (int i = 0; i < kPoints; ++i) {
      const double dx = 2 * (i + 0.5) / kPoints - 1;
      const double dy = 2 * (j + 0.5) / kPoints - 1;
      const auto w = static_cast<float>((1 - std::abs(dx)) * (1 - std::abs(dy)));
      sum += w * seen(lat_long_direction((x + 0.5 + dx) / width, (y + 0.5 + dy) / height)).radiance;
      total += w;
    }
  }
  return sum / total;
}

}  // namespace

Vec3f procedural_sky_radiance(const Vec3d& direction) {
  return seen(direction.normalized()).radiance;
}

Image procedural_sky(int width, int height) {
  if (width != 2 * height || height < 1) {
    throw_usage(
        fmt::format("a lat-long map of {}x{} pixels cannot be made; it is twice as wide as "
                    "high",
                    width, height));
  }
  Image image = rgba_image(width, height);
  // Most pixels lie within one part with all next to them, where their centre is as good as a mean.
  // In small pictures sun and lights may hide between the centres.
  constexpr int kPlainRows = 256;
  const double farthest = height < kPlainRows ? -1 : farthest_plain_floor(height);
  constexpr std::uint8_t kFine = 0xff;  // Marks pixels whose neighbours lie in other parts.
  std::vector<std::uint8_t> parts(static_cast<std::size_t>(width) *
                                  static_cast<std::size_t>(height));
  const auto part = [&](int x, int y) -> std::uint8_t& {
    return parts[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>((x + width) % width)];
  };
  const auto for_each_row = [&](const auto& body) {
    parallel_each(static_cast<std::size_t>(height), 8,
                  [&](std::size_t y) { body(static_cast<int>(y)); });
  };
  for_each_row([&](int y) {
    for (int x = 0; x < width; ++x) {
      const Seen at = seen(lat_long_direction((x + 0.5) / width, (y + 0.5) / height));
      part(x, y) = at.distance > farthest ? kFine : static_cast<std::uint8_t>(at.part);
      float* out = image.pixel(x, y);
      std::copy_n(at.radiance.data(), 3, out);
      out[3] = 1;
    }
  });
  for_each_row([&](int y) {
    for (int x = 0; x < width; ++x) {
      bool plain = part(x, y) != kFine;
      for (int row = std::max(0, y - 1); plain && row <= std::min(height - 1, y + 1); ++row) {
        for (int column = x - 1; column <= x + 1; ++column) {
          plain = plain && part(column, row) == part(x, y);
        }
      }
      if (plain) continue;
      const Vec3f mean = filtered(x, y, width, height);
      std::copy_n(mean.data(), 3, image.pixel(x, y));
    }
  });
  return image;
}

}  // namespace surfel
