// Rendering with groups (SP06), and depth peeling.

#include <algorithm>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/sp06/coverage.h>
#include <surfel/sp06/grouping.h>
#include <surfel/sp06/methods.h>

#include "render/environments.h"
#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr double kOneInByte = 1 / 255.0;
constexpr Method kMethods[] = {Method::kABuffer,         Method::kDeferred,  Method::kTransparent,
                               Method::kTransparentHigh, Method::kDepthPeel, Method::kTwoPass};
constexpr Method kGroupMethods[] = {Method::kDeferred, Method::kTransparent,
                                    Method::kTransparentHigh};

bool has_aovs(Method method) {
  return method != Method::kTransparent && method != Method::kTransparentHigh;
}

/// The method draws opaque surfaces alone.
bool is_for_opaque(Method method) {
  return method == Method::kDeferred || method == Method::kTwoPass;
}

/// The unlit picture, with AOVs where the method makes them.
Image render_by(Method method, const SurfelCloud& cloud, const Camera& camera,
                RenderOptions options = {}, FrameStatistics* statistics = nullptr,
                const MethodOptions& method_options = {}) {
  options.method = compositing_method(method, method_options);
  options.lit = false;
  options.aovs = has_aovs(method);
  RenderCloud surfels(cloud, columns_of(method));
  const Scene scene;
  Renderer renderer(surfels, scene, options);
  return renderer.render(camera, statistics);
}

/// The cloud with groups, no two splats of which come nearer than overlap (r_i + r_j).
SurfelCloud grouped(SurfelCloud cloud, double overlap = 1) {
  GroupingOptions options;
  options.overlap.overlap = overlap;
  group_splats(cloud, options);
  return cloud;
}

/// The cloud in `groups` groups whose discs, enlarged by as much as a jittered grid of spacing h
/// can ask for, cover it each.
SurfelCloud covered(SurfelCloud cloud, int groups) {
  GroupingOptions options;
  options.groups = groups;
  group_splats(cloud, options);
  for (const float variance : cloud.variance) {
    cloud.group_radius.push_back(1.8F * std::sqrt(static_cast<float>(groups) * variance));
  }
  return cloud;
}

SurfelCloud with_alpha(SurfelCloud cloud, float alpha) {
  cloud.alpha.assign(cloud.size(), alpha);
  return cloud;
}

SurfelCloud joined(SurfelCloud a, const SurfelCloud& b) {
  a.position.insert(a.position.end(), b.position.begin(), b.position.end());
  a.normal.insert(a.normal.end(), b.normal.begin(), b.normal.end());
  a.variance.insert(a.variance.end(), b.variance.begin(), b.variance.end());
  a.area.insert(a.area.end(), b.area.begin(), b.area.end());
  a.coefficient.insert(a.coefficient.end(), b.coefficient.begin(), b.coefficient.end());
  a.alpha.insert(a.alpha.end(), b.alpha.begin(), b.alpha.end());
  return a;
}

SurfelCloud colored_sphere(int n, double radius) {
  SurfelCloud sphere = fibonacci_sphere(n, radius);
  for (std::size_t i = 0; i < sphere.size(); ++i) {
    sphere.coefficient[i] =
        Vec3d(random_uniform(3, i, 0), random_uniform(3, i, 1), 0.5).cast<float>();
  }
  return sphere;
}

/// Of R G B A, dB, `margin` pixels inside the border.
double psnr(const Image& a, const Image& b, int margin = 0) {
  double sum = 0;
  std::size_t count = 0;
  for (int y = margin; y < a.height - margin; ++y) {
    for (int x = margin; x < a.width - margin; ++x) {
      for (int c = 0; c < 4; ++c, ++count) {
        sum += std::pow(static_cast<double>(a.pixel(x, y)[c]) - b.pixel(x, y)[c], 2);
      }
    }
  }
  return -10 * std::log10(sum / static_cast<double>(count));
}

double largest_difference(const Image& a, const Image& b) {
  double worst = a.channels == b.channels ? 0 : std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < std::min(a.data.size(), b.data.size()); ++i) {
    if (a.data[i] == b.data[i]) continue;  // Infinities.
    worst = std::max(worst, std::abs(static_cast<double>(a.data[i]) - b.data[i]));
  }
  return worst;
}

SurfelCloud shuffled(const SurfelCloud& cloud) {
  Array<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  for (std::size_t i = order.size(); i-- > 1;) {
    std::swap(order[i],
              order[static_cast<std::size_t>(random_uniform(9, i) * static_cast<double>(i + 1))]);
  }
  return cloud.gathered(order);
}

TEST(Methods, SingleSplatEqualsTheABuffer) {
  for (const Kernel kernel : {Kernel::kAffine, Kernel::kPerspective}) {
    for (const Vec3f& normal : {Vec3f(0, 0, 1), Vec3f(1.5F, 0.7F, 1), Vec3f(0.2F, 0.3F, -1)}) {
      SurfelCloud cloud;
      add_surfel(cloud, {0.1F, -0.05F, 0}, normal.normalized(), 0.04F, 0.04F, {0.8F, 0.3F, 0.1F});
      cloud.group.push_back(7);
      RenderOptions options;
      options.kernel = kernel;
      const Camera camera = camera_at(2, 72);
      const Image expected = render_by(Method::kABuffer, cloud, camera, options);
      for (const Method method : {Method::kDeferred, Method::kDepthPeel, Method::kTwoPass}) {
        EXPECT_LT(largest_difference(render_by(method, cloud, camera, options), expected), 1e-6);
      }
    }
  }
}

TEST(Methods, DeferredOfValidGroupsEqualsTheABuffer) {
  // No two splats of a group share a pixel of a surface, so that nothing but rounding is lost.
  const SurfelCloud plane = grouped(jittered_plane(40, 1, 0.3));
  const Camera camera = camera_at(2.2, 160);
  for (const double cutoff : {1.0, 2.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    SurfelCloud discs = plane;
    GroupingOptions grouping;
    grouping.overlap.cutoff = cutoff;
    group_splats(discs, grouping);
    // The pixel filter makes splats larger than the discs that the groups keep apart.
    options.lowpass = 0.1;
    EXPECT_GT(psnr(render_by(Method::kDeferred, discs, camera, options),
                   render_by(Method::kABuffer, discs, camera, options)),
              60)
        << cutoff;
  }
  const SurfelCloud sphere = grouped(colored_sphere(2500, 0.8));
  EXPECT_GT(psnr(render_by(Method::kDeferred, sphere, camera),
                 render_by(Method::kABuffer, sphere, camera)),
            38);
}

TEST(Methods, TwoPassFollowsTheABuffer) {
  const SurfelCloud sphere = colored_sphere(2500, 0.8);
  const Camera camera = camera_at(2.2, 160);
  EXPECT_GT(psnr(render_by(Method::kTwoPass, sphere, camera),
                 render_by(Method::kABuffer, sphere, camera)),
            38);
}

TEST(Methods, PassesAndFragmentsAreCounted) {
  SurfelCloud cloud;
  add_surfel(cloud, {0.1F, -0.05F, 0}, {0, 0, 1}, 0.02F, 0.02F, {0.8F, 0.3F, 0.1F});
  cloud.group.push_back(0);
  cloud.group_radius.push_back(0.2F);
  const Camera camera = camera_at(2, 64);
  RenderOptions options;
  options.kernel = Kernel::kAffine;
  const EwaKernel kernel = *make_ewa_kernel(in_camera(cloud, 0, camera), camera, 1);
  std::uint64_t pixels = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) pixels += kernel.beta({x + 0.5, y + 0.5}) < 1 ? 1 : 0;
  }
  // Depth peeling finds a layer in three passes, and in the fourth that there is none behind it.
  for (const auto& [method, passes] :
       {std::pair(Method::kABuffer, 1), std::pair(Method::kDeferred, 1),
        std::pair(Method::kTwoPass, 2), std::pair(Method::kDepthPeel, 4)}) {
    FrameStatistics statistics;
    render_by(method, cloud, camera, options, &statistics);
    EXPECT_EQ(statistics.geometry_passes, passes) << static_cast<int>(method);
    EXPECT_EQ(statistics.fragments, passes * pixels) << static_cast<int>(method);
  }
  const auto expect_passes = [&](Method method, LayersBy layers_by, int passes) {
    FrameStatistics statistics;
    render_by(method, cloud, camera, options, &statistics, {.layers_by = layers_by});
    EXPECT_EQ(statistics.geometry_passes, passes) << static_cast<int>(method);
    EXPECT_GT(statistics.fragments, 0) << static_cast<int>(method);
  };
  expect_passes(Method::kTransparent, LayersBy::kGroup, 1);
  expect_passes(Method::kTransparentHigh, LayersBy::kGroup, 2);
  // Enlarged discs are drawn apart.
  expect_passes(Method::kTransparent, LayersBy::kSurface, 2);
  cloud.group_radius.clear();
  expect_passes(Method::kTransparent, LayersBy::kSurface, 1);
}

TEST(Methods, FewerGroupsComeAtACost) {
  const Camera camera = camera_at(2.2, 160);
  double before = std::numeric_limits<double>::infinity();
  for (const double overlap : {1.0, 0.6, 0.3}) {
    const SurfelCloud plane = grouped(jittered_plane(40, 1, 0.3), overlap);
    const double quality = psnr(render_by(Method::kDeferred, plane, camera),
                                render_by(Method::kABuffer, plane, camera), 16);
    EXPECT_LT(quality, before) << overlap;
    EXPECT_GT(quality, 17) << overlap;
    before = quality;
  }
}

TEST(Methods, OpaqueMethodsShowWhatIsBehindAnEdge) {
  // A sphere before a plane, both opaque: the sphere's rim is blended with the plane, not with the
  // background.
  SurfelCloud cloud = fibonacci_sphere(1500, 0.5, {0.9F, 0.9F, 0.9F});
  cloud = grouped(joined(cloud, jittered_plane(60, 1.5, 0.2, 1, -0.8)));
  for (const Method method : {Method::kDeferred, Method::kTwoPass}) {
    const Image image = render_by(method, cloud, camera_at(3, 128));
    for (int y = 24; y < 104; ++y) {
      for (int x = 24; x < 104; ++x) EXPECT_GT(image.pixel(x, y)[3], 0.97) << x << ", " << y;
    }
  }
}

/// Of a plane whose splats all are of one group: share of the pixels that do not show the splat
/// which is nearest by sqrt(beta / cutoff), as Voronoi rasterisation (10) should.
double share_not_voronoi(Voronoi voronoi, Method method, LayersBy layers_by = LayersBy::kSurface) {
  SurfelCloud plane = jittered_plane(12, 1, 0.2);
  for (std::size_t i = 0; i < plane.size(); ++i) {
    const Vec3f p = plane.position[i];
    // Slanted, for many depths, and rough, as in one plane splats that meet have the same.
    const auto rough = static_cast<float>(0.03 * random_uniform(8, i));
    plane.position[i] = Vec3f(p.x(), 0.5F * p.y(), 0.86F * p.y() + rough);
    plane.normal[i] = Vec3f(0, -0.86F, 0.5F).normalized();
  }
  plane.group.assign(plane.size(), 0);
  RenderOptions options;
  options.kernel = Kernel::kAffine;
  options.cutoff = 2;
  const Camera camera = camera_at(2.2, 96);
  const Image image = render_by(method, plane, camera, options, nullptr,
                                {.voronoi = voronoi, .layers_by = layers_by});
  std::vector<EwaKernel> kernels;
  for (std::size_t i = 0; i < plane.size(); ++i) {
    // As in methods.cpp: layers that each group tells by itself are hardly filtered.
    const double lowpass = layers_by == LayersBy::kGroup ? 0.5 / std::sqrt(2 * options.cutoff) : 1;
    kernels.push_back(*make_ewa_kernel(in_camera(plane, i, camera), camera, lowpass));
  }
  std::size_t wrong = 0;
  std::size_t count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const float* p = image.pixel(x, y);
      if (p[3] < 0.2) continue;
      double best = std::numeric_limits<double>::infinity();
      double second = best;
      std::size_t winner = 0;
      for (std::size_t i = 0; i < kernels.size(); ++i) {
        const double beta = kernels[i].beta({x + 0.5, y + 0.5});
        if (beta < best) {
          second = best;
          best = beta;
          winner = i;
        } else {
          second = std::min(second, beta);
        }
      }
      if (second - best < 1e-3 || std::abs(best - options.cutoff) < 1e-3) continue;
      ++count;
      wrong += (Vec3f(p[0], p[1], p[2]) / p[3] - plane.coefficient[winner]).norm() > 0.01F;
    }
  }
  EXPECT_GT(count, 2000);
  return static_cast<double>(wrong) / static_cast<double>(count);
}

TEST(Methods, VoronoiRasterisationCutsSplatsWhereTheyMeet) {
  EXPECT_LT(share_not_voronoi(Voronoi::kWindowed, Method::kDeferred), 1e-4);
  EXPECT_GT(share_not_voronoi(Voronoi::kOff, Method::kDeferred), 0.1);
  for (const LayersBy layers_by : {LayersBy::kSurface, LayersBy::kGroup}) {
    EXPECT_LT(share_not_voronoi(Voronoi::kWindowed, Method::kTransparent, layers_by), 1e-4);
  }
}

TEST(Methods, QuantisedDepthHasSeams) {
  const double seams = share_not_voronoi(Voronoi::kQuantised, Method::kDeferred);
  EXPECT_GT(seams, 0.01);
  EXPECT_LT(seams, share_not_voronoi(Voronoi::kOff, Method::kDeferred));
}

TEST(Methods, OneOpaqueLayerIsOpaqueInEveryMethod) {
  SurfelCloud plane = jittered_plane(48, 1.5, 0.25);
  plane.coefficient.assign(plane.size(), Vec3f(0.7F, 0.2F, 0.4F));
  plane = covered(plane, 4);
  for (const Method method : kMethods) {
    const Image image = render_by(method, plane, camera_at(2.5, 96));
    EXPECT_LT(worst_error(image, {0.7F, 0.2F, 0.4F, 1}), 1e-4) << static_cast<int>(method);
  }
}

TEST(Methods, TwoTransparentPlanesMatchTheClosedForm) {
  Stack stack = stacked_planes(2);
  stack.cloud = covered(stack.cloud, 4);
  for (const Method method : {Method::kTransparent, Method::kTransparentHigh}) {
    FrameStatistics statistics;
    const Image image = render_by(method, stack.cloud, camera_at(2.5, 96), {}, &statistics);
    EXPECT_LT(worst_error(image, stack.expected), kOneInByte) << static_cast<int>(method);
    EXPECT_EQ(statistics.groups, 4);
    EXPECT_GT(statistics.culled, 0);
  }
}

TEST(Methods, WithoutFragmentCullingLayersAreTooDark) {
  Stack stack = stacked_planes(2);
  stack.cloud = covered(stack.cloud, 4);
  const Image image = render_by(Method::kTransparent, stack.cloud, camera_at(2.5, 96), {}, nullptr,
                                {.voronoi = Voronoi::kOff, .layers_by = LayersBy::kGroup});
  EXPECT_GT(image.pixel(48, 48)[3], stack.expected.alpha + 0.02F);
}

TEST(Methods, DepthPeelingMatchesTheExactComposite) {
  for (const int k : {1, 2, 5, 8}) {
    const Stack stack = stacked_planes(k);
    FrameStatistics statistics;
    const Image image =
        render_by(Method::kDepthPeel, stack.cloud, camera_at(2.5, 96), {}, &statistics);
    EXPECT_LT(worst_error(image, stack.expected), kOneInByte) << k;
    EXPECT_EQ(statistics.unpeeled_pixels, 0);
    EXPECT_EQ(statistics.peeled_layers, k);
  }
}

TEST(Methods, MoreLayersThanPeelAreLeftOutAndReported) {
  const Stack stack = stacked_planes(5);
  FrameStatistics statistics;
  const Image image =
      render_by(Method::kDepthPeel, stack.cloud, camera_at(2.5, 96), {}, &statistics, {.peel = 2});
  Stack nearest = stacked_planes(2);
  EXPECT_LT(worst_error(image, nearest.expected), kOneInByte);
  EXPECT_EQ(statistics.unpeeled_pixels, 96 * 96);
  EXPECT_EQ(statistics.peeled_layers, 2);
}

TEST(Methods, PeelingStopsBehindOpaqueSurfaces) {
  SurfelCloud planes = jittered_plane(48, 1.5, 0.25);
  for (int i = 1; i < 6; ++i) planes = joined(planes, jittered_plane(48, 1.5, 0.25, 2, -0.5 * i));
  FrameStatistics statistics;
  render_by(Method::kDepthPeel, planes, camera_at(2.5, 96), {}, &statistics);
  // Few pixels are left open by more than one plane, none by all.
  EXPECT_LT(statistics.peeled_layers, 6);
}

TEST(Methods, TransparentHighIsNearerToDepthPeeling) {
  const SurfelCloud sphere = covered(with_alpha(colored_sphere(2500, 0.8), 0.5F), 4);
  const Camera camera = camera_at(2.2, 160);
  const Image truth = render_by(Method::kDepthPeel, sphere, camera);
  const auto quality = [&](Method method, LayersBy layers_by) {
    return psnr(render_by(method, sphere, camera, {}, nullptr, {.layers_by = layers_by}), truth);
  };
  const double simple = quality(Method::kTransparent, LayersBy::kGroup);
  EXPECT_GT(quality(Method::kTransparentHigh, LayersBy::kGroup), simple + 1);
  EXPECT_GT(simple, 20);
  EXPECT_GT(quality(Method::kTransparent, LayersBy::kSurface), simple + 5);
  EXPECT_GT(psnr(render_by(Method::kABuffer, sphere, camera), truth), 30);
}

/// The mean of n x n pixels, R G B A.
Image reduced(const Image& image, int n) {
  Image out = rgba_image(image.width / n, image.height / n);
  std::fill(out.data.begin(), out.data.end(), 0.0F);
  for (int y = 0; y < out.height * n; ++y) {
    for (int x = 0; x < out.width * n; ++x) {
      for (int c = 0; c < 4; ++c) {
        out.pixel(x / n, y / n)[c] += image.pixel(x, y)[c] / static_cast<float>(n * n);
      }
    }
  }
  return out;
}

// A ball behind a transparent plane. Pictures of eight times the size, reduced, have edges that owe
// nothing to the coverage of pixels.
TEST(Methods, LayersBehindTheFirstHaveEdges) {
  const SurfelCloud ball = fibonacci_sphere(3000, 0.6);
  SurfelCloud cloud =
      joined(with_alpha(ball, 0.8F), with_alpha(jittered_plane(60, 1.5, 0.2, 1, 0.8), 0.2F));
  cloud.coefficient.assign(cloud.size(), Vec3f(1, 1, 1));
  cloud = covered(cloud, 4);
  constexpr int kTimes = 8;
  for (const Method method : {Method::kTransparent, Method::kTransparentHigh}) {
    const MethodOptions by_group{.layers_by = LayersBy::kGroup};
    const auto render = [&](int size) {
      return render_by(method, cloud, camera_at(3, size), {}, nullptr, by_group);
    };
    const Image image = render(64);
    const Image truth = reduced(render(64 * kTimes), kTimes);
    // Without edges: 25.1 dB. Discs that are seen edge-on are still a pixel wide.
    EXPECT_GT(psnr(image, truth), 27.5) << static_cast<int>(method);
  }
}

// A transparent plane, dark on the left and bright on the right by its materials: the pixels
// between have a mean, as in a picture of eight times the size, reduced.
TEST(Methods, MaterialsAreBlendedWhereTheyMeet) {
  SurfelCloud plane = with_alpha(jittered_plane(60, 1.5, 0.2), 0.5F);
  plane.coefficient.assign(plane.size(), Vec3f(1, 1, 1));
  for (const Vec3f& p : plane.position) plane.material.push_back(p.x() + 0.5F * p.y() > 0 ? 1 : 0);
  plane = covered(plane, 4);
  Scene scene;
  scene.lights.clear();
  scene.ambient = Vec3f(1, 1, 1);
  scene.materials.resize(2);
  scene.materials[0].ambient = Vec3f(0, 0, 0);
  scene.materials[1].ambient = Vec3f(1, 1, 1);
  const auto render = [&](int size) {
    RenderCloud surfels(plane, columns_of(Method::kTransparentHigh));
    RenderOptions options;
    options.method = compositing_method(Method::kTransparentHigh);
    Renderer renderer(surfels, scene, options);
    return renderer.render(camera_at(2.5, size));
  };
  constexpr int kTimes = 8;
  const double quality = psnr(render(48), reduced(render(48 * kTimes), kTimes));
  // By the material of the nearest splat alone: 33 dB.
  EXPECT_GT(quality, 34);
}

/// The cloud in four groups with their coverage.
SurfelCloud covered_by(SurfelCloud cloud, CoverMethod method) {
  GroupingOptions options;
  options.groups = 4;
  group_splats(cloud, options);
  cover_groups(cloud, {.method = method});
  return cloud;
}

TEST(Methods, CoverageHelpsOnBentSurfaces) {
  // Bent much within a disc, as the places of real surfaces are that suffer from larger discs.
  SurfelCloud body = joined(fibonacci_sphere(900, 0.8), fibonacci_sphere(300, 0.4));
  body = with_alpha(body, 0.4F);
  const Camera camera = camera_at(2.2, 160);
  const Image truth = render_by(Method::kDepthPeel, body, camera);
  for (const Method method : {Method::kTransparent, Method::kTransparentHigh}) {
    const auto quality = [&](CoverMethod cover) {
      return psnr(render_by(method, covered_by(body, cover), camera), truth);
    };
    const double none = quality(CoverMethod::kNone);
    for (const CoverMethod cover :
         {CoverMethod::kEnlarge, CoverMethod::kEnlargeEach, CoverMethod::kDuplicate}) {
      EXPECT_GT(quality(cover), none + 1) << static_cast<int>(method) << static_cast<int>(cover);
    }
  }
}

TEST(Methods, PicturesDependNeitherOnThreadsNorOnOrderNorOnBands) {
  const SurfelCloud sphere = covered(with_alpha(colored_sphere(1200, 0.8), 0.5F), 5);
  SurfelCloud opaque = sphere;
  opaque.alpha.clear();
  const Camera camera = camera_at(2.2, 70);
  for (const Method method : kMethods) {
    const SurfelCloud& cloud = is_for_opaque(method) ? opaque : sphere;
    const Image expected = render_by(method, cloud, camera);
    for (const int threads : {1, 2, 5}) {
      set_thread_count(threads);
      EXPECT_EQ(render_by(method, cloud, camera).data, expected.data) << static_cast<int>(method);
    }
    set_thread_count(0);
    EXPECT_EQ(render_by(method, shuffled(cloud), camera).data, expected.data)
        << static_cast<int>(method);
  }
}

TEST(Methods, RimsHaveTheirCoverageWhereLayersRunOut) {
  // Shells within one another: at their rims pixels have up to six surfaces.
  SurfelCloud shells = fibonacci_sphere(8000, 1);
  for (const double radius : {0.97, 0.94}) shells = joined(shells, fibonacci_sphere(8000, radius));
  const Camera camera = camera_at(4, 64, 35);
  const auto with_layers = [&](int layers) {
    RenderOptions options;
    options.layers = layers;
    return render_by(Method::kABuffer, shells, camera, options);
  };
  // Merged pairs taken to be inside their surfaces: 28.6 dB.
  EXPECT_GT(psnr(with_layers(2), with_layers(16)), 31.5);
}

/// A glass ball with an environment around.
Image glass_ball(Method method, const SurfelCloud& cloud,
                 const Camera& camera = camera_at(4, 64, 35)) {
  Material glass;
  glass.opacity = 0;
  glass.ior = 1.3F;
  Scene scene;
  scene.materials = {glass};
  scene.environment = direction_environment(64);
  scene.refraction = Refraction::kMulti;
  RenderCloud surfels(cloud, columns_of(method));
  RenderOptions options;
  options.method = compositing_method(method);
  Renderer renderer(surfels, scene, options);
  return renderer.render(camera);
}

/// The picture moved by some pixels shows the same, though other pixels are at the borders of tiles
/// and of the SIMD vectors' patches. Pixels at the picture's own border have fewer neighbours.
TEST(Methods, GlassDoesNotDependOnWhereTilesLie) {
  constexpr int kSize = 96;
  const SurfelCloud ball = covered(fibonacci_sphere(2000, 1), 4);
  const Camera camera = camera_at(4, kSize, 35);
  const auto inside = [](int at) { return at > 0 && at < kSize - 1; };
  for (const Method method : {Method::kTransparent, Method::kTransparentHigh}) {
    const Image still = glass_ball(method, ball, camera);
    for (const auto& [dx, dy] : {std::pair(5, 3), std::pair(1, 8), std::pair(-7, -9)}) {
      Camera moved = camera;
      moved.center_x += dx;
      moved.center_y += dy;
      const Image image = glass_ball(method, ball, moved);
      int differ = 0;
      for (int y = 1; y < kSize - 1; ++y) {
        for (int x = 1; x < kSize - 1; ++x) {
          if (!inside(x + dx) || !inside(y + dy)) continue;
          const float* const a = still.pixel(x, y);
          const float* const b = image.pixel(x + dx, y + dy);
          differ += std::equal(a, a + 4, b, [](float p, float q) { return std::abs(p - q) < 1e-3; })
                        ? 0
                        : 1;
        }
      }
      // Rounding may decide whether a disc meets a pixel, which nine pixels are filtered over.
      EXPECT_LE(differ, 9) << static_cast<int>(method) << " " << dx << " " << dy;
    }
  }
}

TEST(Methods, GlassIsAsSmoothAsPeeledGlass) {
  const SurfelCloud ball = covered(fibonacci_sphere(2000, 1), 4);
  const Image expected = glass_ball(Method::kDepthPeel, ball);
  EXPECT_GT(psnr(glass_ball(Method::kTransparent, ball), expected), 20);
  EXPECT_GT(psnr(glass_ball(Method::kTransparentHigh, ball), expected), 20);
}

// A flat splat that meets the direction of a lamp would be a speck of it, where a bent surface has
// a highlight as large as the lamp.
TEST(Methods, GroupsMirrorALampAsOneSurface) {
  const SurfelCloud ball = with_alpha(covered(fibonacci_sphere(2000, 1), 4), 0.1F);
  Environment studio;
  studio.image = "lamp";
  studio.map = std::make_shared<const EnvironmentMap>(
      lat_long_image(64,
                     [](const Vec3d& d) {
                       const bool lamp = d.dot(Vec3d(0.3, 0.4, 1).normalized()) > 0.995;
                       return lamp ? Vec3f(50, 50, 50) : Vec3f(0.1F, 0.1F, 0.1F);
                     }),
      studio.image);
  studio.visible = false;
  Material mirror;
  mirror.reflectivity = {0.5F, 0.5F, 0.5F};
  Scene scene;
  scene.materials = {mirror};
  scene.environment = studio;
  const auto brightest = [&](Method method) {
    RenderCloud surfels(ball, columns_of(method));
    RenderOptions options;
    options.method = compositing_method(method);
    const Image image = Renderer(surfels, scene, options).render(camera_at(4, 128, 35));
    float most = 0;
    for (int p = 0; p < 128 * 128; ++p) most = std::max(most, image.pixel(p % 128, p / 128)[1]);
    return most;
  };
  const float expected = brightest(Method::kDepthPeel);
  EXPECT_NEAR(brightest(Method::kTransparent), expected, 0.25F * expected);
  EXPECT_NEAR(brightest(Method::kTransparentHigh), expected, 0.25F * expected);
}

TEST(Methods, CopiesCountOnceWhereGroupsDoNotMatter) {
  const SurfelCloud plain = with_alpha(grouped(jittered_plane(16, 1, 0.3)), 0.5F);
  Array<std::uint32_t> order(plain.size());
  std::iota(order.begin(), order.end(), 0U);
  for (std::uint32_t i = 0; i < plain.size(); i += 3) order.push_back(i);
  SurfelCloud copies = plain.gathered(order);
  copies.source = order;
  for (std::size_t i = plain.size(); i < copies.size(); ++i) ++copies.group[i];
  const Camera camera = camera_at(2.2, 64);
  for (const Method method : kMethods) {
    RenderCloud surfels(copies, columns_of(method));
    const bool blended = method == Method::kTransparent || method == Method::kTransparentHigh;
    EXPECT_EQ(surfels.copies(), blended ? 0 : copies.size() - plain.size());
    EXPECT_EQ(surfels.size() + surfels.copies(), copies.size());
    if (blended || is_for_opaque(method)) continue;
    const Image expected = render_by(method, plain, camera);
    EXPECT_EQ(largest_difference(render_by(method, copies, camera), expected), 0);
    EXPECT_EQ(largest_difference(render_by(method, shuffled(copies), camera), expected), 0);
  }
  SurfelCloud opaque = copies;
  opaque.alpha.clear();
  SurfelCloud once = plain;
  once.alpha.clear();
  for (const Method method : {Method::kDeferred, Method::kTwoPass}) {
    EXPECT_EQ(render_by(method, opaque, camera).data, render_by(method, once, camera).data);
  }
  // What shares its source alone, as scans do whose files mean something else by it, stays.
  copies.source.assign(copies.size(), 5);
  EXPECT_EQ(RenderCloud(copies).copies(), copies.size() - plain.size());
}

TEST(Methods, NumbersOfGroupsDoNotMatter) {
  SurfelCloud sphere = covered(colored_sphere(800, 0.8), 3);
  SurfelCloud sparse = sphere;
  for (std::uint16_t& g : sparse.group) {
    g = std::array<std::uint16_t, 3>{5, 4000, 65535}[g];
  }
  for (const Method method : kGroupMethods) {
    EXPECT_EQ(render_by(method, sphere, camera_at(2.2, 64)).data,
              render_by(method, sparse, camera_at(2.2, 64)).data);
  }
}

TEST(Methods, OneGroupIsDrawn) {
  SurfelCloud sphere = colored_sphere(800, 0.8);
  sphere.group.assign(sphere.size(), 3);
  for (const Method method : kGroupMethods) {
    FrameStatistics statistics;
    const Image image = render_by(method, sphere, camera_at(3.5, 64), {}, &statistics);
    EXPECT_EQ(statistics.groups, 1);
    EXPECT_GT(image.pixel(32, 32)[3], 0.9) << static_cast<int>(method);
    EXPECT_EQ(image.pixel(1, 1)[3], 0);
  }
}

TEST(Methods, EmptyCloudsAreEmptyPictures) {
  for (const Method method : kMethods) {
    const Image image = render_by(method, {}, camera_at(2, 20));
    for (int c = 0; c < 4; ++c) EXPECT_EQ(image.pixel(10, 10)[c], 0);
  }
}

TEST(Methods, CoincidentSplatsOfOneGroupAreOneSplat) {
  SurfelCloud one;
  add_surfel(one, {0, 0, 0}, {0, 0, 1}, 0.04F, 0.04F, {0.2F, 0.5F, 0.9F});
  one.alpha.push_back(0.5F);
  one.group.push_back(0);
  Array<std::uint32_t> copies(50, 0U);
  const auto by_group = [](const SurfelCloud& cloud) {
    return render_by(Method::kTransparent, cloud, camera_at(2, 48), {}, nullptr,
                     {.layers_by = LayersBy::kGroup});
  };
  EXPECT_EQ(by_group(one).data, by_group(one.gathered(copies)).data);
  // Interpolated, their weights add up: that covers more of the rim, and is no other colour.
  const Image many = render_by(Method::kTransparentHigh, one.gathered(copies), camera_at(2, 48));
  const float* p = many.pixel(24, 24);
  EXPECT_NEAR(p[3], 0.5, 1e-5);
  EXPECT_NEAR(p[2], 0.45, 1e-5);
}

TEST(Methods, UnusableEnlargedRadiiAreLeftOut) {
  SurfelCloud sphere = covered(colored_sphere(800, 0.8), 3);
  SurfelCloud fewer = sphere;
  const std::size_t before = sphere.size();
  for (const float bad : {0.0F, -1.0F, std::numeric_limits<float>::quiet_NaN(),
                          std::numeric_limits<float>::infinity()}) {
    add_surfel(sphere, {0, 0, 0.9F}, {0, 0, 1}, 0.01F, 0.01F, {1, 1, 1});
    sphere.group.push_back(0);
    sphere.group_radius.push_back(bad);
  }
  RenderCloud cloud(sphere, columns_of(Method::kTransparent));
  EXPECT_EQ(cloud.size(), before);
  EXPECT_EQ(cloud.dropped().variance, 4);
  EXPECT_EQ(render_by(Method::kTransparent, sphere, camera_at(2.2, 64)).data,
            render_by(Method::kTransparent, fewer, camera_at(2.2, 64)).data);
}

TEST(Methods, HugeEnlargedRadiiAreDrawn) {
  SurfelCloud sphere = covered(colored_sphere(300, 0.8), 3);
  for (std::size_t i = 0; i < sphere.size(); i += 50) sphere.group_radius[i] = 1e30F;
  for (const Method method : {Method::kTransparent, Method::kTransparentHigh}) {
    const Image image = render_by(method, sphere, camera_at(2.2, 48));
    for (const float v : image.data) EXPECT_TRUE(std::isfinite(v));
  }
}

TEST(Methods, WhatCannotBeDrawnIsAnError) {
  SurfelCloud plane = jittered_plane(40, 1, 0.3);
  const auto kind = [](auto&& run) {
    try {
      run();
    } catch (const Error& error) {
      return error.kind();
    }
    return ErrorKind::kInterrupted;
  };
  const Camera camera = camera_at(2, 32);
  for (const Method method : kGroupMethods) {
    EXPECT_EQ(kind([&] { render_by(method, plane, camera); }), ErrorKind::kInput);
  }
  // The cloud has groups, but was made without them.
  plane.group.assign(plane.size(), 0);
  EXPECT_EQ(kind([&] {
              RenderCloud surfels(plane);
              const Scene scene;
              RenderOptions options;
              options.method = compositing_method(Method::kDeferred);
              const Renderer renderer(surfels, scene, options);
            }),
            ErrorKind::kInput);
  for (const Method method : {Method::kDeferred, Method::kTwoPass}) {
    EXPECT_EQ(kind([&] { render_by(method, with_alpha(plane, 0.5F), camera); }), ErrorKind::kUsage);
  }
  std::iota(plane.group.begin(), plane.group.end(), std::uint16_t{0});
  for (const Method method : kGroupMethods) {
    EXPECT_EQ(kind([&] { render_by(method, plane, camera); }), ErrorKind::kInput);
  }
  RenderOptions options;
  for (const int peel : {0, 65, -3}) {
    options.method = compositing_method(Method::kDepthPeel, {.peel = peel});
    EXPECT_EQ(options.problems().size(), 1);
  }
  options = {};
  options.aovs = true;
  options.method = compositing_method(Method::kTransparent);
  EXPECT_EQ(options.problems().size(), 1);
}

}  // namespace
}  // namespace surfel::test
