// Explanations of pixels are true: what they tell, blended, is the picture's pixel.

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/render/pixel_explanation.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/sp06/coverage.h>
#include <surfel/sp06/grouping.h>
#include <surfel/sp06/methods.h>
#include <surfel/store/cloud_stream.h>

#include "gaussian/random_gaussians.h"
#include "render/scenes.h"

namespace surfel::test {
namespace {

using Pixels = std::vector<std::array<int, 2>>;

/// Pixels all over a picture: inside and at the border of tiles and of the picture.
Pixels some_pixels(const Camera& camera) {
  Pixels pixels;
  for (int i = 0; i < 18; ++i) {
    const auto at = [&](int side, std::uint64_t axis) {
      return static_cast<int>(random_uniform(7, static_cast<std::uint64_t>(i), axis) * side);
    };
    pixels.push_back({at(camera.width, 0), at(camera.height, 1)});
  }
  pixels.push_back({0, 0});
  pixels.push_back({camera.width - 1, camera.height - 1});
  pixels.push_back({15, 16});
  pixels.push_back({31, 47});
  return pixels;
}

std::array<double, 4> over_background(const PixelExplanation& e, const Vec3d& surfaces) {
  std::array<double, 4> out{};
  for (std::size_t c = 0; c < 4; ++c) {
    const double own = c < 3 ? surfaces[static_cast<Eigen::Index>(c)] : e.alpha;
    out[c] = own + (1 - e.alpha) * static_cast<double>(e.background[c]);
  }
  return out;
}

template <class Part>
Vec3d blended(const std::vector<Part>& parts) {
  Vec3d sum(0, 0, 0);
  for (const Part& part : parts) sum += part.share * part.color.template cast<double>();
  return sum;
}

void expect_near(const std::array<double, 4>& found, const float* pixel, double tolerance,
                 const std::string& what) {
  for (std::size_t c = 0; c < 4; ++c) {
    EXPECT_NEAR(found[c], static_cast<double>(pixel[c]), tolerance) << what << ", channel " << c;
  }
}

/// Explains pixels of a picture, and blends what the explanations tell. Returns them.
std::vector<PixelExplanation> expect_true(Renderer& renderer, const Camera& camera,
                                          const std::string& what) {
  const Image image = renderer.render(camera);
  const std::vector<PixelExplanation> all = renderer.explain(camera, some_pixels(camera));
  int seen = 0;
  for (const PixelExplanation& e : all) {
    const std::string name = what + ", pixel " + std::to_string(e.x) + "," + std::to_string(e.y);
    const float* pixel = image.pixel(e.x, e.y);
    // Opacities at edges have steps of 3e-5.
    constexpr double kRounding = 6e-5;
    for (std::size_t c = 0; c < 4; ++c) EXPECT_NEAR(e.pixel[c], pixel[c], kRounding) << name;
    if (e.filled) continue;
    seen += e.alpha > 0 ? 1 : 0;
    expect_near(over_background(e, e.relief * blended(e.layers)), pixel, kRounding,
                name + ", layers");
    if (e.splats_add_up) {
      expect_near(over_background(e, e.relief * blended(e.splats)), pixel, kRounding,
                  name + ", splats");
    }
    double alpha = 0;
    for (const ExplainedLayer& layer : e.layers) alpha += layer.share;
    EXPECT_NEAR(alpha, e.alpha, kRounding) << name;
    for (const ExplainedSplat& splat : e.splats) {
      EXPECT_NEAR(splat.weight, splat.coefficient * splat.kernel * splat.clip,
                  1e-6 * splat.coefficient)
          << name;
      if (splat.fate == SplatFate::kOutside) {
        EXPECT_EQ(splat.share, 0) << name;
      }
    }
  }
  EXPECT_GT(seen, 2) << what;
  return all;
}

Camera camera_of(const SceneExtent& extent, int width = 90, int height = 75) {
  CameraOptions options;
  options.from = Vec3d(0.3, 0.5, 1);
  options.width = width;
  options.height = height;
  return make_camera(options, extent);
}

SurfelCloud scene_of(const char* name, std::size_t count) {
  return generate_surfels(procedural_scene(name, 1), {.count = count});
}

TEST(PixelExplanation, BlendsToThePixelOfAnABuffer) {
  struct Case {
    const char* scene;
    std::size_t count;
    RenderOptions options;
  };
  std::vector<Case> cases;
  const auto add = [&](const char* scene, std::size_t count) -> RenderOptions& {
    return cases.emplace_back(Case{scene, count, {}}).options;
  };
  for (const char* scene : {"terrain", "sphere", "transparent"}) {
    add(scene, 12000).lit = false;
    add(scene, 12000).background = {1, 0.5F, 0, 1};
    add(scene, 300).lit = false;
  }
  for (const int layers : {1, 2}) {
    RenderOptions& few = add("transparent", 12000);
    few.layers = layers;
    few.lit = false;
    few.background = {0.2F, 0.4F, 0.6F, 0.5F};
    RenderOptions& opaque = add("terrain", 12000);
    opaque.layers = layers;
    opaque.lit = false;
    add("terrain", 12000).layers = layers;
  }
  RenderOptions& parts = add("transparent", 12000);
  parts.batch = 1024;
  parts.lit = false;
  RenderOptions& occlusion = add("terrain", 12000);
  occlusion.relief = Relief::kOcclusion;
  occlusion.background = {1, 1, 1, 1};
  RenderOptions& smooth = add("sphere", 3000);
  smooth.cutoff = 4;
  smooth.lit = false;
  smooth.aovs = true;
  const Scene scene = default_scene();
  for (const Case& c : cases) {
    RenderCloud surfels(scene_of(c.scene, c.count), {.places = true});
    Renderer renderer(surfels, scene, c.options);
    expect_true(renderer, camera_of(surfels.extent()),
                std::string(c.scene) + " of " + std::to_string(c.count) + " in " +
                    std::to_string(c.options.layers) + (c.options.lit ? ", lit" : ", unlit"));
  }
}

TEST(PixelExplanation, BlendsToThePixelWhereAThinFrontLiesBeforeABack) {
  SurfelCloud cloud;
  const auto add = [&](const Vec3f& position, const Vec3f& normal, const Vec3f& color,
                       float variance, float area) {
    cloud.position.push_back(position);
    cloud.normal.push_back(normal);
    cloud.color.push_back(color);
    cloud.variance.push_back(variance);
    cloud.area.push_back(area);
  };
  // A wall whose back is seen, and discs before it whose kernels leave most of a pixel open.
  for (int i = 0; i < 1600; ++i) {
    const Vec3f place(static_cast<float>(i % 40) - 19.5F, static_cast<float>(i / 40) - 19.5F, 0);
    add(place, -Vec3f::UnitZ(), Vec3f(0.9F, 0.2F, 0.1F), 1, 1);
  }
  for (int i = 0; i < 25; ++i) {
    const Vec3f place(static_cast<float>(i % 5) * 8 - 16, static_cast<float>(i / 5) * 8 - 16, 3);
    add(place, Vec3f::UnitZ(), Vec3f(0.1F, 0.2F, 0.9F), 8, 10);
  }
  RenderOptions options;
  options.lit = false;
  const Scene scene = default_scene();
  RenderCloud surfels(cloud, {.places = true});
  Renderer renderer(surfels, scene, options);
  const auto all = expect_true(renderer, camera_of(surfels.extent()), "thin front");
  const auto thin = [](const PixelExplanation& e) {
    return e.layers.size() == 2 && e.layers[0].front && e.layers[0].share > 0.1 &&
           e.layers[1].share > 0.1;
  };
  EXPECT_TRUE(std::any_of(all.begin(), all.end(), thin)) << "both are seen";
}

TEST(PixelExplanation, BlendsToThePixelWhereLinesCutSurfels) {
  SurfelCloud cloud = scene_of("sphere", 2000);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.clip1.push_back(cloud.normal[i].unitOrthogonal());
    cloud.clip1_distance.push_back(0.3F * std::sqrt(cloud.variance[i]));
  }
  RenderCloud surfels(cloud, {.places = true});
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  Renderer renderer(surfels, scene, options);
  double least = 1;
  for (const PixelExplanation& e : expect_true(renderer, camera_of(surfels.extent()), "clipped")) {
    for (const ExplainedSplat& splat : e.splats) least = std::min(least, splat.clip);
  }
  EXPECT_LT(least, 0.5);
}

TEST(PixelExplanation, BlendsToThePixelOfMethodsWithGroups) {
  SurfelCloud cloud = scene_of("sphere", 4000);
  group_splats(cloud, {});
  const Scene scene = default_scene();
  for (const bool lit : {false, true}) {
    for (const Method method : {Method::kDeferred, Method::kTransparent, Method::kTransparentHigh,
                                Method::kTwoPass, Method::kDepthPeel}) {
      RenderColumns columns = columns_of(method);
      columns.places = true;
      RenderCloud surfels(cloud, columns);
      RenderOptions options;
      options.method = compositing_method(method);
      options.lit = lit;
      Renderer renderer(surfels, scene, options);
      expect_true(renderer, camera_of(surfels.extent(), 60, 50),
                  "method " + std::to_string(static_cast<int>(method)));
    }
  }
}

TEST(PixelExplanation, NamesTheSurfelsOfTheFile) {
  const SurfelCloud cloud = scene_of("terrain", 6000);
  RenderCloud surfels(cloud, {.places = true});
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  Renderer renderer(surfels, scene, options);
  const Camera camera = camera_of(surfels.extent());
  for (const PixelExplanation& e : renderer.explain(camera, some_pixels(camera))) {
    for (const ExplainedSplat& splat : e.splats) {
      ASSERT_LT(splat.surfel, cloud.size());
      // An affine kernel's greatest value is near the place where the surfel's centre is seen.
      const Vec3d place = camera.camera_from_world * (cloud.world(splat.surfel) - camera.eye);
      EXPECT_NEAR(splat.depth, place.z(), 0.2 * place.z());
      EXPECT_LT((splat.color - cloud.color[splat.surfel]).norm(), 1e-5F);
    }
  }
}

TEST(PixelExplanation, IsTheSameWhereSurfelsAreStreamed) {
  SurfelCloud cloud = scene_of("terrain", 30000);
  cloud = cloud.gathered(morton_order(cloud.position));
  CloudSource source(cloud, "terrain");
  const auto stream =
      CloudStream::make(source, {.batch = 2048, .picture_bytes = 1 << 19, .places = true});
  ASSERT_TRUE(stream);
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  const Camera camera = camera_of(stream->cloud().extent(), 90, 131);
  Renderer streamed(*stream, scene, options);
  const auto from_file = expect_true(streamed, camera, "streamed");
  RenderCloud resident(cloud, {.places = true});
  Renderer renderer(resident, scene, options);
  const auto in_memory = renderer.explain(camera, some_pixels(camera));
  const auto surfels_of = [](const PixelExplanation& e) {
    std::vector<std::uint64_t> surfels;
    for (const ExplainedSplat& splat : e.splats) {
      if (splat.weight > 0) surfels.push_back(splat.surfel);
    }
    std::sort(surfels.begin(), surfels.end());
    return surfels;
  };
  for (std::size_t i = 0; i < in_memory.size(); ++i) {
    EXPECT_EQ(surfels_of(from_file[i]), surfels_of(in_memory[i])) << i;
  }
}

TEST(PixelExplanation, BlendsToThePixelOfLevelsOfDetail) {
  const SurfelCloud cloud = build_hierarchy(scene_of("terrain", 40000), {});
  RenderCloud surfels(cloud, {.levels = true, .places = true});
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  Renderer renderer(surfels, scene, options);
  expect_true(renderer, camera_of(surfels.extent(), 64, 48), "levels");
}

TEST(PixelExplanation, TellsWhatIsHidden) {
  // A red plane in front of a green one, whose splats lie close together.
  SurfelCloud cloud = jittered_plane(40, 1.5, 0.1, 1, 0);
  const std::size_t front = cloud.size();
  const SurfelCloud behind = jittered_plane(40, 1.5, 0.1, 2, -0.5);
  for (std::size_t i = 0; i < behind.size(); ++i) {
    add_surfel(cloud, behind.position[i], behind.normal[i], behind.variance[i], behind.area[i],
               {0, 1, 0});
  }
  RenderCloud surfels(cloud, {.places = true});
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  Renderer renderer(surfels, scene, options);
  const Camera camera = camera_at(4, 48);
  for (const PixelExplanation& e : renderer.explain(camera, Pixels{{{24, 24}, {20, 30}}})) {
    double shown = 0;
    for (const ExplainedSplat& splat : e.splats) {
      if (splat.surfel < front) {
        shown += splat.share;
        if (splat.weight > 0) {
          EXPECT_EQ(splat.layer, 0);
        }
        EXPECT_NEAR(splat.depth, 4, 1e-3);
      } else {
        EXPECT_EQ(splat.share, 0);
        EXPECT_NE(splat.layer, 0);
        EXPECT_NEAR(splat.depth, 4.5, 1e-3);
      }
    }
    EXPECT_NEAR(shown, 1, 1e-5);
  }
}

TEST(PixelExplanation, BlendsToThePixelOfGaussians) {
  const GaussianCloud cloud = random_gaussians(1500, 5);
  for (const GaussianProfile profile :
       {GaussianProfile::kInria, GaussianProfile::kGsplat, GaussianProfile::kMip,
        GaussianProfile::k2dgs, GaussianProfile::kExact, GaussianProfile::kSurfel}) {
    GaussianRenderer renderer(cloud, {.profile = profile, .background = {0.2F, 0.3F, 0.4F, 0.7F}});
    const Camera camera = camera_before(cloud, 70, 61);
    const Image image = renderer.render(camera);
    for (const auto& [x, y] : some_pixels(camera)) {
      const std::string name = "profile " + std::to_string(static_cast<int>(profile)) + " " +
                               std::to_string(x) + "," + std::to_string(y);
      const PixelExplanation e = renderer.explain(camera, x, y);
      std::array<double, 4> found = over_background(e, blended(e.splats));
      for (std::size_t c = 0; c < 3 && found[3] > 0; ++c) {
        found[c] =
            found[3] * static_cast<double>(srgb_to_linear(static_cast<float>(found[c] / found[3])));
      }
      expect_near(found, image.pixel(x, y), 1e-4, name);
      double alpha = 0;
      for (const ExplainedSplat& splat : e.splats) {
        alpha += splat.share;
        ASSERT_LT(splat.surfel, cloud.size());
        const Vec3d place =
            camera.camera_from_world *
            (cloud.origin + cloud.position[splat.surfel].cast<double>() - camera.eye);
        EXPECT_NEAR(splat.depth, place.z(), 1e-4 * place.z()) << name;
      }
      EXPECT_NEAR(alpha, e.alpha, 1e-4) << name;
    }
  }
}

TEST(PixelExplanation, OutsideOfThePictureIsRefused) {
  RenderCloud surfels(scene_of("sphere", 500), {.places = true});
  const Scene scene;
  Renderer renderer(surfels, scene, {});
  Camera camera = camera_of(surfels.extent());
  for (const std::array<int, 2>& pixel : Pixels{{{-1, 0}, {90, 0}, {0, 75}}}) {
    EXPECT_THROW(renderer.explain(camera, Pixels{pixel}), Error);
  }
  camera.rows = {16, 32};
  EXPECT_THROW(renderer.explain(camera, Pixels{{3, 40}}), Error);
  EXPECT_EQ(renderer.explain(camera, Pixels{{3, 20}}).size(), 1U);
}

}  // namespace
}  // namespace surfel::test
