// Filtered lookups in an environment map beside OpenImageIO's TextureSystem::environment(): a row
// of docs/methods.md for each width; tests/methods.sh calls it.
// Usage: environment_table MAP (lat-long, EXR or HDR)

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

#include <OpenImageIO/Imath.h>
#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/texture.h>
#include <fmt/format.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/base/timing.h>
#include <surfel/io/image_io.h>
#include <surfel/render/environment_map.h>
#include <surfel/scene/lat_long.h>
#include <unistd.h>

namespace surfel {
namespace {

constexpr int kDirections = 200;
constexpr int kTimed = 200000;

Vec3f direction(std::uint64_t i) {
  const double y = 2 * random_uniform(3, i, 0) - 1;
  const double phi = 2 * M_PI * random_uniform(3, i, 1);
  const double r = std::sqrt(1 - y * y);
  return Vec3d(r * std::cos(phi), y, r * std::sin(phi)).cast<float>();
}

/// The lobe of mean cosine exp(-variance), summed over all texels in double.
Vec3d truth(const Image& image, const Vec3f& toward, double variance) {
  // coth k - 1 / k = exp(-variance), where k is not small.
  double k = 1 / -std::expm1(-variance);
  for (int i = 0; i < 50; ++i) k = 1 / (1 / std::tanh(k) - std::exp(-variance));
  Vec3d sum(0, 0, 0);
  double total = 0;
  for (int y = 0; y < image.height; ++y) {
    const double solid_angle = std::sin(M_PI * (y + 0.5) / image.height);
    for (int x = 0; x < image.width; ++x) {
      const Vec3d d = lat_long_direction((x + 0.5) / image.width, (y + 0.5) / image.height);
      const double w = solid_angle * std::exp(k * (d.dot(toward.cast<double>()) - 1));
      sum += w * Eigen::Map<const Vec3f>(image.pixel(x, y)).cast<double>();
      total += w;
    }
  }
  return sum / total;
}

/// OpenImageIO's lookup; `width` is that of its filter along each axis, radians.
struct Peer {
  OIIO::TextureSystem* system = OIIO::TextureSystem::create(false);
  OIIO::ustring file;
  OIIO::TextureOpt options;

  ~Peer() { OIIO::TextureSystem::destroy(system); }
  Vec3f radiance(const Vec3f& d, float width) {
    const Vec3f a = width * d.unitOrthogonal();
    const Vec3f b = d.cross(a);
    Vec3f out(0, 0, 0);
    const auto imath = [](const Vec3f& v) { return Imath::V3f(v.x(), v.y(), v.z()); };
    if (!system->environment(file, options, imath(d), imath(a), imath(b), 3, out.data())) {
      fmt::print(stderr, "{}\n", system->geterror());
      std::exit(1);
    }
    return out;
  }
};

/// Root mean square of the relative errors.
template <class Lookup>
double error_of(const std::vector<Vec3d>& expected, Lookup&& lookup) {
  double sum = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    sum += (lookup(direction(i)).template cast<double>() - expected[i]).squaredNorm() /
           expected[i].squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(expected.size()));
}

template <class Lookup>
double nanoseconds(Lookup&& lookup) {
  double best = 1e9;
  for (int repeat = 0; repeat < 5; ++repeat) {
    Vec3f sum(0, 0, 0);
    const Timer timer;
    for (std::uint64_t i = 0; i < kTimed; ++i) sum += lookup(direction(i % 1024));
    best = std::min(best, timer.milliseconds() * 1e6 / kTimed);
    if (!sum.allFinite()) std::exit(1);
  }
  return best;
}

int run(const std::string& path) {
  const Image image = read_image(path);
  Timer timer;
  const EnvironmentMap map(image, path);
  const double made = timer.milliseconds();

  const std::string tiled = std::filesystem::temp_directory_path() /
                            fmt::format("environment_table.{}.tx", static_cast<long>(getpid()));
  timer.restart();
  if (!OIIO::ImageBufAlgo::make_texture(OIIO::ImageBufAlgo::MakeTxEnvLatl, OIIO::ImageBuf(path),
                                        tiled, OIIO::ImageSpec())) {
    fmt::print(stderr, "{}\n", OIIO::geterror());
    return 1;
  }
  const double peer_made = timer.milliseconds();
  Peer peer;
  peer.file = OIIO::ustring(tiled);

  fmt::print("| standard deviation | ours: error | time | OpenImageIO: error | time | filter |\n");
  fmt::print("|---|---|---|---|---|---|\n");
  // Of the directions alone, which both loops make.
  const double overhead = nanoseconds([](const Vec3f& d) { return d; });
  for (const double degrees : {0.5, 2.0, 8.0, 30.0}) {
    const double sigma = degrees * M_PI / 180;
    const auto variance = static_cast<float>(sigma * sigma);
    std::vector<Vec3d> expected(kDirections);
    parallel_for(kDirections, 1, [&](std::size_t i, std::size_t, int) {
      expected[i] = truth(image, direction(i), sigma * sigma);
    });
    const auto ours = [&](const Vec3f& d) { return map.radiance(d, variance); };
    // What OpenImageIO calls a width is not said: the one that suits it best.
    double best = 1e9;
    double best_scale = 0;
    for (double scale = 0.5; scale < 5; scale *= 1.19) {
      const auto width = static_cast<float>(scale * sigma);
      const double error =
          error_of(expected, [&](const Vec3f& d) { return peer.radiance(d, width); });
      if (error < best) {
        best = error;
        best_scale = scale;
      }
    }
    const auto width = static_cast<float>(best_scale * sigma);
    const auto theirs = [&](const Vec3f& d) { return peer.radiance(d, width); };
    fmt::print("| {} degrees | {:.2g} % | {:.0f} ns | {:.2g} % | {:.0f} ns | {:.1f} deviations |\n",
               degrees, 100 * error_of(expected, ours), nanoseconds(ours) - overhead, 100 * best,
               nanoseconds(theirs) - overhead, best_scale);
  }
  fmt::print("\nMade from the {}x{} picture in {:.0f} ms, OpenImageIO's tiled file in {:.0f} ms.\n",
             image.width, image.height, made, peer_made);
  std::filesystem::remove(tiled);
  return 0;
}

}  // namespace
}  // namespace surfel

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: environment_table MAP\n");
    return 2;
  }
  return surfel::run(argv[1]);
}
