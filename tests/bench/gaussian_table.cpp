// The tables of docs/gaussians.md: what the shortcuts of trained renderers cost, on a file of
// trained splats.
//
// Usage: gaussian_table FILE.splat

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/gaussian/gaussian_extent.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/scene/framing.h>

namespace {

using namespace surfel;

struct Way {
  const char* name;
  GaussianProfile profile;
  double lowpass = GaussianOptions().lowpass;
  int samples = 1;
};
constexpr double kFine = 0.3162;  ///< The filter of Mip-Splatting.
const Way kWays[] = {{"inria", GaussianProfile::kInria},
                     {"gsplat", GaussianProfile::kGsplat},
                     {"mip", GaussianProfile::kMip},
                     {"2dgs", GaussianProfile::k2dgs},
                     {"exact", GaussianProfile::kExact},
                     {"exact --lowpass 0.316", GaussianProfile::kExact, kFine},
                     {"exact --samples 2", GaussianProfile::kExact, GaussianOptions().lowpass, 2},
                     {"exact --lowpass 0.316 --samples 2", GaussianProfile::kExact, kFine, 2}};

Image draw(const GaussianCloud& cloud, const Camera& camera, const Way& way) {
  return GaussianRenderer(cloud, {.profile = way.profile,
                                  .lowpass = way.lowpass,
                                  .samples = way.samples,
                                  .background = {1, 1, 1, 1},
                                  .display = true})
      .render(camera);
}

double psnr(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    if (i % 4 < 3) sum += std::pow(double{a.data[i]} - double{b.data[i]}, 2);
  }
  return -10 * std::log10(sum / (0.75 * static_cast<double>(a.data.size())));
}

/// Means of squares of pixels.
Image reduced(const Image& image, int by) {
  Image out = rgba_image(image.width / by, image.height / by);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      for (int c = 0; c < 4; ++c) {
        double sum = 0;
        for (int k = 0; k < by * by; ++k) sum += image.pixel(by * x + k % by, by * y + k / by)[c];
        out.pixel(x, y)[c] = static_cast<float>(sum / (by * by));
      }
    }
  }
  return out;
}

Camera smaller(Camera camera, int by) {
  camera.width /= by;
  camera.height /= by;
  for (double* value : {&camera.focal_x, &camera.focal_y, &camera.center_x, &camera.center_y}) {
    *value /= by;
  }
  return camera;
}

/// A picture beside the mean of its own profile's picture with 8 times as many pixels a side.
void minified(const GaussianCloud& cloud, const CameraOptions& view) {
  const Camera camera = make_camera(view, gaussian_extent(cloud));
  for (const int by : {2, 4, 8}) {
    fmt::print("minified {} times, PSNR to the mean of the large picture, dB:", by);
    for (const Way& way : kWays) {
      const Image truth = reduced(draw(cloud, camera, way), by);
      fmt::print(" {} {:.1f}", way.name, psnr(draw(cloud, smaller(camera, by), way), truth));
    }
    fmt::print("\n");
  }
}

/// Steps of a turn so small that nothing moves by more than a hundredth of a pixel, near the scene:
/// the most pixels that change at once by more than 8 steps of 8 bits.
void popping(const GaussianCloud& cloud, CameraOptions view) {
  view.zoom = 4;
  view.width = 512;
  view.height = 384;
  const std::vector<Camera> turn = turntable(view, gaussian_extent(cloud), 720000);
  fmt::print("near, a turn of 0.1 degrees in 200 steps, most pixels that change at once:");
  for (const Way& way : kWays) {
    std::size_t worst = 0;
    Image before = draw(cloud, turn[0], way);
    for (std::size_t i = 1; i <= 200; ++i) {
      Image now = draw(cloud, turn[i], way);
      std::size_t changed = 0;
      for (std::size_t k = 0; k < now.data.size(); k += 4) {
        float most = 0;
        for (std::size_t c = 0; c < 3; ++c) {
          most = std::max(most, std::abs(now.data[k + c] - before.data[k + c]));
        }
        if (most > 8.0F / 255) ++changed;
      }
      worst = std::max(worst, changed);
      before = std::move(now);
    }
    fmt::print(" {} {}", way.name, worst);
  }
  fmt::print("\n");
}

/// A round Gaussian far off the axis, so large that no filter matters.
void wide_angles() {
  for (const double angle : {20, 40, 60}) {
    const double radians = angle * 3.14159265358979 / 180;
    GaussianCloud cloud;
    cloud.position = {Vec3f(static_cast<float>(4 * std::sin(radians)), 0,
                            static_cast<float>(4 * std::cos(radians)))};
    cloud.scale = {Vec3f::Constant(0.4F)};
    cloud.rotation = {{1, 0, 0, 0}};
    cloud.amplitude = {0.9F};
    cloud.harmonics = {1.7F, 1.7F, 1.7F};
    Camera camera;
    camera.width = 1600;
    camera.height = 400;
    camera.focal_x = camera.focal_y = 300;
    camera.center_x = 800;
    camera.center_y = 200;
    fmt::print("a ball {} degrees off the axis, its alpha by the exact one's:", angle);
    const auto mass = [&](const Way& way) {
      const Image image =
          GaussianRenderer(cloud, {.profile = way.profile, .display = true}).render(camera);
      double sum = 0;
      for (std::size_t i = 3; i < image.data.size(); i += 4) sum += image.data[i];
      return sum;
    };
    const double exact = mass(kWays[4]);
    for (const Way& way : kWays) {
      if (way.profile == GaussianProfile::k2dgs) continue;
      fmt::print(" {} {:.3f}", way.name, mass(way) / exact);
    }
    fmt::print("\n");
  }
}

/// Round grey Gaussians about the origin, which a camera of 101 x 101 pixels looks at.
GaussianCloud round_gaussians(std::size_t count, double pixels, double opacity) {
  GaussianCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    // Apart in depth, so that none hides another's middle.
    const double z = 10 + 0.01 * static_cast<double>(i);
    cloud.position.emplace_back(0.0F, 0.0F, static_cast<float>(z));
    cloud.scale.push_back(Vec3f::Constant(static_cast<float>(pixels * z / 400)));
    cloud.rotation.push_back({1, 0, 0, 0});
    cloud.amplitude.push_back(static_cast<float>(opacity));
    cloud.harmonics.insert(cloud.harmonics.end(), 3, 1.772454F);  // White.
  }
  return cloud;
}
Camera middle_camera() {
  Camera camera;
  camera.width = camera.height = 101;
  camera.focal_x = camera.focal_y = 400;
  camera.center_x = camera.center_y = 50.5;
  return camera;
}

/// The picture over nothing, whose alpha tells what is covered.
Image draw_clear(const GaussianCloud& cloud, const Camera& camera, const Way& way) {
  return GaussianRenderer(cloud, {.profile = way.profile, .lowpass = way.lowpass, .display = true})
      .render(camera);
}
/// Variance of a profile's pixel filter.
double filter_of(const Way& way) {
  switch (way.profile) {
    case GaussianProfile::kMip:
      return 0.1;
    case GaussianProfile::k2dgs:
      return 0;
    case GaussianProfile::kExact:
    case GaussianProfile::kSurfel:
      return way.lowpass * way.lowpass;
    case GaussianProfile::kInria:
    case GaussianProfile::kGsplat:
      break;
  }
  return 0.3;
}
/// What the haze of haze() lets through, in the mean of the picture, without any filter.
double mean_haze(std::size_t count, double opacity) {
  double sum = 0;
  for (int y = 0; y < 101; ++y) {
    for (int x = 0; x < 101; ++x) {
      const double r2 = (x - 50) * (x - 50) + (y - 50) * (y - 50);
      const double alpha = opacity * std::exp(-0.5 * r2 / (12 * 12));
      sum += std::pow(1 - alpha, static_cast<double>(count));
    }
  }
  return sum / (101 * 101);
}

/// Across a faint Gaussian of 12 pixels: the largest step between two pixels beyond the step of the
/// Gaussian itself, in steps of 8 bits. Kernels that end early leave a ring.
void rings() {
  for (const double opacity : {1.0, 0.25}) {
    constexpr double kDeviation = 12;
    const GaussianCloud cloud = round_gaussians(1, kDeviation, opacity);
    fmt::print("a Gaussian of opacity {}, largest step off the truth's, of 255:", opacity);
    for (const Way& way : kWays) {
      const Image image = draw_clear(cloud, middle_camera(), way);
      // The filters of the renderers, and the truth with them.
      double worst = 0;
      const double variance = kDeviation * kDeviation + filter_of(way);
      const auto truth = [&](int x) {
        return opacity * std::exp(-0.5 * (x - 50) * (x - 50) / variance);
      };
      for (int x = 1; x < 101; ++x) {
        const double step = double{image.pixel(x, 50)[3]} - double{image.pixel(x - 1, 50)[3]};
        worst = std::max(worst, std::abs(step - (truth(x) - truth(x - 1))));
      }
      fmt::print(" {} {:.2f}", way.name, 255 * worst);
    }
    fmt::print("\n");
  }
}

/// Gaussians too faint to be blended one by one where the least alpha is 1/255: what is seen
/// through all of them, and in truth.
void haze() {
  constexpr std::size_t kCount = 1000;
  for (const double opacity : {0.01, 0.0035}) {
    const GaussianCloud cloud = round_gaussians(kCount, 12, opacity);
    fmt::print("{} Gaussians of opacity {}, transmittance of the middle (truth {:.4f}):", kCount,
               opacity, std::pow(1 - opacity, static_cast<double>(kCount)));
    for (const Way& way : kWays) {
      const Image image = draw_clear(cloud, middle_camera(), way);
      fmt::print(" {} {:.4f}", way.name, 1 - image.pixel(50, 50)[3]);
    }
    fmt::print("; mean of the picture's transmittances (truth {:.4f}):",
               mean_haze(kCount, opacity));
    for (const Way& way : kWays) {
      const Image image = draw_clear(cloud, middle_camera(), way);
      double sum = 0;
      for (std::size_t i = 3; i < image.data.size(); i += 4) sum += 1 - image.data[i];
      fmt::print(" {} {:.4f}", way.name, sum / (101 * 101));
    }
    fmt::print("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: gaussian_table FILE.splat\n");
    return 2;
  }
  const GaussianCloud cloud = read_gaussians(argv[1]);
  CameraOptions view;
  view.up = Vec3d(0, -1, 0);
  view.from = Vec3d(0.3, -0.4, -1);
  view.width = 1024;
  view.height = 768;
  minified(cloud, view);
  popping(cloud, view);
  wide_angles();
  rings();
  haze();
  return 0;
}
