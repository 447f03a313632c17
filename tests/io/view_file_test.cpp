#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/colmap.h>
#include <surfel/io/view_file.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/view.h>

#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

/// A camera that no axis, middle or square pixel makes special.
Camera known_camera() {
  CameraOptions options;
  options.eye = Vec3d(1.2, 0.9, 2.1);
  options.target = Vec3d(0.1, 0.2, -0.3);
  options.width = 640;
  options.height = 480;
  Camera camera = make_camera(options, {});
  camera.focal_x = 700.5;
  camera.focal_y = 690.25;
  camera.center_x = 330.5;
  camera.center_y = 231.75;
  return camera;
}

Vec3d translation_of(const Camera& camera) { return -(camera.camera_from_world * camera.eye); }

std::string written(const TemporaryFolder& folder, const std::string& name,
                    const std::string& text) {
  const std::string path = folder / name;
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

std::string rows_of(const Eigen::MatrixXd& m) {
  std::string text;
  for (int row = 0; row < m.rows(); ++row) {
    text += row == 0 ? "[" : ",\n [";
    for (int column = 0; column < m.cols(); ++column) {
      text += fmt::format("{}{}", column == 0 ? "" : ", ", m(row, column));
    }
    text += "]";
  }
  return "[" + text + "]";
}

Eigen::Matrix4d camera_to_world(const Camera& camera) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = camera.camera_from_world.transpose();
  matrix.topRightCorner<3, 1>() = camera.eye;
  return matrix;
}

/// The same in the axes of OpenGL.
Eigen::Matrix4d gl_camera_to_world(const Camera& camera) {
  return camera_to_world(camera) * Eigen::Vector4d(1, -1, -1, 1).asDiagonal();
}

std::string quaternion_of(const Camera& camera) {
  const Eigen::Quaterniond q(camera.camera_from_world);
  const Vec3d t = translation_of(camera);
  return fmt::format("{} {} {} {} {} {} {}", q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z());
}

constexpr const char* kCameras =
    "# Cameras\n1 PINHOLE 640 480 700.5 690.25 330.5 231.75\n"
    "2 SIMPLE_RADIAL 64 48 50 32 24 0\n";

class Binary {
 public:
  template <class T>
  Binary& add(T value) {
    text_.append(reinterpret_cast<const char*>(&value), sizeof(value));
    return *this;
  }
  Binary& add_text(const std::string& text) {
    text_.append(text.c_str(), text.size() + 1);
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::string binary_cameras() {
  Binary bytes;
  bytes.add(std::uint64_t{1}).add(std::uint32_t{1}).add(1);
  bytes.add(std::uint64_t{640}).add(std::uint64_t{480});
  for (const double value : {700.5, 690.25, 330.5, 231.75}) bytes.add(value);
  return bytes.text();
}

std::string binary_images(const Camera& camera) {
  Binary bytes;
  const Eigen::Quaterniond q(camera.camera_from_world);
  const Vec3d t = translation_of(camera);
  bytes.add(std::uint64_t{1}).add(std::uint32_t{9});
  for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) bytes.add(value);
  bytes.add(std::uint32_t{1}).add_text("a.jpg").add(std::uint64_t{1});
  return bytes.add(1.0).add(2.0).add(std::int64_t{-1}).text();
}

void expect_known(const View& view, const Camera& expected) {
  const Camera& camera = view.camera;
  EXPECT_LT((camera.camera_from_world - expected.camera_from_world).norm(), 1e-12);
  EXPECT_LT((camera.eye - expected.eye).norm(), 1e-12);
  EXPECT_EQ(camera.width, expected.width);
  EXPECT_EQ(camera.height, expected.height);
  EXPECT_NEAR(camera.focal_x, expected.focal_x, 1e-9);
  EXPECT_NEAR(camera.focal_y, expected.focal_y, 1e-9);
  EXPECT_EQ(camera.center_x, expected.center_x);
  EXPECT_EQ(camera.center_y, expected.center_y);
}

TEST(Views, OneCameraIsTheSameInEveryConvention) {
  const TemporaryFolder folder;
  const Camera camera = known_camera();
  const std::string sizes = R"("w": 640, "h": 480, "cx": 330.5, "cy": 231.75, )";
  const auto transforms = [&](const std::string& shared, const std::string& own,
                              const Eigen::MatrixXd& matrix) {
    return fmt::format(
        R"({{{} "frames": [{{{} "file_path": "./images/a.jpg", "transform_matrix": {}}}]}})",
        shared, own, rows_of(matrix));
  };
  const std::string intrinsics = R"("width": 640, "height": 480, "fx": 700.5, "fy": 690.25,
                                    "cx": 330.5, "cy": 231.75, )";
  Eigen::Matrix4d moved = Eigen::Matrix4d::Identity();
  moved.topRows<3>() << 0, 1, 0, 0.5, 1, 0, 0, 1, 0, 0, -1, 2;
  const std::vector<std::pair<std::string, std::string>> files{
      {"nerf.json",
       transforms(sizes + R"("fl_x": 700.5, "fl_y": 690.25,)", "", gl_camera_to_world(camera))},
      {"own.json", transforms("", sizes + R"("fl_x": 700.5, "fl_y": 690.25,)",
                              gl_camera_to_world(camera).topRows(3))},
      {"angles.json",
       transforms(sizes + fmt::format(R"("camera_angle_x": {}, "camera_angle_y": {},)",
                                      2 * std::atan(320 / 700.5), 2 * std::atan(240 / 690.25)),
                  "", gl_camera_to_world(camera))},
      {"k.json", fmt::format(R"([{{"width": 640, "height": 480, "intrinsics": [[700.5, 0, 330.5],
                       [0, 690.25, 231.75], [0, 0, 1]], "world_to_camera": {}}}])",
                             rows_of(camera_to_world(camera).inverse()))},
      {"gl.json", fmt::format(R"({{{} "axes": "opengl", "name": "a", "camera_to_world": {}}})",
                              intrinsics, rows_of(gl_camera_to_world(camera)))},
      {"list.json", fmt::format(R"({{"views": [{{{} "camera_to_world": {}}}]}})", intrinsics,
                                rows_of(camera_to_world(camera)))},
      {"gaussians.json",
       fmt::format(R"([{{{} "id": 0, "img_name": "a", "position": [{}, {}, {}], "rotation": {}}}])",
                   intrinsics, camera.eye.x(), camera.eye.y(), camera.eye.z(),
                   rows_of(camera.camera_from_world.transpose()))},
  };
  for (const auto& [name, text] : files) {
    SCOPED_TRACE(name);
    const std::vector<View> views = read_views(written(folder, name, text));
    ASSERT_EQ(views.size(), 1U);
    expect_known(views[0], camera);
  }
  // nerfstudio moved the world, and mirrored none of it.
  const std::string applied =
      written(folder, "moved.json",
              transforms(sizes + R"("fl_x": 700.5, "fl_y": 690.25, "applied_transform": )" +
                             rows_of(moved.topRows(3)) + ",",
                         "", moved * gl_camera_to_world(camera)));
  expect_known(read_views(applied, {.original_world = true})[0], camera);
  EXPECT_GT((read_views(applied)[0].camera.eye - camera.eye).norm(), 0.1);
}

TEST(Views, ColmapIsReadAsTextAndAsBinary) {
  const TemporaryFolder folder;
  const Camera camera = known_camera();
  // The points of an image may be missing, which leaves an empty line.
  const std::string images = fmt::format(
      "# Images\n4 {0} 1 b c.jpg\n\n2 {0} 1 a.jpg\r\n1 2 -1\r\n7 1 0 0 0 0 0 0 2 z.jpg\n",
      quaternion_of(camera));
  written(folder, "text/cameras.txt", kCameras);
  written(folder, "text/images.txt", images);
  const std::vector<View> text = read_views(folder / "text");
  ASSERT_EQ(text.size(), 3U);
  EXPECT_EQ(text[0].name, "a.jpg");
  EXPECT_EQ(text[1].name, "b c.jpg");
  expect_known(text[0], camera);
  expect_known(text[1], camera);
  EXPECT_EQ(text[2].camera.width, 64);
  EXPECT_EQ(text[2].camera.focal_y, 50);

  written(folder, "binary/sparse/0/cameras.bin", binary_cameras());
  written(folder, "binary/sparse/0/images.bin", binary_images(camera));
  written(folder, "binary/sparse/0/rigs.bin", "not read");
  const std::vector<View> binary = read_views(folder / "binary");
  ASSERT_EQ(binary.size(), 1U);
  EXPECT_EQ(binary[0].name, "a.jpg");
  expect_known(binary[0], camera);
}

TEST(Views, ColmapIsRefusedWithThePlaceOfTheFault) {
  const TemporaryFolder folder;
  const Camera camera = known_camera();
  const auto text = [&](const std::string& cameras, const std::string& images) {
    written(folder, "f/cameras.txt", cameras);
    written(folder, "f/images.txt", images);
    return message_of([&] { read_colmap(folder / "f"); });
  };
  const std::string image = "1 1 0 0 0 0 0 0 1 a.jpg\n\n";
  for (const auto& [cameras, images, expected] : std::vector<std::array<std::string, 3>>{
           {"1 FOV 8 8 9 9 4 4 0.1\n", image, "colmap image_undistorter"},
           {"\n1 THIN_PRISM_FISHEYE 8 8 9 9 4 4 0 0 0 0 0 0 0 0\n", image,
            "line 2: the camera model"},
           {"1 PINHOLES 8 8 9 9 4 4\n", image, "'PINHOLES' is not known"},
           {"1 PINHOLE 8 8 9 9 4\n", image, "cameras.txt: line 1: a parameter"},
           {"1 PINHOLE 8 8 9 9 4 4 4\n", image, "more than the 4 parameters of PINHOLE"},
           {"1 PINHOLE 8 0 9 9 4 4\n", image, "8x0"},
           {"1 PINHOLE 8 8 0 9 4 4\n", image, "focal lengths"},
           {"1 PINHOLE 8 8 9 9 4 4\n1 PINHOLE 8 8 9 9 4 4\n", image, "two cameras 1"},
           {"2 PINHOLE 8 8 9 9 4 4\n", image, "images.txt: line 1: there is no camera 1"},
           {"1 PINHOLE 8 8 9 9 4 4\n", "", "holds no image"},
           {"1 PINHOLE 8 8 9 9 4 4\n", image + "2 1 1 0 0 0 0 0 1 b\n", "line 3: the rotation"},
           {"1 PINHOLE 8 8 9 9 4 4\n", "1 1 0 0 0 0 0 x 1 b\n", "line 1: a number of the pose"},
           {"1 PINHOLE 8 8 9 9 4 4\n", "1 1 0 0 0 0 0 0 1\n", "line 1: the image has no name"}}) {
    const std::string message = text(cameras, images);
    EXPECT_NE(message.find(expected), std::string::npos) << expected << "\n" << message;
  }
  EXPECT_NE(message_of([&] { read_views(folder / ""); }).find("neither cameras.bin"),
            std::string::npos);

  const std::string cameras = binary_cameras();
  const std::string images = binary_images(camera);
  const auto binary = [&](const std::string& c, const std::string& i) {
    const auto bytes = [](const std::string& s) { return std::as_bytes(std::span(s)); };
    return message_of([&] {
      read_colmap(InputFile("cameras.bin", bytes(c)), InputFile("images.bin", bytes(i)));
    });
  };
  EXPECT_EQ(binary(cameras, images), "");
  for (std::size_t size = 0; size < images.size(); ++size) {
    EXPECT_NE(binary(cameras, images.substr(0, size)).find("images.bin: "), std::string::npos);
  }
  for (std::size_t size = 0; size < cameras.size(); ++size) {
    EXPECT_NE(binary(cameras.substr(0, size), images).find("cameras.bin: "), std::string::npos);
  }
  std::string many = images;
  many[7] = '\x7f';
  EXPECT_NE(binary(cameras, many).find("promises"), std::string::npos) << binary(cameras, many);
  EXPECT_NE(binary(cameras, images + "x").find("bytes follow"), std::string::npos);
}

TEST(Views, JsonIsRefusedWithThePlaceOfTheFault) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& text) {
    return message_of([&] { read_views(written(folder, "views.json", text)); });
  };
  const std::string unit = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
  const std::string size = R"("w": 8, "h": 8, "fl_x": 9)";
  const auto frame = [&](const std::string& members) {
    return error("{" + size + ", \"frames\": [{" + members + "}]}");
  };
  for (const auto& [message, expected] : std::vector<std::pair<std::string, std::string>>{
           {error("[1,\n2"), "line 2: is not valid JSON at the file's end"},
           {error("[1,\n2}"), "line 2: is not valid JSON"},
           {error("[1e999]"), "beyond all bounds"},
           {error("3"), "must be an array of views"},
           {error("[]"), "array of views"},
           {error("[{\"width\": 8}]"), "[0] must have width and height"},
           {error("[{\"width\": 1.5}]"), "[0].width is 1.5"},
           {error(R"([{"width": 8, "height": 8, "fx": 9, "camera_to_world": [1]}])"),
            "camera_to_world is an array of 1, not a matrix of 4 rows"},
           {error(R"([{"width": 8, "height": 8, "fx": 9}])"), "world_to_camera or camera_to_world"},
           {error(R"([{"width": 8, "height": 8, "fx": 9, "fovv": 1, "camera_to_world": )" + unit +
                  "}]"),
            "unknown key 'fovv'"},
           {error("{\"frames\": []}"), "frames must be an array"},
           {error("{\"frames\": [{\"transform_matrix\": " + unit + "}]}"), "no w and h"},
           {error("{\"w\": 8, \"h\": 8, \"frames\": [{}]}"), "neither fl_x nor camera_angle_x"},
           {frame(""), "frames[0] has no transform_matrix"},
           {frame("\"camera_model\": \"FOV\""), "colmap image_undistorter"},
           {frame("\"transform_matrix\": [[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]"),
            "scales lengths by 2"},
           {frame("\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]"), "mirrors"},
           {frame("\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,5,5,1]]"),
            "may be transposed"},
           {error("{\"from_mitsuba\": true, \"frames\": [{}]}"), "from_mitsuba"}}) {
    EXPECT_NE(message.find(expected), std::string::npos) << expected << "\n" << message;
    EXPECT_NE(message.find("views.json: "), std::string::npos) << message;
  }
  // Blender's files leave the size to the pictures.
  const std::string blender =
      written(folder, "blender.json",
              "{\"camera_angle_x\": 1, \"frames\": [{\"transform_matrix\": " + unit + "}]}");
  EXPECT_EQ(read_views(blender, {.width = 80, .height = 60})[0].camera.center_y, 30);
  EXPECT_NE(message_of([&] { read_views(folder / "none.ply"); }).find("cannot be opened"),
            std::string::npos);
}

TEST(Views, LensesAreReadInEveryConvention) {
  const TemporaryFolder folder;
  written(folder, "c/images.txt",
          "1 1 0 0 0 0 0 0 1 a\n\n2 1 0 0 0 0 0 0 2 b\n\n3 1 0 0 0 0 0 0 3 c\n\n"
          "4 1 0 0 0 0 0 0 4 d\n\n");
  written(folder, "c/cameras.txt",
          "1 FULL_OPENCV 8 8 9 9 4 4 .1 .2 .3 .4 .5 .6 .7 .8\n2 OPENCV_FISHEYE 8 8 9 9 4 4 .1 .2 "
          ".3 .4\n3 RADIAL 8 8 9 4 4 .1 .2\n4 OPENCV 8 8 9 9 4 4 0 0 0 0\n");
  const std::vector<View> views = read_views(folder / "c");
  ASSERT_TRUE(views[0].lens && views[1].lens && views[2].lens);
  EXPECT_FALSE(views[3].lens);
  using K = std::array<double, 6>;
  EXPECT_EQ(views[0].lens->k, (K{.1, .2, .5, .6, .7, .8}));
  EXPECT_EQ(views[0].lens->p, (std::array<double, 2>{.3, .4}));
  EXPECT_EQ(views[1].lens->model, Lens::Model::kFisheye);
  EXPECT_EQ(views[1].lens->k, (K{.1, .2, .3, .4, 0, 0}));
  EXPECT_EQ(views[2].lens->k, (K{.1, .2, 0, 0, 0, 0}));

  const auto transforms = [&](const std::string& members) {
    return read_views(
        written(folder, "t.json",
                "{\"w\": 8, \"h\": 4, \"fl_x\": 9, " + members +
                    ", \"frames\": [{\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}"))[0];
  };
  const View opencv = transforms(R"("k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4)");
  EXPECT_EQ(opencv.lens->k, (K{.1, .2, 0, 0, 0, 0}));
  EXPECT_EQ(opencv.lens->p, (std::array<double, 2>{.3, .4}));
  EXPECT_FALSE(transforms(R"("k1": 0, "camera_model": "OPENCV")").lens);
  EXPECT_EQ(transforms(R"("is_fisheye": true)").lens->model, Lens::Model::kFisheye);
  EXPECT_EQ(transforms(R"("camera_model": "EQUIRECTANGULAR")").lens->model,
            Lens::Model::kEquirectangular);
}

TEST(Views, RotationsOfFewDigitsAreMadeRotations) {
  const TemporaryFolder folder;
  const std::string path =
      written(folder, "v.json",
              R"([{"width": 8, "height": 8, "fx": 9, "camera_to_world": [[0.8660, -0.5, 0, 1],
          [0.5, 0.8660, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}])");
  const Camera camera = read_views(path)[0].camera;
  EXPECT_LT((camera.camera_from_world * camera.camera_from_world.transpose() -
             Eigen::Matrix3d::Identity())
                .norm(),
            1e-14);
  EXPECT_NEAR(camera.camera_from_world(0, 1), 0.5, 1e-4);
}

TEST(Views, PicturesOfAnotherSizeShowTheSame) {
  std::vector<View> views{{"a", known_camera()}};
  resize_views(views, 320, 240);
  EXPECT_EQ(views[0].camera.width, 320);
  EXPECT_EQ(views[0].camera.focal_x, 700.5 / 2);
  EXPECT_EQ(views[0].camera.center_y, 231.75 / 2);
  EXPECT_NE(message_of([&] { resize_views(views, 320, 200); }).find("such as 320x240"),
            std::string::npos);
  resize_views(views, 33, 25);  // Whole pixels come no closer.
  EXPECT_EQ(views[0].camera.height, 25);
}

TEST(Views, UpIsTheMeanOfThePictures) {
  std::vector<View> views(2);
  views[0].camera = known_camera();
  views[1].camera = known_camera();
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(M_PI, Vec3d::UnitY()).toRotationMatrix();
  views[1].camera.camera_from_world = views[0].camera.camera_from_world * turn;
  EXPECT_LT((mean_up(views) - Vec3d(0, 1, 0)).norm(), 1e-12);
  views[1].camera.camera_from_world = views[0].camera.camera_from_world;
  views[1].camera.camera_from_world.topRows<2>() *= -1;
  EXPECT_EQ(mean_up(views), Vec3d(0, 1, 0));
}

TEST(Views, NamesOfFilesStayInTheirFolderAndDiffer) {
  std::vector<View> views;
  for (const char* name : {"./a/b.jpg", "a_b.png", "../../etc/passwd", "/abs.x", "", ".hidden",
                           "-o.png", "caf\xc3\xa9 1.2.jpg", "c\\d.e/f", "other/b.png", "a/.."}) {
    views.push_back({name, {}});
  }
  views.push_back({std::string(5000, 'x'), {}});
  const std::vector<std::string> names = file_names(views);
  const std::vector<std::string> expected{"b",    "a_b",     "passwd", "abs",
                                          "view", "_hidden", "_o",     "caf\xc3\xa9_1.2",
                                          "f",    "b_2",     "_",      std::string(200, 'x')};
  EXPECT_EQ(names, expected);
}

}  // namespace
}  // namespace surfel::test
