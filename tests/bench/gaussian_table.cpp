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
};
constexpr double kFine = 0.3162;  ///< The filter of Mip-Splatting.
const Way kWays[] = {
    {"inria", GaussianProfile::kInria}, {"gsplat", GaussianProfile::kGsplat},
    {"mip", GaussianProfile::kMip},     {"2dgs", GaussianProfile::k2dgs},
    {"exact", GaussianProfile::kExact}, {"exact --lowpass 0.316", GaussianProfile::kExact, kFine}};

Image draw(const GaussianCloud& cloud, const Camera& camera, const Way& way) {
  return GaussianRenderer(cloud, {.profile = way.profile,
                                  .lowpass = way.lowpass,
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
  return 0;
}
