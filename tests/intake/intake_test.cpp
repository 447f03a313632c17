#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/random.h>
#include <surfel/intake/intake.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/image.h>
#include <surfel/texture/texture_source.h>
#include <surfel/truth/mesh_renderer.h>

#include "render/scenes.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A unit square with a texture that is red below and white above, and points of a plane.
class IntakeFiles : public testing::Test {
 protected:
  void SetUp() override {
    write_text(mesh_,
               "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\n"
               "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
    write_text(folder_ / "m.mtl", "newmtl m\nmap_Kd image.png\n");
    Image image = rgba_image(8, 8);
    for (int y = 0; y < 8; ++y) {
      for (int x = 0; x < 8; ++x) {
        const float upper = y < 4 ? 1 : 0;
        const float color[] = {1, upper, upper, 1};
        std::copy_n(color, 4, image.pixel(x, y));
      }
    }
    write_image(image, folder_ / "image.png");
    std::string points;
    for (int i = 0; i < 100; ++i) {
      points += std::to_string(i % 10) + ' ' + std::to_string(i / 10) + " 5\n";
    }
    write_text(points_, points);
  }
  TemporaryFolder folder_;
  std::string mesh_ = folder_ / "m.obj";
  std::string points_ = folder_ / "points.xyz";
};

TEST_F(IntakeFiles, MeshesAreSampledAndTextured) {
  Intake intake({mesh_});
  // The fifth vertex is in no face.
  EXPECT_EQ(intake.bounds().max, Vec3d(1, 1, 0));
  const Intake::Made made = intake.surfels(0.0501234);
  ASSERT_GT(made.cloud.size(), 300U);
  ASSERT_EQ(made.cloud.coefficient.size(), made.cloud.size());
  for (std::size_t i = 0; i < made.cloud.size(); ++i) {
    const double y = made.cloud.world(i).y();
    // Texels are interpolated, to the other side of the repeated image as well, and filtered.
    if (std::abs(y - 0.5) < 0.2 || std::abs(y - 0.5) > 0.35) continue;
    EXPECT_NEAR(made.cloud.coefficient[i].y(), y > 0.5 ? 1 : 0, 0.1) << y;
    EXPECT_NEAR(made.cloud.color[i].x(), 1, 1e-4);
  }
  ASSERT_EQ(made.commands.size(), 2U);
  EXPECT_TRUE(contains(made.commands[0], "--spacing 0.0501 ")) << made.commands[0];
  EXPECT_TRUE(contains(made.commands[1], "surfel-texture m-surfels.ply")) << made.commands[1];
  EXPECT_EQ(made.file, "m-textured.ply");
  ASSERT_EQ(made.done.size(), 1U);
  EXPECT_TRUE(contains(made.done[0], mesh_)) << made.done[0];
}

TEST_F(IntakeFiles, TexturesCloseByAreThoseOfRays) {
  // Twenty pixels a texel, one, and a quarter of one; noise, so that all waves count.
  const Camera camera = test::square_camera(80);
  for (const int texels : {4, 80, 320}) {
    Image image = rgba_image(texels, texels);
    for (std::size_t i = 0; i < image.data.size(); ++i) {
      image.data[i] = i % 4 == 3 ? 1 : static_cast<float>(random_uniform(58, i, 0));
    }
    const std::string name = folder_ / "noise.exr";
    write_image(image, name);
    write_text(mesh_,
               "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
               "f 1/1 2/2 3/3 4/4\n");
    const TriangleMesh mesh = read_mesh(mesh_);
    TextureSet textures = load_textures({.image = name}, &mesh, mesh_);
    MeshRenderOptions rays;
    rays.samples = 6;
    rays.lit = false;
    const Scene scene;
    const Image truth = MeshRenderer(mesh, &textures, scene, rays).render(camera);
    RenderOptions options;
    options.lit = false;
    for (const double cutoff : {1.0, 2.0}) {
      const Intake::Made made =
          Intake({mesh_}).surfels(0.5 * 2 / 80, {.image = name, .cutoff = cutoff});
      RenderCloud surfels(made.cloud);
      options.cutoff = cutoff;
      const Image drawn = Renderer(surfels, scene, options).render(camera);
      double square = 0;
      int count = 0;
      for (int y = 5; y < 75; ++y) {
        for (int x = 5; x < 75; ++x) {
          for (int c = 0; c < 3; ++c, ++count) {
            square += std::pow(drawn.pixel(x, y)[c] - truth.pixel(x, y)[c], 2);
          }
        }
      }
      EXPECT_GT(-10 * std::log10(square / count), 42) << texels << " texels, cutoff " << cutoff;
    }
  }
}

TEST_F(IntakeFiles, PrefilterMakesUpForTruncatedKernels) {
  // (h^2 - k (h^2 + V)) / V of V = (0.7 / 2)^2 pixels^2, k = 1 - c / (e^c - 1).
  const auto command = [&](const IntakeOptions& options) {
    return Intake({mesh_}).surfels(0.05, options).commands.at(1);
  };
  EXPECT_TRUE(contains(command({}), "--prefilter=4 "));  // 4.33, bounded.
  EXPECT_TRUE(contains(command({.cutoff = 2}), "--prefilter=1.9 "));
  EXPECT_TRUE(contains(command({.lowpass = 0.5}), "--prefilter=0.77 "));
  EXPECT_TRUE(contains(command({.nearest = 0.7}), "--prefilter=1.9 "));
  EXPECT_TRUE(contains(command({.nearest = 0.05}), "--prefilter=0.5 "));
}

TEST_F(IntakeFiles, SamplesOfTrianglesBehindEachOtherAreBounded) {
  // Halves of unit squares above each other, in a unit cube, whose surface is 6.
  const auto stack = [&](const std::string& name, int floors) {
    std::string text;
    for (int i = 0; i < floors; ++i) {
      const std::string z = std::to_string(static_cast<double>(i) / (floors - 1));
      text += "v 0 0 " + z + "\nv 1 0 " + z + "\nv 0 1 " + z + "\nf -3 -2 -1\n";
    }
    write_text(folder_ / name, text);
    return folder_ / name;
  };
  const double spacing = 0.05;
  const Intake::Made made = Intake({stack("few.obj", 100)}).surfels(spacing);
  // Instead of 50 / spacing^2: 4 / 8.33 of 4 times the cube's surface.
  EXPECT_NEAR(static_cast<double>(made.cloud.size()) * spacing * spacing, 11.5, 2.5);
  EXPECT_TRUE(contains(made.done[0], "8.33 times the area of the box")) << made.done[0];
  const std::string many = stack("many.obj", 3200);
  const std::string message = message_of([&] { Intake({many}).surfels(spacing); });
  EXPECT_EQ(message.find(many + ": its triangles have 267 times the area"), 0U) << message;
}

TEST_F(IntakeFiles, SamplesOfNeedlesAreBounded) {
  // A unit disc of needles around its centre, in a flat box, whose surface is 8.
  constexpr int kNeedles = 2000;
  std::string text = "v 0 0 0\n";
  for (int i = 0; i <= kNeedles; ++i) {
    const double angle = 2 * std::numbers::pi * i / kNeedles;
    text += "v " + std::to_string(std::cos(angle)) + " " + std::to_string(std::sin(angle)) + " 0\n";
    if (i > 0) text += "f 1 -2 -1\n";
  }
  write_text(folder_ / "fan.obj", text);
  const double spacing = 0.02;
  const Intake::Made made = Intake({folder_ / "fan.obj"}).surfels(spacing);
  // Instead of 3.14 / spacing^2, and as the command that is told makes them.
  EXPECT_NEAR(static_cast<double>(made.cloud.size()) * spacing * spacing, 0.25 * 8, 0.02);
  EXPECT_TRUE(contains(made.done[0], "0.0251 as its triangles are long and thin")) << made.done[0];
  EXPECT_TRUE(contains(made.commands[0], "--spacing 0.0251 ")) << made.commands[0];
}

TEST_F(IntakeFiles, PointsAreEstimated) {
  Intake intake({points_});
  const Intake::Made made = intake.surfels(1);
  ASSERT_EQ(made.cloud.size(), 100U);
  ASSERT_EQ(made.cloud.normal.size(), 100U);
  EXPECT_NEAR(std::abs(made.cloud.normal[55].z()), 1, 1e-5);
  EXPECT_EQ(made.file, "points-surfels.ply");
}

TEST_F(IntakeFiles, MorePointsThanAPictureShowsAreAveraged) {
  // A square of 1050 points a side, and one point far away.
  constexpr int kSide = 1050;
  SurfelCloud cloud;
  for (int i = 0; i < kSide * kSide; ++i) {
    cloud.position.emplace_back(static_cast<float>(i % kSide), static_cast<float>(i / kSide), 0.0F);
  }
  cloud.position.emplace_back(-1e6F, 0.0F, 0.0F);
  const std::string file = folder_ / "many.ply";
  write_cloud(cloud, file);
  Intake intake({file});
  EXPECT_LE(intake.bounds().diagonal(), std::hypot(kSide, kSide));
  EXPECT_GT(intake.bounds().diagonal(), 0.9 * std::hypot(kSide, kSide));
  const Intake::Made made = intake.surfels(20);
  EXPECT_EQ(made.cloud.size(), 105U * 105 + 1);
  EXPECT_TRUE(contains(made.commands.at(0), " --voxel 10 ")) << made.commands.at(0);
  EXPECT_TRUE(contains(made.done.at(0), "averaged in cells of 10")) << made.done.at(0);
}

TEST_F(IntakeFiles, ViewpointAndNormalsOfTheFileTellTheSide) {
  SurfelCloud raw = Intake({points_}).surfels(1).cloud;
  raw.variance.clear();
  for (const float side : {-1.0F, 1.0F}) {
    raw.normal.assign(raw.size(), Vec3f(0, 0, side));
    raw.viewpoint.reset();
    const std::string file = folder_ / "sided.ply";
    write_cloud(raw, file);
    const Intake::Made aligned = Intake({file}).surfels(1);
    EXPECT_NEAR(aligned.cloud.normal[55].z(), side, 1e-5);
    EXPECT_TRUE(contains(aligned.commands[0], "--orient align")) << aligned.commands[0];
    raw.viewpoint = Viewpoint{.position = Vec3d(5, 5, 5 - 20.0 * static_cast<double>(side))};
    write_cloud(raw, file);
    const Intake::Made seen = Intake({file}).surfels(1);
    EXPECT_NEAR(seen.cloud.normal[55].z(), -side, 1e-5);
    EXPECT_TRUE(contains(seen.commands[0], "--orient viewpoint")) << seen.commands[0];
  }
}

TEST_F(IntakeFiles, SurfelsStayAndSeveralFilesAreJoined) {
  const std::string surfels = folder_ / "s.ply";
  SurfelCloud cloud = Intake({points_}).surfels(1).cloud;
  write_cloud(cloud, surfels);
  Intake::Made alone = Intake({surfels}).surfels(1);
  EXPECT_TRUE(alone.done.empty());
  EXPECT_TRUE(alone.commands.empty());
  EXPECT_EQ(alone.file, surfels);
  EXPECT_EQ(alone.cloud.size(), cloud.size());
  const Intake::Made all = Intake({surfels, mesh_, points_}).surfels(0.1);
  EXPECT_EQ(all.file, "joined-surfels.ply");
  EXPECT_EQ(all.done.size(), 3U);
  EXPECT_GT(all.cloud.size(), 200U);
  EXPECT_TRUE(contains(all.commands.back(), "m-textured.ply points-surfels.ply -o joined"))
      << all.commands.back();
}

TEST_F(IntakeFiles, TellsSurfelsByTheirHeader) {
  const std::string surfels = folder_ / "s.ply";
  write_cloud(Intake({points_}).surfels(1).cloud, surfels);
  EXPECT_TRUE(holds_surfels(surfels));
  EXPECT_FALSE(holds_surfels(mesh_));
  EXPECT_FALSE(holds_surfels(points_));
  const std::string raw = folder_ / "raw.ply";
  write_text(raw,
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
             "property float z\nend_header\n0 0 0\n");
  EXPECT_FALSE(holds_surfels(raw));
  EXPECT_THROW(holds_surfels(folder_ / "nowhere.ply"), Error);
}

TEST_F(IntakeFiles, PicturesAreRefused) {
  const std::string message = message_of([&] { Intake({folder_ / "image.png"}); });
  EXPECT_TRUE(contains(message, "image.png")) << message;
  EXPECT_TRUE(contains(message, "picture")) << message;
}

}  // namespace
}  // namespace surfel::test
