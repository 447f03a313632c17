// A frame of ours and what it is measured against, on the same cloud and camera: Z, the one-pixel
// z-buffer loop over all points in space-filling order, and Embree's oriented discs (nearest hit,
// coherent packets of 16 rays, no blending), given to it in that order and, as a scan's points
// come, in random order: it sorts its hierarchy but not the discs. Prints one line a measure: name,
// threads, milliseconds, the best of --repeats, in turns for ours and Z; `covered` is the number of
// pixels with something in them.
//
// Run it with OMP_WAIT_POLICY=passive: else the loop's threads keep a core busy after their turn.
//
// Usage: render_peers CLOUD [--size WxH] [--threads N] [--repeats N] [--turntable N --view I]
//                     [--layers N] [--cull-back] [--unlit] [--no-embree] [--lod LEVELS]

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <omp.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>

#include "bench/z_buffer.h"
#include "tools/support/options.h"
#include "tools/support/tool.h"

#ifdef SURFEL_HAVE_EMBREE
#include <embree3/rtcore.h>
#endif

namespace {

using namespace surfel;

struct Settings {
  std::string cloud;
  std::string lod;
  CameraOptions camera;
  int threads = 0;
  int repeats = 15;
  int turntable = 0;
  int view = 0;
  RenderOptions render;
  bool embree = true;
};

/// Least times of `repeats` calls of each of several works in turns, in milliseconds; the first
/// ones, which touch the memory for the first time, do not count where there are more.
template <class... Work>
std::array<double, sizeof...(Work)> best_of(int repeats, Work&&... works) {
  std::array<double, sizeof...(Work)> best;
  best.fill(std::numeric_limits<double>::infinity());
  for (int i = 0; i < repeats; ++i) {
    std::size_t which = 0;
    const auto time = [&](auto& work) {
      const Timer timer;
      work();
      double& least = best[which++];
      if (i > 0 || repeats == 1) least = std::min(least, timer.milliseconds());
    };
    (time(works), ...);
  }
  return best;
}

void print(const std::string& name, int threads, double ms, const std::string& more) {
  fmt::print("{} threads {} ms {:.3f} {}\n", name, threads, ms, more);
  std::fflush(stdout);
}

float largest_variance(const SurfelCloud& cloud, std::size_t i) {
  if (cloud.anisotropic()) return std::max(cloud.variance_u[i], cloud.variance_v[i]);
  return cloud.variance.empty() ? 0 : cloud.variance[i];
}

void ours_and_z_buffer(const Settings& s, const SurfelCloud& cloud, RenderCloud& surfels,
                       const Camera& camera) {
  if (camera.orthographic) throw_usage("the z-buffer loop is for perspective cameras");
  Array<bench::ZPoint> points(cloud.size());
  const Array<Vec3f>* color = cloud.render_color();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f& p = cloud.position[i];
    std::uint32_t packed = 0x808080;
    if (color) {
      const Vec3f c = 255 * (*color)[i].cwiseMax(0).cwiseMin(1);
      packed = static_cast<std::uint32_t>(c.x()) << 16 | static_cast<std::uint32_t>(c.y()) << 8 |
               static_cast<std::uint32_t>(c.z());
    }
    points[i] = {p.x(), p.y(), p.z(), packed};
  }
  const Vec3d shift = camera.camera_from_world * (cloud.origin - camera.eye);
  bench::ZCamera c{};
  for (int i = 0; i < 4; ++i) {
    const auto at = [&](int row) { return i < 3 ? camera.camera_from_world(row, i) : shift[row]; };
    c.row_x[i] = static_cast<float>(camera.focal_x * at(0));
    c.row_y[i] = static_cast<float>(camera.focal_y * at(1));
    c.row_z[i] = static_cast<float>(at(2));
  }
  c.center_x = static_cast<float>(camera.center_x);
  c.center_y = static_cast<float>(camera.center_y);
  c.width = camera.width;
  c.height = camera.height;
  bench::ZBufferLoop loop(c, s.threads);
  const Scene scene;
  Renderer renderer(surfels, scene, s.render);
  Image image;
  const auto [ours, z] = best_of(
      s.repeats, [&] { image = renderer.render(camera); },
      [&] { loop.run(points.data(), points.size()); });
  std::size_t covered = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) covered += image.pixel(x, y)[3] > 0 ? 1 : 0;
  }
  print("surfelkit", s.threads, ours, fmt::format("covered {} Z {:.2f}", covered, ours / z));
  const auto& pixels = loop.pixels();
  print("z-buffer", s.threads, z,
        fmt::format("covered {}", pixels.size() - std::count(pixels.begin(), pixels.end(), 0U)));
}

#ifdef SURFEL_HAVE_EMBREE

struct Release {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
template <class Handle>
using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Release>;

Owned<RTCScene> disc_scene(RTCDevice device, const SurfelCloud& cloud) {
  Owned<RTCScene> scene(rtcNewScene(device));
  RTCGeometry discs = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_ORIENTED_DISC_POINT);
  auto* place = static_cast<float*>(rtcSetNewGeometryBuffer(
      discs, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 4 * sizeof(float), cloud.size()));
  auto* normal = static_cast<float*>(rtcSetNewGeometryBuffer(
      discs, RTC_BUFFER_TYPE_NORMAL, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), cloud.size()));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (int d = 0; d < 3; ++d) {
      place[4 * i + d] = cloud.position[i][d];
      normal[3 * i + d] = cloud.normal[i][d];
    }
    // The disc at cutoff 1: beta = r^2 / (2 V) < 1.
    place[4 * i + 3] = std::sqrt(2 * largest_variance(cloud, i));
  }
  rtcCommitGeometry(discs);
  rtcAttachGeometry(scene.get(), discs);
  rtcReleaseGeometry(discs);
  rtcCommitScene(scene.get());
  return scene;
}

/// The colour and the side of the nearest disc in each pixel; returns how many pixels have one.
std::size_t trace(RTCScene scene, const SurfelCloud& cloud, const Camera& camera, int samples,
                  int threads, std::vector<float>& picture) {
  const Eigen::Matrix3f world_from_camera = camera.camera_from_world.transpose().cast<float>();
  const Vec3f eye = (camera.eye - cloud.origin).cast<float>();
  const Array<Vec3f>* color = cloud.render_color();
  const Vec3f grey = SurfelCloud::colorless();
  std::size_t covered = 0;
  const int side = samples == 1 ? 1 : 2;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : covered)
  for (int y0 = 0; y0 < camera.height; y0 += 4) {
    for (int x0 = 0; x0 < camera.width; x0 += 4) {
      float sum[16][3] = {};
      unsigned hit = 0;
      for (int sample = 0; sample < samples; ++sample) {
        alignas(64) RTCRayHit16 rays;
        alignas(64) int valid[16];
        for (int k = 0; k < 16; ++k) {
          const int x = x0 + k % 4;
          const int y = y0 + k / 4;
          valid[k] = x < camera.width && y < camera.height ? -1 : 0;
          const auto u = static_cast<float>((x + (sample % side + 0.5) / side - camera.center_x) /
                                            camera.focal_x);
          const auto v = static_cast<float>((y + (sample / side + 0.5) / side - camera.center_y) /
                                            camera.focal_y);
          const Vec3f direction = world_from_camera * Vec3f(u, v, 1);
          rays.ray.org_x[k] = eye.x();
          rays.ray.org_y[k] = eye.y();
          rays.ray.org_z[k] = eye.z();
          rays.ray.dir_x[k] = direction.x();
          rays.ray.dir_y[k] = direction.y();
          rays.ray.dir_z[k] = direction.z();
          rays.ray.tnear[k] = 0;
          rays.ray.tfar[k] = std::numeric_limits<float>::infinity();
          rays.ray.time[k] = 0;
          rays.ray.mask[k] = ~0U;
          rays.ray.flags[k] = 0;
          rays.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
          rays.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
        }
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        rtcIntersect16(valid, scene, &context, &rays);
        for (int k = 0; k < 16; ++k) {
          if (valid[k] == 0 || rays.hit.geomID[k] == RTC_INVALID_GEOMETRY_ID) continue;
          hit |= 1U << k;
          const std::size_t i = rays.hit.primID[k];
          const Vec3f& c = color ? (*color)[i] : grey;
          const float side_on = std::abs(cloud.normal[i].dot(
              Vec3f(rays.ray.dir_x[k], rays.ray.dir_y[k], rays.ray.dir_z[k]).normalized()));
          for (int d = 0; d < 3; ++d) sum[k][d] += side_on * c[d] / static_cast<float>(samples);
        }
      }
      for (int k = 0; k < 16; ++k) {
        const int x = x0 + k % 4;
        const int y = y0 + k / 4;
        if (x >= camera.width || y >= camera.height) continue;
        covered += hit >> k & 1U;
        for (int d = 0; d < 3; ++d) {
          picture[3 * (static_cast<std::size_t>(y) * camera.width + x) + d] = sum[k][d];
        }
      }
    }
  }
  return covered;
}

/// \param name  of the measures: embree and the order of the discs.
void embree(const Settings& s, const std::string& name, const SurfelCloud& cloud,
            const Camera& camera) {
  if (cloud.normal.empty()) throw_input(s.cloud, "has no normals; Embree's discs need them");
  const Owned<RTCDevice> device(
      rtcNewDevice(fmt::format("threads={},hugepages=1", s.threads).c_str()));
  Owned<RTCScene> scene;
  const auto [build] = best_of(std::min(s.repeats, 3), [&] {
    scene.reset();
    scene = disc_scene(device.get(), cloud);
  });
  print(name + "-build", s.threads, build, "");
  std::vector<float> picture(std::size_t{3} * camera.width * camera.height);
  for (const int samples : {1, 4}) {
    std::size_t covered = 0;
    const auto [ms] = best_of(s.repeats, [&] {
      covered = trace(scene.get(), cloud, camera, samples, s.threads, picture);
    });
    print(fmt::format("{}-trace-{}spp", name, samples), s.threads, ms,
          fmt::format("covered {}", covered));
  }
}

#endif

void run(const Settings& s) {
  set_thread_count(s.threads);
  SurfelCloud cloud = read_cloud(s.cloud);
  Array<std::uint32_t> order = morton_order(cloud.position);
  std::erase_if(order, [&](std::uint32_t i) { return !cloud.position[i].allFinite(); });
  RenderCloud surfels = s.lod.empty()
                            ? RenderCloud(cloud)
                            : RenderCloud(read_cloud(s.lod, CloudReadOptions{.levels = true}),
                                          {.levels = true}, s.lod);
  if (!s.lod.empty() && surfels.tree().empty()) throw_input(s.lod, "has no levels of detail");
  const SceneExtent extent = surfels.extent();
  cloud = cloud.gathered(order);
  const Camera camera = s.turntable > 0 ? turntable(s.camera, extent, s.turntable).at(s.view)
                                        : make_camera(s.camera, extent);
  ours_and_z_buffer(s, cloud, surfels, camera);
#ifdef SURFEL_HAVE_EMBREE
  if (s.embree) {
    embree(s, "embree", cloud, camera);
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(), [](std::uint32_t a, std::uint32_t b) {
      return std::pair(random_bits(1, a), a) < std::pair(random_bits(1, b), b);
    });
    embree(s, "embree-random", cloud.gathered(order), camera);
  }
#endif
}

}  // namespace

int main(int argc, char** argv) {
  Settings s;
  tool::Tool bench(
      "render_peers",
      "A frame, and what it is measured against: the one-pixel z-buffer loop, Embree's discs");
  tool::CommandLine& app = bench.app();
  app.add_option("cloud", s.cloud, "Surfels (PLY)")->required();
  tool::add_size(app, "--size", s.camera.width, s.camera.height, "Size of the picture, pixels");
  app.add_option("--repeats", s.repeats, "Frames, of which the best counts")->range(1, 10000);
  app.add_option("--turntable", s.turntable, "Views around, as surfel-render's")->range(1, 100000);
  app.add_option("--view", s.view, "Which of them, from 0")->range(0, 99999);
  app.add_option("--layers", s.render.layers, "Fragments per pixel");
  app.add_flag("--cull-back", s.render.cull_back, "Leave out surfels that face away");
  app.add_flag("!--unlit", s.render.lit, "No shading");
  app.add_option("--lod", s.lod, "The same surfels with levels of detail, drawn instead of them");
  app.add_flag("!--no-embree", s.embree, "Z and ours alone");
  return bench.run(argc, argv, [&] {
    s.threads = thread_count();
    if (s.view >= std::max(s.turntable, 1)) throw_usage("--view must be below --turntable");
    run(s);
  });
}
