// Rows of a picture that are drawn alone are the same as in the whole picture, bit for bit.

#include <cstring>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/morton.h>
#include <surfel/base/random.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/sp06/grouping.h>
#include <surfel/sp06/methods.h>
#include <surfel/store/cloud_stream.h>
#include <surfel/truth/supersample.h>

#include "gaussian/random_gaussians.h"
#include "render/scenes.h"

namespace surfel::test {
namespace {

/// The first row that differs among a picture's rows, or -1.
int first_difference(const Image& whole, const Image& part, const RowRange& rows) {
  for (int y = rows.begin; y < rows.end; ++y) {
    const auto bytes =
        static_cast<std::size_t>(whole.pixel(0, y + 1) - whole.pixel(0, y)) * sizeof(float);
    if (std::memcmp(whole.pixel(0, y), part.pixel(0, y), bytes) != 0) return y;
  }
  return -1;
}

/// Draws some rows after others, by the same renderer, as it keeps memory from picture to picture.
template <class Draw>
void expect_same_rows(Camera camera, const Draw& draw, const std::string& what) {
  const Image whole = draw(camera);
  const int height = camera.height;
  const std::vector<RowRange> parts{
      {0, 1},          {height / 2, height / 2 + 1},    {height - 1, height},
      {0, height / 3}, {height / 3, Camera::kMostSide}, {37, 59},
      {48, 64}};
  for (const RowRange& part : parts) {
    camera.rows = part;
    const RowRange rows = camera.drawn_rows();
    EXPECT_EQ(first_difference(whole, draw(camera), rows), -1)
        << what << ", rows " << rows.begin << " to " << rows.end;
  }
}

Camera slanted_camera(const SceneExtent& extent, int width, int height) {
  CameraOptions options;
  options.from = Vec3d(0.3, 0.5, 1);
  options.width = width;
  options.height = height;
  return make_camera(options, extent);
}

struct Case {
  std::string name;
  std::string scene;
  RenderOptions options;
};

std::vector<Case> cases() {
  std::vector<Case> all;
  const auto add = [&](const std::string& name, const char* scene) -> RenderOptions& {
    all.push_back({scene + (", " + name), scene, RenderOptions()});
    return all.back().options;
  };
  for (const char* scene : {"terrain", "sphere", "transparent"}) {
    add("plain", scene);
    add("with depths", scene).aovs = true;
    add("in two layers", scene).layers = 2;
    add("by parts of blocks", scene).batch = 1024;
  }
  add("occlusion", "terrain").relief = Relief::kOcclusion;
  add("eye-dome", "terrain").relief = Relief::kEyeDome;
  add("background", "sphere").background = {1, 0.5F, 0, 1};
  return all;
}

TEST(Rows, AreTheSameAsInTheWholePicture) {
  for (const Case& c : cases()) {
    const SurfelCloud cloud = generate_surfels(procedural_scene(c.scene, 1), {.count = 20000});
    RenderCloud surfels(cloud);
    const Scene scene = default_scene();
    Renderer renderer(surfels, scene, c.options);
    expect_same_rows(
        slanted_camera(surfels.extent(), 90, 131),
        [&](const Camera& camera) { return renderer.render(camera); }, c.name);
  }
}

TEST(Rows, AreTheSameByMethodsThatNeedWholeTiles) {
  SurfelCloud cloud = generate_surfels(procedural_scene("sphere", 1), {.count = 4000});
  group_splats(cloud, {});
  const Scene scene = default_scene();
  for (const Method method : {Method::kDeferred, Method::kTransparent, Method::kTwoPass}) {
    RenderCloud surfels(cloud, columns_of(method));
    RenderOptions options;
    options.method = compositing_method(method);
    Renderer renderer(surfels, scene, options);
    expect_same_rows(
        slanted_camera(surfels.extent(), 80, 110),
        [&](const Camera& camera) { return renderer.render(camera); },
        "method " + std::to_string(static_cast<int>(method)));
  }
}

TEST(Rows, AreTheSameWhereThePictureIsMadeInBandsAndBatches) {
  SurfelCloud cloud = generate_surfels(procedural_scene("terrain", 1), {.count = 30000});
  cloud = cloud.gathered(morton_order(cloud.position));
  CloudSource source(cloud, "terrain");
  const auto stream = CloudStream::make(source, {.batch = 2048, .picture_bytes = 1 << 19});
  ASSERT_TRUE(stream);
  const Scene scene = default_scene();
  Renderer renderer(*stream, scene, {});
  expect_same_rows(
      slanted_camera(stream->cloud().extent(), 90, 131),
      [&](const Camera& camera) { return renderer.render(camera); }, "streamed");
}

TEST(Rows, OfGaussiansAreTheSame) {
  const GaussianCloud cloud = random_gaussians(2000, 5);
  for (const int samples : {1, 2, 3}) {
    GaussianRenderer renderer(
        cloud, {.profile = GaussianProfile::kExact, .samples = samples, .depth = samples > 1});
    expect_same_rows(
        camera_before(cloud, 70, 131),
        [&](const Camera& camera) { return renderer.render(camera); },
        "samples " + std::to_string(samples));
  }
}

TEST(Rows, OfSampledPicturesAreTheSame) {
  Camera camera;
  // Several bands of sample rows.
  camera.width = 3000;
  camera.height = 97;
  expect_same_rows(
      camera,
      [](const Camera& seen) {
        return supersample(seen, {.samples = 8, .lowpass = 1}, [](double x, double y, int) {
          const float value =
              static_cast<float>(random_uniform(1, static_cast<std::uint64_t>(4096 * (x + 64)),
                                                static_cast<std::uint64_t>(4096 * (y + 64))));
          return Rgba{value, 1 - value, 0.5F, 1};
        });
      },
      "samples");
}

TEST(Rows, OutsideOfThePictureAreRefused) {
  Camera camera;
  for (const RowRange& rows : {RowRange{-1, 3}, RowRange{5, 5}, RowRange{camera.height, 9999}}) {
    camera.rows = rows;
    EXPECT_EQ(camera.problems().size(), 1U) << rows.begin;
  }
}

}  // namespace
}  // namespace surfel::test
