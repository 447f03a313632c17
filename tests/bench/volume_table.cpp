// The table and the pictures of docs/volumes.md: Gaussians of a phantom of a head against rays that
// are marched through it.
//
// Usage: volume_table FOLDER   (gets the pictures)

#include <array>
#include <cmath>
#include <string>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/base/timing.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/io/image_io.h>
#include <surfel/truth/volume_march.h>
#include <surfel/volume/gaussians_of_volume.h>

namespace {

using namespace surfel;

/// A head of 200 mm: skin, skull, brain with ventricles, eye sockets and a mouth, in Hounsfield
/// units, with the soft edges that scanners give, 0.75 voxels.
Volume head(std::size_t n) {
  Volume volume;
  volume.size = {n, n, n};
  const double edge = 200.0 / static_cast<double>(n);
  for (Vec3d& step : volume.step) step *= edge;
  volume.value.resize(volume.voxels());
  const double soft = 1.5 / static_cast<double>(n);
  const auto inside = [&](double distance) { return 1 / (1 + std::exp(distance / soft)); };
  const auto ellipsoid = [&](const Vec3d& p, double a, double b, double c, double scale) {
    return inside((Vec3d(p.x() / a, p.y() / b, p.z() / c).norm() - 1) * scale);
  };
  parallel_each(n, 1, [&](std::size_t z) {
    for (std::size_t y = 0; y < n; ++y) {
      for (std::size_t x = 0; x < n; ++x) {
        const Vec3d p =
            (Vec3d(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)) +
             Vec3d::Constant(0.5)) *
                (2 / static_cast<double>(n)) -
            Vec3d::Constant(1);
        double value = -1000;
        const auto put = [&](double share, double here) { value += (here - value) * share; };
        put(ellipsoid(p, 0.7, 0.85, 0.9, 0.7), 40);
        put(ellipsoid(p, 0.62, 0.77, 0.82, 0.7), 1100);
        put(ellipsoid(p, 0.56, 0.71, 0.76, 0.7), 35);
        for (const double side : {-0.25, 0.25}) {
          put(ellipsoid(p - Vec3d(side, -0.72, 0.1), 0.16, 0.16, 0.16, 0.16), 10);
          put(ellipsoid(p - Vec3d(0.8 * side, -0.1, 0.1), 0.12, 0.12, 0.17, 0.12), -5);
        }
        put(ellipsoid(p - Vec3d(0, -0.85, -0.2), 0.1, 0.2, 0.14, 0.14), -900);
        volume.value[volume.index(x, y, z)] = static_cast<float>(value);
      }
    }
  });
  return volume;
}

Camera camera_before(const Volume& volume, int side) {
  Camera view;
  view.width = view.height = side;
  view.focal_x = view.focal_y = 1.8 * side;
  view.center_x = view.center_y = side / 2.0;
  const Vec3d forward = Vec3d(0.4, 0.85, -0.3).normalized();
  const Vec3d right = forward.cross(Vec3d(0, 0, 1)).normalized();
  view.camera_from_world.row(0) = right;
  view.camera_from_world.row(1) = forward.cross(right);
  view.camera_from_world.row(2) = forward;
  view.eye = volume.world(Vec3d::Constant(static_cast<double>(volume.size[0]) / 2)) - 400 * forward;
  return view;
}

double psnr(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    sum += std::pow(double{a.data[i]} - double{b.data[i]}, 2);
  }
  return -10 * std::log10(sum / static_cast<double>(a.data.size()));
}

/// Writes a picture whose colours are as displays take them, over black.
void write(Image image, const std::string& file) {
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    image.data[i] = i % 4 == 3 ? 1 : srgb_to_linear(image.data[i]);
  }
  write_image(image, file);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "Usage: {} FOLDER\n", argv[0]);
    return 2;
  }
  fmt::print(
      "| voxels | transfer function | Gaussians | made in | picture | drawn in | PSNR to rays | "
      "one "
      "sample a pixel |\n|---|---|---|---|---|---|---|---|\n");
  for (const std::size_t n : {std::size_t{96}, std::size_t{256}}) {
    const Volume volume = head(n);
    for (const char* name : {"ct", "ct-bone"}) {
      const TransferFunction function = transfer_function(name);
      const Timer making;
      const GaussianCloud cloud = gaussians_of_volume(volume, function, name);
      const double made = making.milliseconds();
      for (const int side : {80, 240}) {
        const Camera camera = camera_before(volume, side);
        const Image truth = march_volume(volume, function, camera, {.rays = 6});
        GaussianOptions options{.display = true};
        GaussianFrameStatistics frame;
        const Image image = GaussianRenderer(cloud, options).render(camera, &frame);
        options.samples = 1;
        const Image plain = GaussianRenderer(cloud, options).render(camera);
        fmt::print(
            "| {0} x {0} x {0} | {1} | {2} | {3:.1f} s | {4} x {4} | {5:.2f} s | {6:.1f} dB "
            "| {7:.1f} dB |\n",
            n, name, cloud.size(), made / 1000, side, frame.milliseconds / 1000, psnr(image, truth),
            psnr(plain, truth));
        if (n == 256 && side == 240) {
          write(image, fmt::format("{}/{}-gaussians.png", argv[1], name));
          write(truth, fmt::format("{}/{}-rays.png", argv[1], name));
        }
      }
    }
  }
}
