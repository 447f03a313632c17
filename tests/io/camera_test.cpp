#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/scene_file.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/scene.h>

#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

Vec2d project(const Camera& camera, const Vec3d& world) {
  const Vec3d p = camera.camera_from_world * (world - camera.eye);
  const double w = camera.orthographic ? 1 : p.z();
  return {camera.focal_x * p.x() / w + camera.center_x,
          camera.focal_y * p.y() / w + camera.center_y};
}

CameraOptions front_view() {
  CameraOptions options;
  options.eye = Vec3d(0, 0, 3);
  options.target = Vec3d(0, 0, 0);
  return options;
}

std::string written(const TemporaryFolder& folder, const std::string& text) {
  const std::string path = folder / "file.toml";
  std::ofstream(path) << text;
  return path;
}

TEST(Camera, LooksAlongTheViewWithUpAtTheTop) {
  const Camera camera = make_camera(front_view(), {});
  EXPECT_LT((project(camera, {0, 0, 0}) - Vec2d(256, 256)).norm(), 1e-9);
  EXPECT_GT(project(camera, {0.1, 0, 0}).x(), 256);  // World x to the right,
  EXPECT_LT(project(camera, {0, 0.1, 0}).y(), 256);  // y up, where rows are small.
  EXPECT_NEAR(camera.camera_from_world.determinant(), 1, 1e-12);
}

TEST(Camera, FieldOfViewIsVertical) {
  CameraOptions options = front_view();
  options.fov = 60;
  options.width = 1000;
  const Camera camera = make_camera(options, {});
  EXPECT_NEAR(project(camera, {0, 3 * std::tan(M_PI / 6), 0}).y(), 0, 1e-9);
  EXPECT_DOUBLE_EQ(camera.focal_x, camera.focal_y);
  EXPECT_DOUBLE_EQ(camera.center_x, 500);
}

TEST(Camera, OrthographicHeightIsWhatIsSeen) {
  CameraOptions options = front_view();
  options.ortho = 4;
  const Camera camera = make_camera(options, {});
  EXPECT_NEAR(project(camera, {0, 2, -7}).y(), 0, 1e-9);
  EXPECT_NEAR(project(camera, {0, -2, 1}).y(), 512, 1e-9);
}

TEST(Camera, FramingSeesEverySphereAndNothingElse) {
  const double radius = 0.5;
  const Vec3d centers[] = {Vec3d(5, 1, 2), Vec3d(9, -3, 0), Vec3d(4, 4, -6)};
  SceneExtent scene;
  for (const Vec3d& p : centers) {
    scene.box.add(p - Vec3d::Constant(radius));
    scene.box.add(p + Vec3d::Constant(radius));
  }
  scene.support = [&](const Vec3d& a, double b) {
    double greatest = -std::numeric_limits<double>::infinity();
    for (const Vec3d& p : centers) greatest = std::max(greatest, a.dot(p) + b * radius);
    return greatest;
  };
  for (const bool orthographic : {false, true}) {
    for (const auto& [w, h] : {std::pair{400, 200}, {200, 400}}) {
      CameraOptions options;
      options.width = w;
      options.height = h;
      options.frame_all = true;
      if (orthographic) options.ortho = 1;
      const Camera camera = make_camera(options, scene);
      double fill = 0;
      std::mt19937 random(1);
      std::normal_distribution<double> normal;
      for (const Vec3d& center : centers) {
        for (int i = 0; i < 20000; ++i) {
          const Vec3d d = Vec3d(normal(random), normal(random), normal(random)).normalized();
          const Vec2d p = project(camera, center + radius * d);
          fill = std::max(
              {fill, std::abs(p.x() - w / 2.0) / (w / 2.0), std::abs(p.y() - h / 2.0) / (h / 2.0)});
        }
      }
      EXPECT_NEAR(fill, 0.95, 1e-3) << orthographic << " " << w;
    }
  }
}

TEST(Camera, DefaultSeesAPointAndAnEmptyScene) {
  EXPECT_TRUE(make_camera({}, {}).eye.allFinite());
  SceneExtent point;
  point.box.add(Vec3d(1e7, 2e7, 3e7));
  const Camera camera = make_camera({}, point);
  EXPECT_LT((project(camera, {1e7, 2e7, 3e7}) - Vec2d(256, 256)).norm(), 1e-3);
}

TEST(Camera, TurntableCirclesTheTarget) {
  const std::vector<Camera> cameras = turntable(front_view(), {}, 8);
  ASSERT_EQ(cameras.size(), 8U);
  for (const Camera& camera : cameras) {
    EXPECT_NEAR(camera.eye.norm(), 3, 1e-9);
    EXPECT_LT((project(camera, {0, 0, 0}) - Vec2d(256, 256)).norm(), 1e-6);
    EXPECT_LT(project(camera, {0, 0.1, 0}).y(), 256);
  }
  EXPECT_LT((cameras[2].eye - Vec3d(3, 0, 0)).norm(), 1e-9);
}

TEST(Camera, FromIsTheSideThatIsSeenAndZoomEnlarges) {
  SceneExtent scene;
  scene.box.add(Vec3d(-1, -1, -1));
  scene.box.add(Vec3d(3, 1, 1));
  CameraOptions options;
  options.from = Vec3d(2, 0, 0);
  const Camera camera = make_camera(options, scene);
  EXPECT_GT(camera.eye.x(), 3);
  EXPECT_NEAR(camera.eye.y(), 0, 1e-9);
  options.zoom = 4;
  const Camera near = make_camera(options, scene);
  EXPECT_EQ(near.eye, camera.eye);
  EXPECT_DOUBLE_EQ(near.focal_x, 4 * camera.focal_x);
}

TEST(Camera, UpAlongTheViewIsReplaced) {
  CameraOptions options = front_view();
  options.up = Vec3d(0, 0, 1);
  const Camera camera = make_camera(options, {});
  EXPECT_TRUE(camera.camera_from_world.allFinite());
  EXPECT_NEAR(camera.camera_from_world.determinant(), 1, 1e-12);
}

TEST(Camera, EyeOnTargetIsRefused) {
  CameraOptions options = front_view();
  options.eye = options.target;
  EXPECT_THROW(make_camera(options, {}), Error);
}

TEST(Camera, MatrixTakesWorldToCamera) {
  const Camera camera = make_camera(front_view(), {});
  const std::vector<float> m = world_to_camera_matrix(camera);
  const Vec3d p(0.3, -0.2, 0.7);
  const Vec3d q = camera.camera_from_world * (p - camera.eye);
  for (int row = 0; row < 3; ++row) {
    EXPECT_NEAR(
        m[4 * row] * p.x() + m[4 * row + 1] * p.y() + m[4 * row + 2] * p.z() + m[4 * row + 3],
        q[row], 1e-6);
  }
}

TEST(CameraOptions, DefaultsAreValidAndBadValuesAreRefused) {
  EXPECT_TRUE(CameraOptions{}.problems().empty());
  const auto refused = [](auto change) {
    CameraOptions options;
    change(options);
    return options.problems().size() == 1;
  };
  EXPECT_TRUE(refused([](CameraOptions& o) { o.fov = 180; }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.fov = std::nan(""); }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.ortho = 0; }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.width = 0; }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.near = -1; }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.zoom = 0; }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.from = Vec3d(0, 0, 0); }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.from = o.eye = Vec3d(0, 0, 1); }));
  EXPECT_TRUE(refused([](CameraOptions& o) { o.up = Vec3d(0, 0, 0); }));
}

TEST(CameraFile, ReadsOneOrManyViews) {
  const TemporaryFolder folder;
  const auto one =
      read_cameras(written(folder, "eye = [1, 2, 3]\nfov = 30\nsize = [64, 48]\n"), {});
  ASSERT_EQ(one.size(), 1U);
  EXPECT_EQ(*one[0].eye, Vec3d(1, 2, 3));
  EXPECT_EQ(one[0].fov, 30);
  EXPECT_EQ(one[0].height, 48);
  EXPECT_FALSE(one[0].target);
  const auto two =
      read_cameras(written(folder, "[[camera]]\northo = 2\n[[camera]]\nframe-all = true\n"), {});
  ASSERT_EQ(two.size(), 2U);
  EXPECT_EQ(two[0].ortho, 2);
  EXPECT_TRUE(two[1].frame_all);
}

TEST(CameraFile, ErrorsNameFileLineAndKey) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& text) {
    return message_of([&] { read_cameras(written(folder, text), {}); });
  };
  EXPECT_NE(error("fov = 40\nfovv = 3\n").find("line 2: unknown key fovv"), std::string::npos);
  EXPECT_NE(error("eye = [1, 2]\n").find("eye must be an array of 3 numbers"), std::string::npos);
  EXPECT_NE(error("eye = [1, 2\n").find("file.toml: line"), std::string::npos);
  EXPECT_NE(error("fov = 200\n").find("fov is 200"), std::string::npos);
  EXPECT_EQ(read_cameras(written(folder, "size = 48\n"), {}).front().width, 48);
  EXPECT_EQ(read_cameras(written(folder, "size = 48\n"), {}).front().height, 48);
  EXPECT_NE(error("size = 1.5\n").find("whole number"), std::string::npos);
  EXPECT_NE(error("size = [1e30, 2]\n").find("a whole number, or two"), std::string::npos);
  EXPECT_NE(message_of([&] { read_cameras(folder / "none.toml", {}); }).find("cannot be opened"),
            std::string::npos);
  EXPECT_NE(message_of([&] { read_cameras(folder / "", {}); }).find("is a directory"),
            std::string::npos);
  EXPECT_NE(message_of([&] { read_cameras("-", {}); }).find("name a file"), std::string::npos);
}

TEST(SceneFile, ReadsLightsAndMaterials) {
  const TemporaryFolder folder;
  const Scene scene = read_scene(written(folder,
                                         "ambient = [0.1, 0.2, 0.3]\n"
                                         "[[light]]\ntype = \"point\"\nposition = [1, 2, 3]\n"
                                         "[[material]]\nname = \"a\"\nopacity = 0.5\n"
                                         "[[material]]\nspecular = [1, 1, 1]\nshininess = 8\n"));
  EXPECT_EQ(scene.ambient, Vec3f(0.1F, 0.2F, 0.3F));
  ASSERT_EQ(scene.lights.size(), 1U);
  EXPECT_EQ(scene.lights[0].type, Light::Type::kPoint);
  ASSERT_EQ(scene.materials.size(), 2U);
  EXPECT_EQ(scene.materials[0].opacity, 0.5F);
  EXPECT_EQ(scene.materials[1].shininess, 8.0F);
  const Scene defaults = read_scene(written(folder, ""));
  EXPECT_EQ(defaults.lights.size(), Scene{}.lights.size());
  EXPECT_EQ(defaults.materials.size(), 1U);
}

TEST(SceneFile, ReadsASky) {
  const TemporaryFolder folder;
  const Scene scene = read_scene(
      written(folder, "[sky]\nup = [0, 0, 2]\ncolor = [0.3, 0.4, 0.5]\nground = [0.1, 0, 0]\n"));
  ASSERT_TRUE(scene.sky);
  EXPECT_EQ(scene.sky->up, Vec3d(0, 0, 2));
  EXPECT_EQ(scene.sky->color, Vec3f(0.3F, 0.4F, 0.5F));
  EXPECT_EQ(scene.sky->ground, Vec3f(0.1F, 0, 0));
  EXPECT_TRUE(scene.lights.empty());
  EXPECT_EQ(read_scene(written(folder, "[sky]\n[[light]]\ntype = \"headlight\"\n")).lights.size(),
            1U);
  EXPECT_FALSE(read_scene(written(folder, "")).sky);
  EXPECT_FALSE(read_scene(written(folder, "[sky]\ncolor = [1, 1, 1]\n")).sky->up);
  for (const char* wrong : {"up = [0, 0, 0]", "up = [nan, 0, 1]", "color = [-1, 0, 0]",
                            "ground = [0, 0, nan]", "colour = [1, 1, 1]"}) {
    EXPECT_THROW(read_scene(written(folder, std::string("[sky]\n") + wrong + "\n")), Error)
        << wrong;
  }
}

TEST(SceneFile, ReadsEnvironmentsAndWhatReflectsThem) {
  const TemporaryFolder folder;
  const Scene scene =
      read_scene(written(folder,
                         "refraction = \"single\"\n"
                         "[environment]\nimage = \"maps/day.exr\"\nintensity = 2\nrotation = -90\n"
                         "visible = false\n"
                         "[[material]]\nior = 1.5\ndispersion = 0.1\nabsorption = [0.1, 0.2, 0.3]\n"
                         "[[material]]\nreflectivity = [1, 0.7, 0.3]\nroughness = 0.25\n"
                         "[[material]]\nior = 2\nreflectivity = [0, 0, 0]\n"));
  EXPECT_EQ(scene.refraction, Refraction::kSingle);
  ASSERT_TRUE(scene.environment);
  EXPECT_EQ(scene.environment->image, folder / "maps/day.exr");
  EXPECT_EQ(scene.environment->intensity, 2.0F);
  EXPECT_EQ(scene.environment->rotation, -90.0F);
  EXPECT_FALSE(scene.environment->visible);
  EXPECT_EQ(scene.materials[0].ior, 1.5F);
  EXPECT_EQ(scene.materials[0].dispersion, 0.1F);
  EXPECT_EQ(scene.materials[0].absorption, Vec3f(0.1F, 0.2F, 0.3F));
  EXPECT_NEAR(scene.materials[0].reflectivity.y(), 0.04F, 1e-6F);
  EXPECT_FALSE(scene.materials[1].ior);
  EXPECT_EQ(scene.materials[1].reflectivity, Vec3f(1, 0.7F, 0.3F));
  EXPECT_EQ(scene.materials[1].roughness, 0.25F);
  EXPECT_TRUE(scene.materials[2].reflectivity.isZero());
  EXPECT_EQ(read_scene(written(folder, "[environment]\nimage = \"sky\"\n")).environment->image,
            "sky");
  const Scene defaults = read_scene(written(folder, "[[material]]\n"));
  EXPECT_FALSE(defaults.environment);
  EXPECT_EQ(defaults.refraction, Refraction::kMulti);
  EXPECT_TRUE(defaults.materials[0].reflectivity.isZero());
}

TEST(SceneFile, RefusesWhatItDoesNotKnow) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& text) {
    return message_of([&] { read_scene(written(folder, text)); });
  };
  EXPECT_NE(error("[[light]]\ntype = \"laser\"\n").find("laser"), std::string::npos);
  EXPECT_NE(error("[[material]]\nshine = 3\n").find("unknown key shine"), std::string::npos);
  EXPECT_NE(error("[[material]]\nopacity = 2\n").find("opacity is 2"), std::string::npos);
  EXPECT_NE(error("[[light]]\ntype = \"directional\"\ndirection = [0, 0, 0]\n").find("direction"),
            std::string::npos);
  EXPECT_NE(error("ambient = [nan, 0, 0]\n").find("finite"), std::string::npos);
  EXPECT_NE(error("[environment]\nrotation = 3\n").find("names no image"), std::string::npos);
  EXPECT_NE(error("[[environment]]\nimage = \"a\"\n").find("one table"), std::string::npos);
  for (const auto& [line, problem] : {std::pair{"ior = 9", "ior is 9"},
                                      {"ior = 0", "ior is 0"},
                                      {"dispersion = 0.1", "no ior"},
                                      {"roughness = -1", "roughness is -1"},
                                      {"roughness = nan", "roughness is nan"},
                                      {"reflectivity = [0, 2, 0]", "reflectivity holds 2"},
                                      {"reflectivity = 1", "array of 3 numbers"},
                                      {"absorption = [0, 0, -0.1]", "absorption holds -0.1"},
                                      {"eta = 1", "unknown key eta"}}) {
    const std::string message = error(std::string("[[material]]\n") + line + "\n");
    EXPECT_NE(message.find("file.toml: line 2"), std::string::npos) << message;
    EXPECT_NE(message.find(problem), std::string::npos) << message;
  }
  for (const auto& [line, problem] : {std::pair{"intensity = -1", "intensity is -1"},
                                      {"rotation = inf", "rotation is inf"},
                                      {"visible = 1", "true or false"},
                                      {"blur = 1", "unknown key blur"}}) {
    const std::string message =
        error(std::string("[environment]\nimage = \"a.exr\"\n") + line + "\n");
    EXPECT_NE(message.find("file.toml: line 3"), std::string::npos) << message;
    EXPECT_NE(message.find(problem), std::string::npos) << message;
  }
  const std::string message = error("refraction = \"double\"\n");
  EXPECT_NE(message.find("line 1: refraction \"double\""), std::string::npos) << message;
}

/// `count` times the text, one behind the other.
std::string repeated(std::size_t count, const std::string& text) {
  std::string all;
  for (std::size_t i = 0; i < count; ++i) all += text;
  return all;
}

TEST(SceneFile, RefusesDeepAndLargeTextsBeforeItParsesThem) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& text) {
    return message_of([&] { read_scene(written(folder, text)); });
  };
  const std::string key = repeated(100000, "a.") + "b";
  for (const std::string& deep :
       {key + " = 1\n", "[" + key + "]\n", "[[" + key + "]]\n",
        repeated(100000, "'a'.") + "b = 1\n", "a = {" + key + " = 1}\n",
        "a = [\"\"\"a\"\"\"\"\", {" + key + " = 1}]\n", "a = " + repeated(100000, "["),
        "a = " + repeated(100000, "{a = ")}) {
    const std::string message = error("ambient = [0, 0, 0]\n" + deep);
    EXPECT_NE(message.find("file.toml: line 2: keys of more than 32 parts"), std::string::npos)
        << deep.substr(0, 20) << message;
  }
  EXPECT_NE(error(repeated(5 << 20, "\n")).find("more than 4 MB of TOML"), std::string::npos);
  // Dots of strings, comments and numbers make nothing deep.
  const std::string path = repeated(100, "../");
  EXPECT_NE(error("# " + path + "\nlights = ['" + path + "', \"\\\"" + path + "\", '''" + path +
                  "''', " + repeated(100, "0.5, ") + "]\n")
                .find("file.toml: line 2: unknown key lights"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel::test
