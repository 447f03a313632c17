#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/base/random.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/hard_cases.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/framing.h>

namespace surfel {
namespace {

constexpr int kSize = 128;  ///< Side of the pictures, pixels.
const Vec3f kYellow(0.9F, 0.8F, 0.3F), kBlue(0.05F, 0.1F, 0.3F);

/// Arguments of the functions below that make the cases.
struct Request {
  double value;
  std::uint64_t seed;
};

CameraOptions look(const Vec3d& eye, const Vec3d& target, double fov = 40,
                   const Vec3d& up = Vec3d(0.02, 1, 0.01)) {
  CameraOptions view;
  view.eye = eye;
  view.target = target;
  view.up = up;
  view.fov = fov;
  view.width = view.height = kSize;
  return view;
}

/// The focal length of a view of kSize pixels, pixels.
double focal(double fov = 40) { return kSize / (2 * portable::tan(fov * std::numbers::pi / 360)); }

/// View of the origin from `distance` in front of it, `angle` degrees off the z axis.
CameraOptions orbit(double distance, double angle, double fov = 40) {
  const double a = angle * std::numbers::pi / 180;
  return look(Vec3d(0, 0.0 - distance * portable::sin(a), distance * portable::cos(a)),
              Vec3d(0, 0, 0), fov);
}

void add(SurfelCloud& cloud, const Vec3d& position, const Vec3d& normal, double area,
         const Vec3f& color) {
  cloud.position.push_back(position.cast<float>());
  cloud.normal.push_back(normal.cast<float>());
  cloud.variance.push_back(static_cast<float>(area));
  cloud.area.push_back(static_cast<float>(area));
  cloud.color.push_back(color);
}

Vec3f random_color(std::uint64_t seed, std::uint64_t index) {
  return Vec3d(random_uniform(seed, index, 3), random_uniform(seed, index, 4),
               random_uniform(seed, index, 5))
      .cast<float>();
}

/// A square of jittered surfels, columns x rows of them, V = h^2 I.
struct Sheet {
  Vec3d center{0, 0, 0};
  Vec3d across{1, 0, 0};  ///< Unit vectors; the normal is their product.
  Vec3d along{0, 1, 0};
  double half = 1;
  int side = 48;  ///< Surfels.
  double jitter = 0.3;
  std::uint64_t seed = 1;

  double spacing() const { return 2 * half / side; }
};

/// Colour at (u, v), scene units from the centre.
using SheetColor = std::function<Vec3f(double u, double v)>;

SheetColor plain(const Vec3f& color) {
  return [color](double, double) { return color; };
}

SheetColor checks(double cell) {
  return [cell](double u, double v) {
    const auto index = [cell](double x) { return static_cast<int>(std::floor(x / cell)); };
    return ((index(u) + index(v)) & 1) != 0 ? kYellow : kBlue;
  };
}

void add_sheet(SurfelCloud& cloud, const Sheet& sheet, const SheetColor& color) {
  const double h = sheet.spacing();
  const Vec3d normal = sheet.across.cross(sheet.along);
  for (int j = 0; j < sheet.side; ++j) {
    for (int i = 0; i < sheet.side; ++i) {
      const auto k = static_cast<std::uint64_t>(j) * sheet.side + i;
      const auto place = [&](int cell, int axis) {
        const double offset = sheet.jitter * (2 * random_uniform(sheet.seed, k, axis) - 1);
        return -sheet.half + (cell + 0.5 + offset) * h;
      };
      const double u = place(i, 0);
      const double v = place(j, 1);
      add(cloud, sheet.center + u * sheet.across + v * sheet.along, normal, h * h, color(u, v));
    }
  }
}

/// Texture coordinates of a sheet in its place: the unit square over the sheet's own.
void add_uv(SurfelCloud& cloud, const Sheet& sheet) {
  for (const Vec3f& p : cloud.position) {
    const Vec3d d = p.cast<double>() - sheet.center;
    cloud.uv.push_back(Vec2d(0.5 + d.dot(sheet.across) / (2 * sheet.half),
                             0.5 + d.dot(sheet.along) / (2 * sheet.half))
                           .cast<float>());
    cloud.dpdu.push_back((2 * sheet.half * sheet.across).cast<float>());
    cloud.dpdv.push_back((2 * sheet.half * sheet.along).cast<float>());
  }
}

/// Fibonacci's sphere, of colours that vary over a few surfels.
SurfelCloud sphere(int count, double radius, const Vec3d& center = {0, 0, 0}) {
  SurfelCloud cloud;
  const double area = 4 * std::numbers::pi * radius * radius / count;
  const double wave = 3 * std::sqrt(area);
  const auto level = [&](double x) {
    return static_cast<float>(0.5 + 0.45 * portable::sin(x / wave));
  };
  for (int i = 0; i < count; ++i) {
    const double y = 1 - (2 * i + 1.0) / count;
    const double ring = std::sqrt(1 - y * y);
    const double phi = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const Vec3d n(ring * portable::cos(phi), y, ring * portable::sin(phi));
    const Vec3d p = radius * n;
    add(cloud, center + p, n, area, {level(p.x()), level(p.y()), level(p.sum())});
  }
  return cloud;
}

/// A sheet with a view.
HardScene sheet_scene(const Sheet& sheet, const SheetColor& color, const CameraOptions& view) {
  HardScene scene{{}, view};
  add_sheet(scene.cloud, sheet, color);
  return scene;
}

/// The sphere's points without normals and sizes.
SurfelCloud points(int count) {
  SurfelCloud cloud = sphere(count, 1);
  cloud.normal = {};
  cloud.variance = {};
  cloud.area = {};
  return cloud;
}

void add_point(SurfelCloud& cloud, const Vec3d& position) {
  cloud.position.push_back(position.cast<float>());
  cloud.color.push_back(Vec3f(0.8F, 0.1F, 0.1F));
}

HardScene grazing(const Request& r) {
  const Sheet sheet{.side = 40, .seed = r.seed};
  return sheet_scene(sheet, checks(4 * sheet.spacing()), orbit(2.2, r.value, 10));
}

HardScene near_plane(const Request& r) {
  const Sheet floor{
      .across = Vec3d::UnitX(), .along = -Vec3d::UnitZ(), .half = 2, .side = 60, .seed = r.seed};
  return sheet_scene(floor, checks(4 * floor.spacing()),
                     look(Vec3d(0.01, r.value, 0.02), Vec3d(0.3, r.value - 0.15, -1), 60));
}

/// From a pixel on: discs of so many pixels across, on a slant. Below a pixel: as many discs as
/// fill a visible square, no more than a million.
HardScene splat_size(const Request& r) {
  const double spacing = r.value / (2 * std::numbers::sqrt2) / focal();  // At distance 1.
  const int side = r.value >= 1 ? std::clamp(static_cast<int>(1.5 / spacing), 6, 1000)
                                : std::min(static_cast<int>(8 / r.value), 1000);
  const Sheet sheet{.half = side * spacing / 2, .side = side, .seed = r.seed};
  return sheet_scene(sheet, r.value >= 1 ? checks(spacing) : plain(Vec3f(0.8F, 0.8F, 0.8F)),
                     orbit(1, r.value >= 1 ? 60 : 0));
}

HardScene inside(const Request& r) {
  const Vec3d eye((1 - r.value) * Vec3d(1, 0.02, 0.01).normalized());
  return {sphere(4000, 1), look(eye, eye + Vec3d(0.3, 0.1, 1), 60)};
}

HardScene coincident(const Request& r) {
  HardScene scene{points(3000), orbit(3.2, 0)};
  for (int i = 0; i < 3000; i += 10) {
    for (int copy = 1; copy < static_cast<int>(r.value); ++copy) {
      scene.cloud.position.push_back(scene.cloud.position[i]);
      scene.cloud.color.push_back(scene.cloud.color[i]);
    }
  }
  return scene;
}

HardScene collinear(const Request& r) {
  HardScene scene{points(3000), orbit(4, 0)};
  for (int i = 0; i < 200; ++i) {
    add_point(scene.cloud, Vec3d(1.2, -1 + 0.01 * i, 0.2 * random_uniform(r.seed, 0)));
  }
  return scene;
}

HardScene isolated(const Request& r) {
  HardScene scene{points(3000), orbit(5, 0)};
  for (int i = 0; i < 20; ++i) {
    const double phi = 2 * std::numbers::pi * (i + 0.5 * random_uniform(r.seed, i)) / 20;
    add_point(scene.cloud, Vec3d(1.6 * portable::cos(phi), 1.6 * portable::sin(phi), 0));
  }
  return scene;
}

HardScene not_finite(const Request& r) {
  HardScene scene{points(3000), orbit(3.2, 0)};
  for (std::size_t i = 0; i < scene.cloud.size(); i += 20) {
    scene.cloud.position[i][static_cast<int>(random_bits(r.seed, i) % 3)] =
        i % 40 == 0 ? std::numeric_limits<float>::quiet_NaN()
                    : std::numeric_limits<float>::infinity();
  }
  return scene;
}

/// So few points that a neighbourhood of 16 holds them all.
HardScene few_points(const Request& r) {
  HardScene scene{{}, orbit(4, 0)};
  for (int i = 0; i < static_cast<int>(r.value); ++i) {
    add_point(scene.cloud, Vec3d(0.3 * i, 0.1 * i * i, 0.01 * i * i * i));
  }
  return scene;
}

/// `value` times as many points to the left of x = 0 as to the right.
HardScene density(const Request& r) {
  HardScene scene{{}, orbit(1.3, 0)};
  const double ratio = std::sqrt(r.value);
  const int coarse = 12;
  const int fine = static_cast<int>(std::lround(coarse * ratio));
  for (const auto& [side, x] : {std::pair{fine, -0.5}, {coarse, 0.5}}) {
    SurfelCloud half;
    const Sheet sheet{.center = {x, 0, 0}, .half = 0.5, .side = side, .seed = r.seed};
    add_sheet(half, sheet, plain(Vec3f(0.7F, 0.7F, 0.7F)));
    scene.cloud.position.insert(scene.cloud.position.end(), half.position.begin(),
                                half.position.end());
    scene.cloud.color.insert(scene.cloud.color.end(), half.color.begin(), half.color.end());
  }
  return scene;
}

/// Red in front of green. `value` is their distance in radii of the discs at cutoff 1.
HardScene two_sheets(const Request& r, bool back_to_back) {
  const double gap = r.value * std::numbers::sqrt2 * Sheet{}.spacing();
  HardScene scene =
      sheet_scene(Sheet{.seed = r.seed}, plain(Vec3f(0.8F, 0.05F, 0.05F)), orbit(1.6, 0));
  Sheet behind{.center = {0, 0, -gap}, .seed = r.seed + 1};
  if (back_to_back) behind.across *= -1;
  add_sheet(scene.cloud, behind, plain(Vec3f(0.05F, 0.8F, 0.05F)));
  return scene;
}
HardScene sheets(const Request& r) { return two_sheets(r, false); }
HardScene thin_body(const Request& r) { return two_sheets(r, true); }

/// Two panes that cross at `value` degrees.
HardScene intersecting(const Request& r) {
  HardScene scene{{}, look(Vec3d(0, 0, 2.2), Vec3d(0, 0, 0))};
  const double a = r.value * std::numbers::pi / 360;
  for (const double turn : {a, -a}) {
    const Vec3d across(portable::cos(turn), 0, portable::sin(turn));
    add_sheet(scene.cloud, Sheet{.across = across, .side = 96, .seed = r.seed + (turn > 0 ? 0 : 1)},
              plain(turn > 0 ? Vec3f(0.9F, 0.2F, 0.1F) : Vec3f(0.1F, 0.3F, 0.9F)));
  }
  scene.cloud.alpha.assign(scene.cloud.size(), 0.5F);
  return scene;
}

HardScene silhouette(const Request& r) {
  HardScene scene{sphere(static_cast<int>(r.value), 1), look(Vec3d(0, 0, 3.5), Vec3d(0, 0, 0))};
  std::fill(scene.cloud.color.begin(), scene.cloud.color.end(), Vec3f(0.8F, 0.8F, 0.8F));
  return scene;
}

/// In which order the surfels of a stack of panes come.
enum class Arrival { kShuffled, kNearFirst, kFarFirst };

HardScene stack(const Request& r, Arrival arrival) {
  const int count = static_cast<int>(r.value);
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    const int pane = arrival == Arrival::kFarFirst ? count - 1 - i : i;
    const auto unit = [&](int dimension) {
      return static_cast<float>(random_uniform(r.seed + 5, pane, dimension));
    };
    add_sheet(cloud,
              Sheet{.center = {0, 0, -0.3 * pane}, .half = 2.5, .side = 50, .seed = r.seed + pane},
              plain(Vec3f(unit(1), unit(2), unit(3))));
    cloud.alpha.resize(cloud.size(), 0.2F + 0.4F * unit(0));
  }
  if (arrival == Arrival::kShuffled) {
    Array<std::uint32_t> order(cloud.size());
    for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
      return random_bits(r.seed, a) < random_bits(r.seed, b);
    });
    cloud = cloud.gathered(order);
  }
  return {std::move(cloud), look(Vec3d(0, 0, 2.5), Vec3d(0, 0, 0), 30)};
}
HardScene layers(const Request& r) { return stack(r, Arrival::kShuffled); }
HardScene layers_near_first(const Request& r) { return stack(r, Arrival::kNearFirst); }
HardScene layers_far_first(const Request& r) { return stack(r, Arrival::kFarFirst); }

/// A sheet with texture coordinates, its kernels `value` spacings wide.
HardScene condition(const Request& r) {
  const Sheet sheet{.side = 32, .seed = r.seed};
  // Neighbours two pixels apart: kernels of any width leave no holes there.
  HardScene scene =
      sheet_scene(sheet, plain(Vec3f(0.5F, 0.5F, 0.5F)), orbit(focal() * sheet.spacing() / 2, 0));
  add_uv(scene.cloud, sheet);
  for (float& variance : scene.cloud.variance) variance *= static_cast<float>(r.value * r.value);
  return scene;
}

/// The sheet of condition(), every surfel `value` times.
HardScene duplicates(const Request& r) {
  HardScene scene = condition({0.7, r.seed});
  const auto copies = static_cast<std::uint32_t>(r.value);
  Array<std::uint32_t> order;
  for (std::uint32_t i = 0; i < scene.cloud.size(); ++i) order.insert(order.end(), copies, i);
  scene.cloud = scene.cloud.gathered(order);
  return scene;
}

/// Two white charts side by side on the surface and apart in a picture that is black between.
HardScene seam(const Request& r) {
  const auto width = static_cast<int>(r.value);
  Image image = rgba_image(width, width);
  std::fill(image.data.begin(), image.data.end(), 1.0F);
  const auto on_chart = [](double s) {
    return std::abs(s - 0.25) < 0.2 || std::abs(s - 0.75) < 0.2;
  };
  for (int y = 0; y < width; ++y) {
    for (int x = 0; x < width; ++x) {
      if (!on_chart((x + 0.5) / width)) std::fill_n(image.pixel(x, y), 3, 0.0F);
    }
  }
  TriangleMesh mesh;
  HardScene scene =
      sheet_scene(Sheet{.side = 40, .seed = r.seed}, plain(Vec3f(0.5F, 0.5F, 0.5F)), orbit(2.4, 0));
  for (const Vec3f& p : scene.cloud.position) {
    const float u = p.x() < 0 ? 0.45F + 0.4F * p.x() : 0.55F + 0.4F * p.x();
    scene.cloud.uv.push_back(Vec2f(u, 0.5F + 0.5F * p.y()));
    scene.cloud.dpdu.push_back(Vec3f(2.5F, 0, 0));
    scene.cloud.dpdv.push_back(Vec3f(0, 2, 0));
  }
  for (const int half : {0, 1}) {
    const float x = half == 0 ? -1.0F : 0.0F;
    const float u = half == 0 ? 0.05F : 0.55F;
    const auto base = static_cast<std::uint32_t>(mesh.position.size());
    const Vec2f corner[] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    std::array<Vec2f, 4> uv;
    for (int k = 0; k < 4; ++k) {
      mesh.position.push_back(Vec3f(x + corner[k].x(), 2 * corner[k].y() - 1, 0));
      uv[k] = Vec2f(u + 0.4F * corner[k].x(), corner[k].y());
    }
    for (const std::array<std::uint32_t, 3>& f :
         {std::array<std::uint32_t, 3>{0, 1, 2}, {0, 2, 3}}) {
      mesh.face.push_back({base + f[0], base + f[1], base + f[2]});
      mesh.wedge_uv.push_back({uv[f[0]], uv[f[1]], uv[f[2]]});
    }
  }
  scene.mesh = std::move(mesh);
  scene.image = std::move(image);
  return scene;
}

/// A third of the surfels without area in uv, a third mirrored.
HardScene uv_degenerate(const Request& r) {
  HardScene scene = condition({1, r.seed});
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    if (i % 3 == 0) scene.cloud.dpdu[i] = i % 2 == 0 ? Vec3f(0, 0, 0) : scene.cloud.dpdv[i];
    if (i % 3 == 1) {
      scene.cloud.dpdu[i] *= -1;
      scene.cloud.uv[i].x() = -scene.cloud.uv[i].x();
    }
  }
  return scene;
}

/// Clumped discs in one group, too far from one another in between.
HardScene saturated(const Request& r) {
  HardScene scene = sheet_scene(Sheet{.side = 24, .jitter = 0.5, .seed = r.seed},
                                plain(Vec3f(0.6F, 0.6F, 0.6F)), orbit(2.6, 0));
  scene.cloud.group.assign(scene.cloud.size(), 0);
  return scene;
}

/// A rolling surface whose depth crosses many steps, its splats of colours of their own.
HardScene quantised(const Request& r) {
  HardScene scene =
      sheet_scene(Sheet{.side = 64, .seed = r.seed}, plain(Vec3f(0, 0, 0)), orbit(2.2, r.value));
  scene.cloud.group.assign(scene.cloud.size(), 0);
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    Vec3f& p = scene.cloud.position[i];
    p.z() = 0.1F * portable::sin(3 * p.x());
    scene.cloud.normal[i] = Vec3f(-0.3F * portable::cos(3 * p.x()), 0, 1).normalized();
    scene.cloud.color[i] = random_color(r.seed, i);
  }
  return scene;
}

HardScene offset(const Request& r) {
  HardScene scene{sphere(8000, 1), {}};
  scene.cloud.origin = r.value * Vec3d(1, -1, 1);
  scene.cloud.double_positions = true;
  scene.view = look(scene.cloud.origin + Vec3d(0, 0, 3.2), scene.cloud.origin);
  return scene;
}

HardScene scale(const Request& r) {
  return {sphere(8000, r.value), look(Vec3d(0, 0, 3.2 * r.value), Vec3d(0, 0, 0))};
}

/// Ellipses `value` times as long as wide, which tile a plane.
HardScene slivers(const Request& r) {
  HardScene scene = sheet_scene(Sheet{.side = 48, .seed = r.seed}, plain(Vec3f(0.5F, 0.5F, 0.5F)),
                                orbit(2.2, 75));
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    const double angle = std::numbers::pi * random_uniform(r.seed, i, 2);
    const float variance = scene.cloud.variance[i];
    scene.cloud.tangent.push_back(
        Vec3d(portable::cos(angle), portable::sin(angle), 0).cast<float>());
    scene.cloud.variance_u.push_back(static_cast<float>(variance * r.value));
    scene.cloud.variance_v.push_back(static_cast<float>(variance / r.value));
    scene.cloud.color[i] = random_color(r.seed, i);
  }
  scene.cloud.variance = {};
  return scene;
}

/// Checkered terrain; the view is the first of a path towards the target.
HardScene flicker(const Request& r) {
  HardScene scene;
  GenerateOptions options;
  options.count = 40000;
  options.seed = r.seed;
  scene.cloud = generate_surfels(procedural_scene("terrain", r.seed, "checker", r.value), options);
  scene.view = look(Vec3d(0.1, 1.3, 1.5), Vec3d(0, 0, 0), 40, Vec3d(0, 1, 0));
  scene.view.width = 96;
  scene.view.height = 72;
  return scene;
}

struct Maker {
  HardCase info;
  HardScene (*make)(const Request&);
};

const std::vector<Maker>& makers() {
  constexpr double kMost = 1e8;  // Surfels: more do not fit into memory.
  static const std::vector<Maker> all{
      {{"grazing", "checkered plane seen at NUMBER degrees to its normal", 80, 0, 90}, grazing},
      {{"slivers", "ellipses NUMBER times as long as wide, on a slant", 100, 1, 1e6}, slivers},
      {{"near-plane", "floor NUMBER units under the eye, passing below and behind it", 0.02, 1e-6,
        1},
       near_plane},
      {{"splat-size", "discs NUMBER pixels across", 10000, 1e-4, 1e6}, splat_size},
      {{"inside", "viewer in a closed room of radius 1, NUMBER units off its wall", 0.02, 1e-6, 1},
       inside},
      {{"coincident", "points of a sphere, a tenth of them NUMBER times", 20, 2, 1000}, coincident},
      {{"collinear", "points of a sphere and 200 on a line"}, collinear},
      {{"isolated", "points of a sphere and 20 alone"}, isolated},
      {{"not-finite", "points of a sphere, one in 20 with a coordinate of NaN or infinity"},
       not_finite},
      {{"few-points", "NUMBER points", 1, 0, 15}, few_points},
      {{"density", "points of a square, NUMBER times as dense on the left", 100, 1, 10000},
       density},
      {{"sheets", "red sheet before a green one, NUMBER disc radii apart", 1, 0.01, 100}, sheets},
      {{"thin-body", "the same, back to back", 0.1, 1e-4, 100}, thin_body},
      {{"intersecting", "transparent panes that cross at NUMBER degrees", 60, 1, 179},
       intersecting},
      {{"silhouette", "sphere of NUMBER surfels before nothing", 8000, 100, 1e7}, silhouette},
      {{"layers", "NUMBER transparent panes, surfels shuffled", 8, 1, 64}, layers},
      {{"layers-near-first", "the same, the nearest pane first", 8, 1, 64}, layers_near_first},
      {{"layers-far-first", "the same, the farthest pane first", 8, 1, 64}, layers_far_first},
      {{"condition", "plane for textures, kernels NUMBER spacings wide", 1, 0.05, 3}, condition},
      {{"duplicates", "the same of width 0.7, every surfel NUMBER times", 2, 2, 100}, duplicates},
      {{"seam",
        "white charts, black in between, on NUMBER texels a side (with a mesh and an image)", 64, 8,
        4096},
       seam},
      {{"uv-degenerate", "plane for textures, some surfels mirrored or without area in uv"},
       uv_degenerate},
      {{"saturated", "one group of discs at random places"}, saturated},
      {{"quantised", "rolling surface of one group, seen at NUMBER degrees", 60, 0, 85}, quantised},
      {{"offset", "sphere at NUMBER times (1, -1, 1)", 1e7, 0, kMost}, offset},
      {{"scale", "sphere of radius NUMBER", 1e6, 1e-6, 1e6}, scale},
      {{"flicker", "terrain with NUMBER checks across", 64, 1, 512}, flicker},
  };
  return all;
}

}  // namespace

const std::vector<HardCase>& hard_cases() {
  static const std::vector<HardCase> all = [] {
    std::vector<HardCase> infos;
    for (const Maker& maker : makers()) infos.push_back(maker.info);
    return infos;
  }();
  return all;
}

HardScene make_hard_case(const std::string& text, std::uint64_t seed) {
  const std::size_t colon = text.find(':');
  const std::string name = text.substr(0, colon);
  const auto found = std::find_if(makers().begin(), makers().end(),
                                  [&](const Maker& maker) { return maker.info.name == name; });
  if (found == makers().end()) {
    std::vector<std::string> names;
    for (const HardCase& info : hard_cases()) names.push_back(info.name);
    throw_usage(fmt::format("no case is called '{}'; there are {}{}", name, fmt::join(names, ", "),
                            did_you_mean(name, names)));
  }
  const HardCase& info = found->info;
  double value = info.value;
  if (colon != std::string::npos) {
    if (!info.has_value()) throw_usage(fmt::format("case {} takes no number", name));
    const std::string number = text.substr(colon + 1);
    const char* const end = number.data() + number.size();
    const auto [stop, error] = std::from_chars(number.data(), end, value);
    if (error != std::errc() || stop != end || !(value >= info.least && value <= info.most)) {
      throw_usage(fmt::format("case {} has the number '{}'; it must be {:g} to {:g}", name, number,
                              info.least, info.most));
    }
  }
  HardScene scene = found->make({value, seed});
  scene.cloud.color_encoding = ColorEncoding::kFloatLinear;
  return scene;
}

std::string view_options(const CameraOptions& view) {
  const auto vector = [](const Vec3d& v) { return fmt::format("{},{},{}", v.x(), v.y(), v.z()); };
  std::string text;
  if (view.eye) text += "--eye " + vector(*view.eye) + " ";
  if (view.target) text += "--target " + vector(*view.target) + " ";
  return text + fmt::format("--up {} --fov {} --size {}x{}", vector(view.up_or_y()), view.fov,
                            view.width, view.height);
}

}  // namespace surfel
