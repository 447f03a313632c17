#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/sample/noise.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/sample/procedural_surface.h>

namespace surfel {
namespace {

/// The parallelogram corner + u * edge_u + v * edge_v.
class Plane final : public ParametricSurface {
 public:
  Plane(const Vec3d& corner, const Vec3d& edge_u, const Vec3d& edge_v)
      : corner_(corner), edge_u_(edge_u), edge_v_(edge_v) {}
  Point at(double u, double v) const override {
    return {corner_ + u * edge_u_ + v * edge_v_, edge_u_.cross(edge_v_).normalized(), edge_u_,
            edge_v_};
  }

 private:
  Vec3d corner_, edge_u_, edge_v_;
};

/// Radii about an axis through `center`.
class Torus final : public ParametricSurface {
 public:
  Torus(double major, double minor, const Vec3d& center = Vec3d::Zero(),
        const Vec3d& axis = Vec3d::UnitZ())
      : major_(major),
        minor_(minor),
        center_(center),
        rotation_(Eigen::Quaterniond::FromTwoVectors(Vec3d::UnitZ(), axis).toRotationMatrix()) {}
  bool closed_u() const override { return true; }
  bool closed_v() const override { return true; }
  Point at(double u, double v) const override {
    const double phi = 2 * std::numbers::pi * u;
    const double psi = 2 * std::numbers::pi * v;
    const Vec3d radial(portable::cos(phi), portable::sin(phi), 0);
    const Vec3d along(-portable::sin(phi), portable::cos(phi), 0);
    const Vec3d normal = portable::cos(psi) * radial + portable::sin(psi) * Vec3d::UnitZ();
    const Vec3d dpdv = 2 * std::numbers::pi * minor_ *
                       (portable::cos(psi) * Vec3d::UnitZ() - portable::sin(psi) * radial);
    return {center_ + rotation_ * (major_ * radial + minor_ * normal), rotation_ * normal,
            rotation_ * (2 * std::numbers::pi * (major_ + minor_ * portable::cos(psi)) * along),
            rotation_ * dpdv};
  }

 private:
  double major_, minor_;
  Vec3d center_;
  Eigen::Matrix3d rotation_;
};

/// p = r(d) d over the directions d: u turns about +y with +z at u = 1/2, v rises from -y to +y.
class StarSurface : public ParametricSurface {
 public:
  bool closed_u() const final { return true; }
  bool has_poles() const final { return true; }
  Point at(double u, double v) const final {
    const double phi = 2 * std::numbers::pi * (u - 0.5);
    const double theta = std::numbers::pi * v;
    // At a pole sin(pi) is not quite zero in floating point; the derivative by u must be.
    const double ring = v <= 0 || v >= 1 ? 0 : portable::sin(theta);
    const Vec3d d(ring * portable::sin(phi), -portable::cos(theta), ring * portable::cos(phi));
    const Vec3d d_by_u =
        2 * std::numbers::pi * Vec3d(ring * portable::cos(phi), 0, -ring * portable::sin(phi));
    const Vec3d d_by_v =
        std::numbers::pi * Vec3d(portable::cos(theta) * portable::sin(phi), portable::sin(theta),
                                 portable::cos(theta) * portable::cos(phi));
    const NoiseValue<3> r = radius(d);
    const Vec3d tangential = r.gradient - d * d.dot(r.gradient);
    return {r.value * d, (r.value * d - tangential).normalized(),
            r.gradient.dot(d_by_u) * d + r.value * d_by_u,
            r.gradient.dot(d_by_v) * d + r.value * d_by_v};
  }

 private:
  /// r and its gradient (in space; only its tangential part matters) at a unit direction.
  virtual NoiseValue<3> radius(const Vec3d& d) const = 0;
};

class Sphere final : public StarSurface {
 public:
  explicit Sphere(double radius) : radius_(radius) {}

 private:
  NoiseValue<3> radius(const Vec3d&) const override { return {radius_, Vec3d::Zero()}; }
  double radius_;
};

/// An ellipsoid with features (lobes that fall off around a direction) and fractal relief.
class Head final : public StarSurface {
 public:
  explicit Head(std::uint64_t seed) : seed_(seed) {}

 private:
  struct Lobe {
    Vec3d direction;
    double height;     ///< Height as a share of the radius.
    double sharpness;  ///< Falls to 1/e at an angle of about sqrt(2 / sharpness).
  };

  NoiseValue<3> radius(const Vec3d& d) const override {
    const Vec3d inverse_square = Vec3d(0.72, 1.0, 0.86).cwiseAbs2().cwiseInverse();
    const double ellipsoid = 1 / std::sqrt(d.dot(inverse_square.cwiseProduct(d)));
    const Vec3d ellipsoid_gradient =
        -ellipsoid * ellipsoid * ellipsoid * inverse_square.cwiseProduct(d);

    NoiseValue<3> feature{1, Vec3d::Zero()};
    for (const Lobe& lobe : kLobes) {
      const double value =
          lobe.height * portable::exp(lobe.sharpness * (d.dot(lobe.direction) - 1));
      feature.value += value;
      feature.gradient += lobe.sharpness * value * lobe.direction;
    }
    for (const auto& [spectrum, amplitude] : kRelief) {
      const NoiseValue<3> noise = fractal_noise<3>(d, spectrum, seed_);
      feature.value += amplitude * noise.value;
      feature.gradient += amplitude * noise.gradient;
    }
    return {ellipsoid * feature.value,
            ellipsoid * feature.gradient + ellipsoid_gradient * feature.value};
  }

  static Vec3d toward(double x, double y, double z) { return Vec3d(x, y, z).normalized(); }
  static inline const std::array<Lobe, 11> kLobes{{
      {toward(0, -0.12, 1), 0.20, 90},       // nose
      {toward(0, 0.12, 1), 0.07, 120},       // bridge of the nose
      {toward(0.26, 0.12, 1), -0.10, 70},    // eye sockets
      {toward(-0.26, 0.12, 1), -0.10, 70},   //
      {toward(0, 0.36, 1), 0.04, 25},        // forehead
      {toward(0, -0.45, 1), -0.06, 120},     // mouth
      {toward(0, -0.85, 0.9), 0.10, 30},     // chin
      {toward(0.45, -0.2, 0.9), 0.05, 25},   // cheeks
      {toward(-0.45, -0.2, 0.9), 0.05, 25},  //
      {toward(1, 0, -0.05), 0.16, 90},       // ears
      {toward(-1, 0, -0.05), 0.16, 90},      //
  }};
  /// Unevenness of the whole, and the skin's.
  static inline const std::array<std::pair<FractalNoise, double>, 2> kRelief{{
      {{3, 2, 0.5}, 0.05},
      {{2, 24, 0.5}, 0.006},
  }};
  std::uint64_t seed_;
};

/// Heights y over [-1, 1]^2; u runs along +x, v along -z, so that the outside is up.
class Terrain final : public ParametricSurface {
 public:
  explicit Terrain(std::uint64_t seed) : seed_(seed) {}
  Point at(double u, double v) const override {
    const NoiseValue<2> height = fractal_noise<2>(Vec2d(u, v), {9, 2.5, 0.45}, seed_);
    const Vec3d dpdu(2, kHeight * height.gradient.x(), 0);
    const Vec3d dpdv(0, kHeight * height.gradient.y(), -2);
    return {Vec3d(2 * u - 1, kHeight * height.value, 1 - 2 * v), dpdu.cross(dpdv).normalized(),
            dpdu, dpdv};
  }

 private:
  static constexpr double kHeight = 0.6;  ///< Heights are within about 0.4, on a side of 2.
  std::uint64_t seed_;
};

float smooth_step(double from, double to, double x) {
  const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return static_cast<float>(t * t * (3 - 2 * t));
}

Vec3f blend(const Vec3f& a, const Vec3f& b, float t) { return a + (b - a) * t; }

/// Skin with freckles, lips and hair, by direction from the centre.
Vec3f head_color(double, double, const ParametricSurface::Point& p) {
  const Vec3d d = p.position.normalized();
  const double mottle = fractal_noise<3>(d, {4, 6, 0.6}, 1).value;
  const double freckles = gradient_noise<3>(d * 40, 2).value;
  const double strands = fractal_noise<3>(d.cwiseProduct(Vec3d(60, 6, 60)), {3, 1, 0.7}, 3).value;
  const double hairline = d.y() - 0.55 - 0.35 * std::max(0.0, d.z()) +
                          0.25 * std::max(0.0, -d.z()) + 0.6 * std::max(0.0, -d.z()) + 0.1 * mottle;
  const double mouth = Vec2d(d.x() / 0.22, (d.y() + 0.4) / 0.045).norm();
  Vec3f color = blend(Vec3f(0.62f, 0.33f, 0.22f), Vec3f(0.72f, 0.42f, 0.30f),
                      static_cast<float>(0.5 + mottle));
  color = blend(color, Vec3f(0.40f, 0.17f, 0.09f), 0.6f * smooth_step(0.2, 0.35, freckles));
  if (d.z() > 0) color = blend(color, Vec3f(0.45f, 0.07f, 0.07f), 1 - smooth_step(0.8, 1.1, mouth));
  for (const double side : {-0.25, 0.25}) {
    const double eye = Vec2d((d.x() - side) / 0.07, (d.y() - 0.11) / 0.04).norm();
    if (d.z() > 0) color = blend(color, Vec3f(0.02f, 0.05f, 0.09f), 1 - smooth_step(0.7, 1, eye));
  }
  const Vec3f hair = blend(Vec3f(0.03f, 0.015f, 0.01f), Vec3f(0.20f, 0.09f, 0.03f),
                           smooth_step(-0.4, 0.5, strands));
  return blend(color, hair, smooth_step(-0.02, 0.02, hairline));
}

/// Water line, grass, rock and snow by height and slope, under detail down to 1/2000 of the side.
Vec3f terrain_color(double u, double v, const ParametricSurface::Point& p) {
  const double detail = fractal_noise<2>(Vec2d(u, v), {5, 60, 0.75}, 7).value;
  const double height = p.position.y() + 0.05 * detail;
  const Vec3f grass(0.08f, 0.20f, 0.03f), rock(0.25f, 0.20f, 0.16f), snow(0.85f, 0.88f, 0.92f),
      sand(0.55f, 0.42f, 0.22f);
  Vec3f color = blend(sand, grass, smooth_step(-0.16, -0.10, height));
  color = blend(color, snow, smooth_step(0.10, 0.14, height));
  color = blend(rock, color, smooth_step(0.60, 0.75, p.normal.y() + 0.1 * detail));
  return (color * static_cast<float>(1 + 0.9 * detail)).cwiseMax(0).cwiseMin(1);
}

SurfacePart part(std::unique_ptr<const ParametricSurface> shape, ProceduralTexture texture,
                 float alpha = 1) {
  auto color = [texture = std::move(texture)](double u, double v, const ParametricSurface::Point&) {
    return texture(u, v);
  };
  return {std::move(shape), std::move(color), alpha};
}

/// Checks of the given number across, in shades of a colour.
ProceduralTexture checks(double frequency, const Vec3f& color) {
  ProceduralTextureOptions options;
  options.frequency = frequency;
  options.dark = 0.35f * color;
  options.light = color;
  return procedural_texture("checker", options);
}

/// Stands in for SS01 figure 7: shells inside shells, rings through shells, panes through panes.
std::vector<SurfacePart> transparent_parts() {
  std::vector<SurfacePart> parts;
  parts.push_back(part(std::make_unique<Sphere>(0.8), checks(12, {0.3f, 0.6f, 0.9f}), 0.3f));
  parts.push_back(part(std::make_unique<Sphere>(0.45), checks(10, {0.9f, 0.55f, 0.15f}), 0.5f));
  parts.push_back(part(std::make_unique<Sphere>(0.2), checks(8, {0.8f, 0.1f, 0.15f}), 0.6f));
  parts.push_back(part(std::make_unique<Torus>(0.8, 0.15, Vec3d::Zero(), Vec3d(0.2, 1, 0.3)),
                       checks(16, {0.2f, 0.8f, 0.3f}), 0.4f));
  parts.push_back(
      part(std::make_unique<Plane>(Vec3d(-0.9, -0.6, -0.5), Vec3d(1.8, 0, 1.0), Vec3d(0, 1.2, 0)),
           checks(9, {0.8f, 0.8f, 0.3f}), 0.25f));
  parts.push_back(
      part(std::make_unique<Plane>(Vec3d(-0.9, -0.6, 0.5), Vec3d(1.8, 0, -1.0), Vec3d(0, 1.2, 0)),
           checks(9, {0.8f, 0.3f, 0.8f}), 0.2f));
  return parts;
}

std::vector<SurfacePart> parts_of(const std::string& kind, std::uint64_t seed) {
  const Vec3f white(0.9f, 0.9f, 0.9f);
  std::vector<SurfacePart> parts;
  if (kind == "plane") {
    parts.push_back(part(std::make_unique<Plane>(Vec3d(-1, -1, 0), Vec3d(2, 0, 0), Vec3d(0, 2, 0)),
                         checks(16, white)));
  } else if (kind == "sphere") {
    parts.push_back(part(std::make_unique<Sphere>(1), checks(16, {0.9f, 0.5f, 0.3f})));
  } else if (kind == "torus") {
    parts.push_back(part(std::make_unique<Torus>(0.7, 0.3), checks(16, {0.3f, 0.6f, 0.9f})));
  } else if (kind == "head") {
    parts.push_back({std::make_unique<Head>(seed), head_color});
  } else if (kind == "terrain") {
    parts.push_back({std::make_unique<Terrain>(seed), terrain_color});
  } else if (kind == "transparent") {
    parts = transparent_parts();
  } else {
    throw_usage(fmt::format("no surface is called '{}'; there are {}{}", kind,
                            fmt::join(procedural_scene_names(), ", "),
                            did_you_mean(kind, procedural_scene_names())));
  }
  return parts;
}

}  // namespace

const std::vector<std::string>& procedural_scene_names() {
  static const std::vector<std::string> names{"plane", "sphere",  "torus",
                                              "head",  "terrain", "transparent"};
  return names;
}

ProceduralScene procedural_scene(const std::string& kind, std::uint64_t seed,
                                 const std::string& texture, double frequency) {
  ProceduralScene scene{parts_of(kind, seed)};
  if (!texture.empty()) {
    ProceduralTextureOptions options;
    options.frequency = frequency;
    options.seed = seed;
    for (SurfacePart& p : scene.parts) {
      p = part(std::move(p.shape), procedural_texture(texture, options), p.alpha);
    }
  }
  scene.transparent = std::any_of(scene.parts.begin(), scene.parts.end(),
                                  [](const SurfacePart& p) { return p.alpha < 1; });
  return scene;
}

}  // namespace surfel
