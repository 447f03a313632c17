// Prints tables of docs/texture.md. See tests/fits.sh, which calls it.

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>
#include <surfel/texture/texture_fit.h>

namespace {

using namespace surfel;

struct Fit {
  const char* name;  ///< As in the tables of tests/fits.sh.
  TextureFitKind kind;
  std::optional<GramRightSide> right_side{};
};
constexpr Fit kFits[] = {{"ewa", TextureFitKind::kEwa},
                         {"gram", TextureFitKind::kGram},
                         {"normalised", TextureFitKind::kGram, GramRightSide::kNormalised},
                         {"render", TextureFitKind::kRender}};

TextureFitOptions options_of(const Fit& fit) {
  TextureFitOptions options;
  options.kind = fit.kind;
  options.right_side = fit.right_side;
  return options;
}

/// A checker on the plane, of which the picture shows the middle.
struct View {
  std::string title;
  int side;            ///< Surfels along an edge of the plane; spacing h.
  double square;       ///< Of the checker, h.
  int texels;          ///< A spacing.
  double pixels;       ///< A spacing on screen.
  bool reconstructed;  ///< The truth is the texture that the image stands for, c_c, or the sharp
                       ///< checker. Below 5 pixels a spacing, the checker under the pixel filter.
  double margin = 6;   ///< Of the plane that the picture leaves out on every side, h.
};

/// The checker at a place in spacings from the plane's corner.
double checker(const View& view, const Vec2d& p) {
  const auto square = [&](double x) { return static_cast<int>(std::floor(x / view.square)); };
  return ((square(p.x()) + square(p.y())) & 1) != 0 ? 1 : 0;
}

Image checker_image(const View& view) {
  Image image;
  image.width = image.height = view.side * view.texels;
  image.channels = {"R", "G", "B"};
  image.data.resize(static_cast<std::size_t>(image.width) * image.height * 3);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const double value = checker(view, Vec2d(x + 0.5, y + 0.5) / view.texels);
      std::fill_n(image.pixel(x, y), 3, static_cast<float>(value));
    }
  }
  return image;
}

/// Orthographic, from above, without the plane's border.
Camera camera_above(const View& view) {
  const double h = 2.0 / view.side;
  CameraOptions options;
  options.eye = Vec3d(0, 0, 5);
  options.target = Vec3d(0, 0, 0);
  options.width = options.height =
      static_cast<int>(std::lround((view.side - 2 * view.margin) * view.pixels));
  options.ortho = options.width * h / view.pixels;
  return make_camera(options, SceneExtent{});
}

/// The checker under the pixel filter, a Gaussian of one pixel, truncated and normalised as the
/// renderer does: what surfels without extent and without number would show.
double filtered_checker(const View& view, const Vec2d& p, double cutoff) {
  constexpr int kSteps = 24;  ///< From the centre to the filter's end.
  const double reach = std::sqrt(2 * cutoff);
  double sum = 0;
  double weight = 0;
  for (int j = -kSteps; j < kSteps; ++j) {
    for (int i = -kSteps; i < kSteps; ++i) {
      const Vec2d d = Vec2d(i + 0.5, j + 0.5) * (reach / kSteps);
      const double beta = d.squaredNorm() / 2;
      if (beta >= cutoff) continue;
      sum += std::exp(-beta) * checker(view, p + d / view.pixels);
      weight += std::exp(-beta);
    }
  }
  return sum / weight;
}

/// What the camera ought to see, one value a pixel.
std::vector<double> truth_of(const View& view, const Camera& camera, const TextureMap& map,
                             double cutoff) {
  const double h = 2.0 / view.side;
  std::vector<double> truth;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      // The plane is [-1, 1]^2, uv [0, 1]^2; image rows run downwards.
      const Vec2d on_plane =
          Vec2d(x + 0.5 - camera.center_x, y + 0.5 - camera.center_y) / camera.focal_x;
      const Vec2d p = (on_plane + Vec2d(1, 1)) / h;
      if (view.pixels <= 4) {
        truth.push_back(filtered_checker(view, p, cutoff));
      } else if (view.reconstructed) {
        truth.push_back(map.sample({p * view.texels, Eigen::Matrix2d::Identity()}).color.x());
      } else {
        truth.push_back(checker(view, p));
      }
    }
  }
  return truth;
}

double psnr(const Image& picture, const std::vector<double>& truth) {
  double sum = 0;
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const double error = static_cast<double>(picture.pixel(x, y)[0]) -
                           truth[static_cast<std::size_t>(y) * picture.width + x];
      sum += error * error;
    }
  }
  return -10 * std::log10(sum / static_cast<double>(truth.size()));
}

/// PSNR of the surfels as the camera sees them.
double rendered_psnr(const SurfelCloud& cloud, const Camera& camera, double cutoff,
                     const std::vector<double>& truth) {
  RenderOptions options;
  options.lit = false;
  options.cutoff = cutoff;
  RenderCloud surfels(cloud);
  const Scene scene;
  return psnr(Renderer(surfels, scene, options).render(camera), truth);
}

SurfelCloud plane_cloud(int side, double kappa) {
  GenerateOptions generate;
  generate.count = static_cast<std::size_t>(side) * side;
  generate.variance_scale = kappa;
  return generate_surfels(procedural_scene("plane", 1), generate);
}

void quality(const View& view) {
  fmt::print("\n{}\n\n| c | sigma/h |", view.title);
  for (const Fit& fit : kFits) fmt::print(" {} |", fit.name);
  fmt::print("\n|---|---|---|---|---|---|\n");
  TextureSet textures;
  textures.maps.emplace_back(checker_image(view), WrapMode::kRepeat);
  const Camera camera = camera_above(view);
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    const std::vector<double> truth = truth_of(view, camera, textures.maps[0], cutoff);
    for (const double kappa : {0.5, 0.6, 0.7, 0.85, 1.0}) {
      SurfelCloud cloud = plane_cloud(view.side, kappa);
      std::string row = fmt::format("| {:g} | {:g} |", cutoff, kappa);
      for (const Fit& fit : kFits) {
        TextureFitOptions options = options_of(fit);
        options.cutoff = cutoff;
        fit_texture(cloud, textures, options);
        row += fmt::format(" {:.2f} |", rendered_psnr(cloud, camera, cutoff, truth));
      }
      fmt::print("{}\n", row);
      std::fflush(stdout);
    }
  }
}

/// Root mean square of sum_i c_i n_i - sum_k w_k r_k, what SS01 (10) integrates, over the plane
/// without a border of 5 h. The kernels are round.
double plain_sum_error(const View& view, const SurfelCloud& cloud, const TextureMap& map) {
  const double h = 2.0 / view.side;
  const int points = static_cast<int>((view.side - 10) * 6);
  double sum = 0;
  for (int y = 0; y < points; ++y) {
    for (int x = 0; x < points; ++x) {
      const Vec2d p(5 + (x + 0.5) / 6, 5 + (y + 0.5) / 6);  // h from the plane's corner.
      const Vec2d place = p * h - Vec2d(1, 1);
      double error =
          -map.sample({map.texel((p / view.side).cast<float>()), Mat2d::Identity()}).color.x();
      for (std::size_t k = 0; k < cloud.size(); ++k) {
        const auto v = static_cast<double>(cloud.variance[k]);
        const double d2 = (cloud.position[k].head<2>().cast<double>() - place).squaredNorm();
        error += static_cast<double>(cloud.coefficient[k].x() * cloud.area[k]) *
                 std::exp(-d2 / (2 * v)) / (2 * M_PI * v);
      }
      sum += error * error;
    }
  }
  return std::sqrt(sum) / points;
}

/// Both right sides in the plain sum, and as they are rendered.
void right_sides() {
  const View view{"", 20, 4, 2, 12, true, 5};
  fmt::print(
      "## The two right sides of gram\n\n{0} x {0} surfels of a plane, squares of {1:g} h, two "
      "texels a spacing. Error of the plain sum: root mean square of the texture less the sum of "
      "all kernels, what SS01 (10)\nintegrates, without a border of 5 h. The picture: PSNR in dB "
      "as "
      "above, magnified.\n\n| sigma/h | fit | plain sum |",
      view.side, view.square);
  constexpr double kCutoffs[] = {1, 2, 4};
  for (const double cutoff : kCutoffs) fmt::print(" c = {:g} |", cutoff);
  fmt::print("\n|---|---|---|---|---|---|\n");
  TextureSet textures;
  textures.maps.emplace_back(checker_image(view), WrapMode::kRepeat);
  const Camera camera = camera_above(view);
  for (const double kappa : {0.5, 0.7, 0.85, 1.0}) {
    for (const Fit& fit : kFits) {
      if (fit.kind != TextureFitKind::kGram) continue;
      SurfelCloud cloud = plane_cloud(view.side, kappa);
      fit_texture(cloud, textures, options_of(fit));
      std::string row = fmt::format("| {:g} | {} | {:.4f} |", kappa, fit.name,
                                    plain_sum_error(view, cloud, textures.maps[0]));
      for (const double cutoff : kCutoffs) {
        const std::vector<double> truth = truth_of(view, camera, textures.maps[0], cutoff);
        row += fmt::format(" {:.2f} |", rendered_psnr(cloud, camera, cutoff, truth));
      }
      fmt::print("{}\n", row);
    }
  }
}

void qualities() {
  fmt::print(
      "## Checkers on a plane\n\nPSNR in dB of linear values, not clamped, against the texture on "
      "the plane. h: spacing of the jittered grid; c: cutoff of the fit and of the renderer\n"
      "(h_s = 1 pixel). The picture shows the plane from above, without its border. Minified, the "
      "truth is the checker under the renderer's own pixel filter.\n");
  quality(
      {"Magnified, 12 pixels a spacing. Squares of 5 h, a texel a spacing; the truth is the "
       "reconstructed texture c_c:",
       50, 5, 1, 12, true});
  quality({"Magnified, 12 pixels a spacing. Squares of 7 h; the truth is the sharp checker:", 56, 7,
           16, 12, false});
  quality({"One pixel a spacing, squares of 4.3 h:", 60, 4.3, 10, 1, false});
  quality({"Minified, two spacings a pixel, squares of 4.3 h:", 80, 4.3, 10, 0.5, false});
  quality(
      {"Minified, four spacings a pixel, squares of 2.2 h (two a pixel), little more than "
       "surfels can hold:",
       160, 2.2, 10, 0.25, false});
  quality(
      {"Minified, two spacings a pixel, squares of 1.1 h (two a pixel), less than surfels can "
       "hold:",
       80, 1.1, 10, 0.5, false});
}

/// Checkers of several sizes, seen from afar and from near: what render gains and loses.
void views() {
  constexpr int kSide = 120;
  constexpr double kPixels[] = {0.1, 0.3, 1, 4};
  constexpr double kShown = 80;  ///< Pixels, if the plane is large enough.
  fmt::print(
      "## From afar and from near\n\nPSNR of ewa, and by how much render's is higher, at pixels a "
      "spacing; the truth is the checker under the renderer's pixel filter.\n\n"
      "| square | c | sigma/h |");
  for (const double pixels : kPixels) fmt::print(" {:g} |", pixels);
  fmt::print("\n|---|---|---|---|---|---|---|\n");
  for (const double square : {1.1, 1.6, 2.2, 4.3, 7.0}) {
    View view{"", kSide, square, 12, 1, false};
    TextureSet textures;
    textures.maps.emplace_back(checker_image(view), WrapMode::kRepeat);
    for (const double cutoff : {1.0, 2.0}) {
      std::vector<Camera> cameras;
      std::vector<std::vector<double>> truths;
      for (const double pixels : kPixels) {
        view.pixels = pixels;
        view.margin = std::max(8.0, (kSide - kShown / pixels) / 2);
        cameras.push_back(camera_above(view));
        truths.push_back(truth_of(view, cameras.back(), textures.maps[0], cutoff));
      }
      for (const double kappa : {0.7, 1.0}) {
        SurfelCloud cloud = plane_cloud(kSide, kappa);
        TextureFitOptions fit;
        fit.cutoff = cutoff;
        fit.kind = TextureFitKind::kRender;
        SurfelCloud fitted = cloud;
        fit_texture(fitted, textures, fit);
        fit.kind = TextureFitKind::kEwa;
        fit_texture(cloud, textures, fit);
        std::string row = fmt::format("| {:g} | {:g} | {:g} |", square, cutoff, kappa);
        for (std::size_t i = 0; i < cameras.size(); ++i) {
          const double ewa = rendered_psnr(cloud, cameras[i], cutoff, truths[i]);
          const double render = rendered_psnr(fitted, cameras[i], cutoff, truths[i]);
          row += fmt::format(" {:.1f} {:+.2f} |", ewa, render - ewa);
        }
        fmt::print("{}\n", row);
        std::fflush(stdout);
      }
    }
  }
}

/// A cloud that asks for trouble.
struct Trouble {
  std::string name;
  SurfelCloud cloud;
  bool one_texel = false;  ///< The texture, instead of a checker of 5 h.
  bool flat = true;        ///< It still is the plane, of which a picture can be compared.
};

constexpr int kTroubleSide = 50;

/// The surfels `picked`, in their order.
SurfelCloud pick(const SurfelCloud& all, const std::vector<std::size_t>& picked) {
  SurfelCloud cloud;
  cloud.origin = all.origin;
  const auto copy = [&](const auto& from, auto& to) {
    if (from.empty()) return;
    for (const std::size_t k : picked) to.push_back(from[k]);
  };
  copy(all.position, cloud.position);
  copy(all.normal, cloud.normal);
  copy(all.variance, cloud.variance);
  copy(all.area, cloud.area);
  copy(all.uv, cloud.uv);
  copy(all.dpdu, cloud.dpdu);
  copy(all.dpdv, cloud.dpdv);
  return cloud;
}

SurfelCloud twice(const SurfelCloud& cloud) {
  std::vector<std::size_t> all(2 * cloud.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i % cloud.size();
  return pick(cloud, all);
}

std::vector<Trouble> troubles() {
  std::vector<Trouble> list;
  for (const double kappa : {0.3, 0.5, 0.7, 1.0, 1.2, 1.5}) {
    list.push_back({fmt::format("sigma = {:g} h", kappa), plane_cloud(kTroubleSide, kappa)});
  }
  const SurfelCloud plane = plane_cloud(kTroubleSide, 0.7);
  list.push_back({"every surfel twice", twice(plane)});
  const auto sheets = [&](const std::string& name, float side) {
    SurfelCloud cloud = twice(plane);
    for (std::size_t i = plane.size(); i < cloud.size(); ++i) {
      cloud.position[i].z() -= 0.01F * 2 / kTroubleSide;
      cloud.normal[i] *= side;
    }
    list.push_back({name, std::move(cloud)});
  };
  sheets("sheets 0.01 h apart, back to back", -1);
  sheets("sheets 0.01 h apart, facing alike", 1);
  list.push_back({"one surfel", pick(plane, {kTroubleSide * kTroubleSide / 2}), false, false});
  list.push_back({"texture of one texel", plane, true});
  SurfelCloud outside = plane;
  for (Vec2f& uv : outside.uv) uv += Vec2f(-3, 1000);
  list.push_back({"uv outside [0, 1]", std::move(outside)});
  SurfelCloud nan = plane;
  for (std::size_t i = 0; i < nan.size(); i += 10) {
    nan.uv[i].x() = std::numeric_limits<float>::quiet_NaN();
  }
  list.push_back({"uv of every tenth surfel NaN", std::move(nan)});
  return list;
}

void stability() {
  fmt::print(
      "## Where fits may fail\n\n{0} x {0} surfels of a plane with squares of 5 h, as above "
      "(magnified, reconstructed truth), sigma = 0.7 h unless it says otherwise, c = 1.\nThe range "
      "is that of the coefficients (the texture's is 0 to 1); cond is the condition as it is "
      "solved, "
      "lambda included; lambda is relative to the mean\ndiagonal.\n\n"
      "| case | fit | range | cond | lambda | unusual | iterations | PSNR |\n"
      "|---|---|---|---|---|---|---|---|\n",
      kTroubleSide);
  const View view{"", kTroubleSide, 5, 1, 12, true};
  const Camera camera = camera_above(view);
  for (Trouble& trouble : troubles()) {
    TextureSet textures;
    if (trouble.one_texel) {
      textures.maps.push_back(TextureMap::constant({0.2F, 0.2F, 0.2F}));
    } else {
      textures.maps.emplace_back(checker_image(view), WrapMode::kRepeat);
    }
    std::vector<double> truth = truth_of(view, camera, textures.maps[0], 1);
    if (trouble.one_texel) std::fill(truth.begin(), truth.end(), 0.2);
    for (const Fit& fit : kFits) {
      const TextureFitReport report = fit_texture(trouble.cloud, textures, options_of(fit));
      std::size_t not_finite = 0;
      for (const Vec3f& w : trouble.cloud.coefficient) not_finite += w.allFinite() ? 0 : 1;
      std::string unusual;
      if (report.without_uv > 0) unusual += fmt::format("{} without uv ", report.without_uv);
      if (not_finite > 0) unusual += fmt::format("{} NOT FINITE ", not_finite);
      std::string system = "| | |";
      std::string iterations = "|";
      if (report.system) {
        if (report.system->uncovered > 0) {
          unusual += fmt::format("{} points uncovered ", report.system->uncovered);
        }
        if (!report.system->converged) unusual += "not converged ";
        system =
            fmt::format("| {:.1e} | {:.1e} |", report.system->condition(), report.system->lambda);
        iterations = fmt::format("| {}", report.system->iterations);
      }
      std::string quality;
      if (trouble.flat) {
        quality =
            fmt::format("{:.1f}", std::min(99.9, rendered_psnr(trouble.cloud, camera, 1, truth)));
      }
      fmt::print("| {} | {} | {:.2f} .. {:.2f} {} {} {} | {} |\n", trouble.name, fit.name,
                 report.coefficient_min.x(), report.coefficient_max.x(), system, unusual,
                 iterations, quality);
    }
    std::fflush(stdout);
  }
}

}  // namespace

/// Arguments: quality, right_sides, stability, views; all if there are none.
int main(int argc, char** argv) {
  const std::vector<std::string> tables(argv + 1, argv + argc);
  const auto wanted = [&](const std::string& table) {
    return tables.empty() || std::find(tables.begin(), tables.end(), table) != tables.end();
  };
  if (wanted("quality")) qualities();
  if (wanted("right_sides")) right_sides();
  if (wanted("stability")) stability();
  if (wanted("views")) views();
}
