// surfel-convert: formats, joined files, materials, places.

#include <algorithm>
#include <regex>
#include <sstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/color.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/coordinate_file.h>
#include <surfel/io/gaussian_io.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

class SurfelConvert : public testing::Test {
 protected:
  void SetUp() override {
    for (const auto& [kind, file] : {std::pair{"sphere", sphere_}, {"transparent", layers_}}) {
      ASSERT_EQ(
          run({tool("surfel-generate"), kind, "--count", "300", "-o", file, "--quiet"}).exit_code,
          0);
    }
  }
  RunResult convert(const Words& words, const std::string& output = "out.ply") const {
    Words command = {tool("surfel-convert"), "-o", folder_ / output};
    command.insert(command.end(), words.begin(), words.end());
    return run(command);
  }
  SurfelCloud converted(const Words& words, const std::string& output = "out.ply") const {
    const RunResult result = convert(words, output);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_cloud(folder_ / output);
  }

  TemporaryFolder folder_;
  std::string sphere_ = folder_ / "sphere.ply";
  std::string layers_ = folder_ / "layers.ply";
};

TEST_F(SurfelConvert, FieldsOfLasSayHowTheyHoldValues) {
  write_text(folder_ / "scan.ptx",
             "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
             "1 2 3 0.5\n2 2 3 1\n");
  const RunResult result = convert({folder_ / "scan.ptx"}, "scan.laz");
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_TRUE(contains(result.errors, "scan.laz: intensity: stored as the value times 65535"))
      << result.errors;
  EXPECT_EQ(convert({folder_ / "scan.ptx", "--quiet"}, "scan.laz").errors, "");
}

TEST_F(SurfelConvert, EveryFormatReadsBackTheSame) {
  const SurfelCloud cloud = read_cloud(sphere_);
  for (const auto& [output, options] :
       {std::pair{"a.ply", Words{}}, {"b.ply", {"--ascii"}}, {"c.pcd", {}}, {"d", {}}}) {
    Words words = options;
    words.push_back(sphere_);
    const SurfelCloud again = converted(words, output);
    EXPECT_EQ(again.position, cloud.position) << output;
    EXPECT_EQ(again.variance, cloud.variance) << output;
    EXPECT_EQ(again.color, cloud.color) << output;
    EXPECT_EQ(again.normal, cloud.normal) << output;
    EXPECT_EQ(again.provenance.size(), cloud.provenance.size() + 1) << output;
  }
  EXPECT_TRUE(contains(read_text(folder_ / "b.ply"), "format ascii"));
  EXPECT_TRUE(contains(read_text(folder_ / "c.pcd"), "DATA binary"));
  write_text(folder_ / "points.xyz", "0 0 1\n1 2 3\n");
  EXPECT_EQ(converted({folder_ / "points.xyz"}).position[1], Vec3f(1, 2, 3));
}

TEST_F(SurfelConvert, TextHoldsEveryColumnAndObjSaysWhatIsLost) {
  const SurfelCloud cloud = read_cloud(sphere_);
  for (const char* const output : {"a.xyz", "a.csv", "a.txt", "a.asc"}) {
    const SurfelCloud again = converted({sphere_}, output);
    EXPECT_EQ(again.position, cloud.position) << output;
    EXPECT_EQ(again.variance, cloud.variance) << output;
    EXPECT_EQ(again.color, cloud.color) << output;
    EXPECT_EQ(again.normal, cloud.normal) << output;
  }
  EXPECT_TRUE(read_text(folder_ / "a.csv").starts_with("x,y,z,nx,ny,nz,"));
  EXPECT_TRUE(read_text(folder_ / "a.xyz").starts_with("# x y z nx ny nz "));
  for (const char* const columns : {"normal", "color", "normal,color"}) {
    // Programs that know these columns often read no other lines.
    const SurfelCloud bare = converted({sphere_, "--keep-columns", columns}, "bare.xyz");
    EXPECT_NE(read_text(folder_ / "bare.xyz").front(), '#') << columns;
    EXPECT_EQ(bare.position, cloud.position) << columns;
    const bool no_color = columns == std::string("normal");
    const bool no_normal = columns == std::string("color");
    EXPECT_EQ(bare.color, no_color ? Array<Vec3f>() : cloud.color) << columns;
    EXPECT_EQ(bare.normal, no_normal ? Array<Vec3f>() : cloud.normal) << columns;
  }
  const RunResult obj = convert({sphere_}, "a.obj");
  EXPECT_EQ(obj.exit_code, 0) << obj.errors;
  EXPECT_TRUE(contains(obj.errors, "has no place for them: variance")) << obj.errors;
  const std::string text = read_text(folder_ / "a.obj");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 600);
  std::istringstream words(text);
  std::string v;
  Vec3f position;
  Vec3f color;
  words >> v >> position.x() >> position.y() >> position.z() >> color.x() >> color.y() >> color.z();
  EXPECT_EQ(v, "v");
  EXPECT_EQ(position, cloud.position[0]);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(color[c] * 255, linear_to_srgb8(cloud.color[0][c]), 0.5) << c;
  }
}

TEST_F(SurfelConvert, DecimalCoordinatesStayAsTheyAre) {
  // Millimetres of a country, in metres: more digits than a float has.
  std::string text = "x,y,z,time\n";
  for (int i = 0; i < 2000; ++i) {
    text += fmt::format("{}.{:03},{}.{:03},{}.{:03},{}.5\n", 455000 + i * 7 % 9000, i * 37 % 1000,
                        5401000 + i * 13 % 9000, i * 411 % 1000, 200 + i % 50, i * 17 % 1000,
                        300000000 + i);
  }
  // The shortest way to write them has no zeros at the end.
  text = std::regex_replace(text, std::regex(R"((\.\d*?)0+(,|\n))"), "$1$2");
  text = std::regex_replace(text, std::regex(R"(\.(,|\n))"), "$1");
  write_text(folder_ / "utm.csv", text);
  std::string from = folder_ / "utm.csv";
  for (const char* const output :
       {"utm.ply", "utm.las", "utm.laz", "utm.pcd", "utm.xyz", "again.csv"}) {
    // LAS has fields of its own.
    ASSERT_EQ(convert({from, "--keep-columns", "time"}, output).exit_code, 0) << output;
    from = folder_ / output;
  }
  EXPECT_EQ(read_text(folder_ / "again.csv"), text);
}

TEST_F(SurfelConvert, TakesPartsOfFiles) {
  const SurfelCloud cloud = read_cloud(sphere_);
  const SurfelCloud tenth = converted({sphere_, "--every", "10"});
  ASSERT_EQ(tenth.size(), 30U);
  EXPECT_EQ(tenth.position[3], cloud.position[30]);
  const SurfelCloud half = converted({sphere_, "--bounds=-9,-9,0,9,9,9", "--every", "2"});
  EXPECT_LT(half.size(), 100U);
  EXPECT_GT(half.size(), 50U);
  const SurfelCloud bare = converted({sphere_, "--keep-columns", "color,ny"});
  EXPECT_EQ(bare.color, cloud.color);
  EXPECT_EQ(bare.normal, cloud.normal);
  EXPECT_TRUE(bare.variance.empty());
  EXPECT_TRUE(bare.area.empty());
}

TEST_F(SurfelConvert, MatrixIsTheSameAsItsParts) {
  const SurfelCloud parts =
      converted({sphere_, "--scale", "2", "--rotate=0,0,1,90", "--translate=1,0,-3"});
  const SurfelCloud matrix = converted({sphere_, "--transform=0,-2,0,1,2,0,0,0,0,0,2,-3,0,0,0,1"});
  ASSERT_EQ(matrix.size(), parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i) {
    EXPECT_LT((matrix.world(i) - parts.world(i)).norm(), 1e-6);
    EXPECT_LT((matrix.normal[i] - parts.normal[i]).norm(), 1e-6F);
  }
  EXPECT_EQ(matrix.variance, parts.variance);
}

TEST_F(SurfelConvert, JoinsFilesWithMaterialsOfTheirOwn) {
  const std::string stats = folder_ / "stats.json";
  const SurfelCloud joined =
      converted({sphere_, layers_, "--material", "keep,3", "--stats", stats});
  ASSERT_EQ(joined.size(), 600U);
  EXPECT_EQ(joined.material[0], 0);
  EXPECT_EQ(joined.material[599], 3);
  EXPECT_EQ(joined.alpha[0], 1);
  EXPECT_LT(joined.alpha[599], 1);
  const auto report = nlohmann::json::parse(read_text(stats));
  EXPECT_EQ(report["surfels"], 600);
  EXPECT_EQ(report["inputs"][1]["surfels"], 300);
  EXPECT_TRUE(contains(report["filled"].dump(), "alpha"));

  const SurfelCloud apart = converted({sphere_, sphere_, layers_, "--separate-materials"});
  EXPECT_EQ(apart.material[299], 0);
  EXPECT_EQ(apart.material[300], 1);
  EXPECT_EQ(apart.material[899], 2);
  EXPECT_EQ(converted({sphere_, "--material", "7"}).material[5], 7);
  write_text(folder_ / "convert.toml", "material = \"1,2\"\n");
  EXPECT_EQ(converted({sphere_, layers_, "--config", folder_ / "convert.toml"}).material[300], 2);
}

TEST_F(SurfelConvert, SaysWhatItMadeUpAndLeftOut) {
  const std::string grouped = folder_ / "grouped_sphere.ply";
  ASSERT_EQ(run({tool("surfel-group"), sphere_, "-o", grouped, "--quiet"}).exit_code, 0);
  const RunResult result = convert({grouped, layers_});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_TRUE(contains(result.errors, "sphere.ply: has no alpha")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "not all files have them: group")) << result.errors;
}

TEST_F(SurfelConvert, JoinedFilesKeepTheirPlacesHoweverFarApart) {
  const SurfelCloud sphere = read_cloud(sphere_);
  const SurfelCloud far = converted({layers_, "--translate", "1e9,0,0"}, "far.ply");
  EXPECT_EQ(convert({sphere_, folder_ / "far.ply"}, "both.csv").exit_code, 0);
  std::istringstream lines(read_text(folder_ / "both.csv"));
  std::string line;
  std::getline(lines, line);
  for (std::size_t i = 0; i < 600; ++i) {
    ASSERT_TRUE(std::getline(lines, line));
    const double x = std::stod(line);
    EXPECT_EQ(x, (i < 300 ? sphere.world(i) : far.world(i - 300)).x()) << i;
  }
}

TEST_F(SurfelConvert, JoinedFilesAreConvertedInPieces) {
  // Two pieces of the first file, of which only the second tells that it has colours of 16 bits.
  constexpr int kPoints = (1 << 18) + 9000;
  std::string lines = "x,y,z,red,green,blue,intensity\n";
  for (int i = 0; i < kPoints; ++i) {
    lines += fmt::format("{},{},{},{},7,200,{}\n", i % 512, i / 512, i % 7,
                         i == kPoints - 1 ? 40000 : i % 256, i % 1000);
  }
  write_text(folder_ / "many.csv", lines);
  ASSERT_EQ(convert({folder_ / "many.csv"}, "many.las").exit_code, 0);
  write_text(folder_ / "few.csv", "x,y,z,confidence\n0.5,0,0,0.25\n1,0,0,0.75\n");
  const SurfelCloud many = read_cloud(folder_ / "many.las");
  ASSERT_EQ(convert({folder_ / "few.csv", folder_ / "many.las"}, "joined.las").exit_code, 0);
  const SurfelCloud joined = read_cloud(folder_ / "joined.las");
  ASSERT_EQ(joined.size(), many.size() + 2);
  EXPECT_EQ(joined.world(0), Vec3d(0.5, 0, 0));
  EXPECT_EQ(joined.color_encoding, ColorEncoding::kUint16Srgb);
  for (std::size_t i = 0; i < many.size(); i += 997) {
    ASSERT_EQ(joined.world(i + 2), many.world(i)) << i;
    ASSERT_EQ(joined.color[i + 2], many.color[i]) << i;
  }
  EXPECT_EQ(joined.color.back(), many.color.back());
  EXPECT_TRUE(std::any_of(joined.extra.begin(), joined.extra.end(),
                          [](const ExtraProperty& p) { return p.name == "confidence"; }));
}

TEST_F(SurfelConvert, JoinedScansKeepTheirViewpoints) {
  const auto scan = [&](const std::string& name, double x) {
    write_text(
        folder_ / name,
        fmt::format("2\n2\n{0} 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{0} 0 0 1\n"
                    "1 0 0 0.5\n1 1 0 0.5\n1 0 1 0.5\n1 1 1 0.5\n",
                    x));
    return read_text(folder_ / name);
  };
  write_text(folder_ / "two.ptx", scan("a.ptx", 3) + scan("b.ptx", 6));
  scan("c.ptx", 9);
  const SurfelCloud joined =
      converted({folder_ / "c.ptx", folder_ / "two.ptx", "--translate=0,0,1"});
  EXPECT_FALSE(joined.viewpoint.has_value());
  ASSERT_EQ(joined.scan_viewpoints.size(), 3U);
  const Array<Vec3d> sensors = joined.sensors();
  ASSERT_EQ(sensors.size(), 12U);
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(sensors[i], Vec3d(i < 4 ? 9 : i < 8 ? 3 : 6, 0, 1)) << i;
  }
  const RunResult picture =
      run({tool("surfel-render"), folder_ / "c.ptx", folder_ / "two.ptx", "--size", "32", "--keep",
           folder_ / "kept.ply", "-o", folder_ / "picture.png"});
  ASSERT_EQ(picture.exit_code, 0) << picture.errors;
  EXPECT_EQ(read_cloud(folder_ / "kept.ply").scan_viewpoints.size(), 3U);
  const RunResult unknown = convert({folder_ / "c.ptx", sphere_});
  EXPECT_TRUE(contains(unknown.errors, "no variance")) << unknown.errors;
  write_text(folder_ / "raw.xyz", "0 0 0\n1 0 0\n");
  const RunResult lost = convert({folder_ / "c.ptx", folder_ / "raw.xyz"});
  EXPECT_EQ(lost.exit_code, 0) << lost.errors;
  EXPECT_TRUE(contains(lost.errors, "has no viewpoints")) << lost.errors;
}

TEST_F(SurfelConvert, CoordinateSystemsGoFromFileToFile) {
  const auto system_of = [&](const std::string& name) {
    return read_coordinate_system(folder_ / name).value_or(CoordinateSystem{}).epsg;
  };
  for (const auto& [from, to] : {std::pair{sphere_, "a.las"},
                                 {folder_ / "a.las", "b.ply"},
                                 {folder_ / "b.ply", "c.pcd"},
                                 {folder_ / "c.pcd", "d.laz"}}) {
    Words words{from};
    if (from == sphere_) words.insert(words.end(), {"--epsg", "25832"});
    ASSERT_EQ(convert(words, to).exit_code, 0);
    EXPECT_EQ(system_of(to), 25832) << to;
  }
  EXPECT_EQ(read_cloud(folder_ / "d.laz").comments,
            std::vector<std::string>{"surfel_crs EPSG:25832"});
  ASSERT_EQ(convert({folder_ / "d.laz", "--epsg", "4326"}, "e.laz").exit_code, 0);
  EXPECT_EQ(system_of("e.laz"), 4326);
  EXPECT_EQ(read_cloud(folder_ / "e.laz").las->records.size(), 1U);
  ASSERT_EQ(convert({folder_ / "d.laz", "--translate=1,0,0"}, "f.laz").exit_code, 0);
  EXPECT_EQ(system_of("f.laz"), 0) << "moved points are in no system";
  ASSERT_EQ(convert({folder_ / "d.laz", folder_ / "e.laz"}, "g.laz").exit_code, 0);
  EXPECT_EQ(system_of("g.laz"), 0);
  EXPECT_EQ(convert({sphere_, "--epsg", "99999"}).exit_code, 2);
}

TEST_F(SurfelConvert, ColumnsOfTextAreNamed) {
  write_text(folder_ / "points.txt", "# x y z red green blue\n7 1 2 3 255 0\n8 4 5 6 0 255\n");
  const SurfelCloud cloud = converted({folder_ / "points.txt", "--columns", "time,x,y,z,r,-"});
  EXPECT_EQ(cloud.world(1), Vec3d(4, 5, 6));
  ASSERT_EQ(cloud.extra.size(), 2U) << "r alone is no colour";
  EXPECT_EQ(cloud.extra[0].name, "time");
  const RunResult few = convert({folder_ / "points.txt", "--columns", "x,y,z"});
  EXPECT_EQ(few.exit_code, 1);
  EXPECT_TRUE(contains(few.errors, "line 2: 6 values, and --columns names 3")) << few.errors;
  const RunResult other = convert({sphere_, "--columns", "x,y,z"});
  EXPECT_EQ(other.exit_code, 1);
  EXPECT_TRUE(contains(other.errors, "no text file")) << other.errors;
  for (const char* columns : {"x,y", "x,y,z,x", "x,y,,z"}) {
    EXPECT_EQ(convert({folder_ / "points.txt", "--columns", columns}).exit_code, 2) << columns;
  }
}

TEST_F(SurfelConvert, MovesFiles) {
  const SurfelCloud cloud = read_cloud(sphere_);
  const SurfelCloud moved =
      converted({sphere_, "--scale", "2", "--rotate=0,0,1,90", "--translate=1,0,-3"});
  for (std::size_t i = 0; i < 300; i += 37) {
    const Vec3f& p = cloud.position[i];
    const Vec3d expected(1 - 2 * static_cast<double>(p.y()), 2 * static_cast<double>(p.x()),
                         2 * static_cast<double>(p.z()) - 3);
    EXPECT_LT((moved.world(i) - expected).norm(), 1e-5);
    EXPECT_FLOAT_EQ(moved.variance[i], 4 * cloud.variance[i]);
  }
}

TEST_F(SurfelConvert, RefusesWhatMakesNoSense) {
  for (const Words& words : {Words{sphere_, "--material", "65536"},
                             {sphere_, "--material", "1,2"},
                             {sphere_, "--material", "-1"},
                             {sphere_, "--material", "a"},
                             {sphere_, "--material", "1,"},
                             {sphere_, "--material", "1", "--separate-materials"},
                             {sphere_, "--scale", "0"},
                             {sphere_, "--rotate=0,0,0,90"},
                             {sphere_, "--translate=1,2"},
                             {"-", "-"}}) {
    const RunResult result = convert(words);
    EXPECT_EQ(result.exit_code, 2) << words.back() << result.errors;
  }
  EXPECT_EQ(convert({sphere_}, "out.xyzn").exit_code, 2);
  for (const char* const matrix :
       {"1,0,0,0,0,1,0,0,0,0,1,0,0,0,1,1", "-1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1",
        "1,0.1,0,0,0,1,0,0,0,0,1,0,0,0,0,1", "0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,1"}) {
    EXPECT_EQ(convert({sphere_, std::string("--transform=") + matrix}).exit_code, 2) << matrix;
  }
  EXPECT_EQ(convert({sphere_, "--every", "0"}).exit_code, 2);
  EXPECT_EQ(convert({sphere_, "--keep-columns", "nx,,ny"}).exit_code, 2);
  const RunResult unknown = convert({sphere_, "--keep-columns", "intensity"});
  EXPECT_EQ(unknown.exit_code, 1);
  EXPECT_TRUE(contains(unknown.errors, "no column 'intensity' to keep")) << unknown.errors;
  EXPECT_EQ(convert({sphere_, "--ascii"}, "out.pcd").exit_code, 2);
  write_text(folder_ / "points.xyz", "0 0 1\n1 2 3\n");
  const RunResult sizeless = convert({sphere_, folder_ / "points.xyz"});
  EXPECT_EQ(sizeless.exit_code, 1);
  EXPECT_TRUE(contains(sizeless.errors, "points.xyz: has no variance")) << sizeless.errors;
  EXPECT_EQ(entries(folder_ / ""), (Words{"layers.ply", "points.xyz", "sphere.ply"}));
}

TEST_F(SurfelConvert, AlignsOverlappingScansAndTellsTheirPoses) {
  const std::string first = folder_ / "first.ply";
  const std::string moved = folder_ / "moved.ply";
  ASSERT_EQ(run({tool("surfel-generate"), "terrain", "--count", "5000", "-o", first, "--quiet"})
                .exit_code,
            0);
  ASSERT_EQ(convert({first, "--rotate", "1,2,3,2", "--translate", "0.02,0.01,-0.02"}, "moved.ply")
                .exit_code,
            0);
  const std::string stats = folder_ / "stats.json";
  const RunResult result = convert({first, moved, "--align", "--stats", stats});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "first.ply: stays;")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "moved.ply: turned by 2 degrees,")) << result.errors;
  const auto align = nlohmann::json::parse(read_text(stats))["align"];
  EXPECT_EQ(align["converged"], true);
  EXPECT_EQ(align["scans"][0]["rotation"], nlohmann::json({1.0, 0.0, 0.0, 0.0}));
  // Both files hold the same points: they are back in their places.
  const SurfelCloud joined = read_cloud(folder_ / "out.ply");
  ASSERT_EQ(joined.size(), 10000U);
  for (std::size_t i = 0; i < 5000; ++i) {
    EXPECT_LT((joined.position[i] - joined.position[5000 + i]).norm(), 1e-4F);
  }

  const auto refused = [&](const Words& words, int exit_code, const std::string& message) {
    const RunResult run = convert(words, "no.ply");
    EXPECT_EQ(run.exit_code, exit_code) << run.errors;
    EXPECT_TRUE(contains(run.errors, message)) << run.errors;
  };
  refused({first, "--align"}, 2, "--align needs two files or more");
  refused({first, moved, "--align-reach", "1"}, 2, "--align-reach has no effect without --align");
  refused({first, moved, "--align", "--align-reach", "-1"}, 2, "--align-reach is -1;");
  ASSERT_EQ(convert({first, "--translate", "9,0,0"}, "moved.ply").exit_code, 0);
  refused({first, moved, "--align"}, 1, "moved.ply: does not overlap");
}

TEST_F(SurfelConvert, SurfelsBecomeSplats) {
  const SurfelCloud cloud = read_cloud(sphere_);
  for (const auto& [output, options] :
       {std::pair{"a.splat", Words{}}, {"a.ply", {"--gaussians"}}, {"b", {"--gaussians"}}}) {
    Words words = options;
    words.insert(words.end(), {sphere_, "--translate", "1,0,0"});
    const RunResult result = convert(words, output);
    ASSERT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(contains(result.errors, "300 Gaussians")) << result.errors;
    const GaussianCloud splats = read_gaussians(folder_ / output);
    ASSERT_EQ(splats.size(), cloud.size());
    EXPECT_LT((splats.position[7] - cloud.position[7] - Vec3f(1, 0, 0)).norm(), 1e-6F);
    EXPECT_NEAR(splats.scale[7][0], std::sqrt(cloud.variance[7]), 1e-6);
    EXPECT_TRUE(splats.amplitude[7] > 0.5F && splats.amplitude[7] < 1);
  }
  ASSERT_EQ(convert({sphere_, layers_}, "two.usda").exit_code, 0);
  EXPECT_TRUE(contains(read_text(folder_ / "two.usda"), "GaussianSurfletAPI"));
}

TEST_F(SurfelConvert, SplatsAreMovedAndConverted) {
  ASSERT_EQ(convert({sphere_}, "a.splat").exit_code, 0);
  const std::string splats = folder_ / "a.splat";
  const RunResult result = convert({splats, "--rotate", "1,0,0,180", "--scale", "2"}, "b.ply");
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(read_text(folder_ / "b.ply"), "comment surfel_provenance surfel-convert"));
  const GaussianCloud before = read_gaussians(splats);
  const GaussianCloud after = read_gaussians(folder_ / "b.ply");
  ASSERT_EQ(after.size(), before.size());
  const Vec3f& p = before.position[3];
  EXPECT_LT((after.position[3] - 2 * Vec3f(p[0], -p[1], -p[2])).norm(), 1e-5F);
  EXPECT_NEAR(after.scale[3][1], 2 * before.scale[3][1], 1e-6F * after.scale[3][1]);
}

TEST_F(SurfelConvert, WhatSplatsCannotBeIsRefused) {
  ASSERT_EQ(convert({sphere_}, "a.splat").exit_code, 0);
  const std::string splats = folder_ / "a.splat";
  for (const auto& [words, output] : {std::pair{Words{splats}, "b.pcd"},
                                      {Words{splats, sphere_}, "b.ply"},
                                      {Words{splats, "--every", "2"}, "b.ply"},
                                      {Words{sphere_, "--gaussians"}, "b.pcd"},
                                      {Words{sphere_, "--ascii"}, "b.splat"}}) {
    const RunResult result = convert(words, output);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(folder_ / output)) << output;
  }
  write_text(folder_ / "points.xyz", "0 0 1\n1 2 3\n");
  const RunResult result = convert({folder_ / "points.xyz"}, "b.splat");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "has no variances")) << result.errors;
  write_text(folder_ / "cut.splat", read_text(splats).substr(0, 100));
  EXPECT_EQ(convert({folder_ / "cut.splat"}, "b.ply").exit_code, 1);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "b.ply"));
}

}  // namespace
}  // namespace surfel::test
