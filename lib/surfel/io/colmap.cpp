#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/io/colmap.h>
#include <surfel/io/promises.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

/// A camera model of COLMAP: f or fx, fy; cx, cy; then coefficients.
struct ColmapModel {
  const char* name;
  int parameters;
  int focals;
  enum Lens { kNone, kPolynomial, kFisheye, kOther } lens;
};

/// By COLMAP's numbers of the models.
constexpr std::array<ColmapModel, 12> kModels{
    {{"SIMPLE_PINHOLE", 3, 1, ColmapModel::kNone},
     {"PINHOLE", 4, 2, ColmapModel::kNone},
     {"SIMPLE_RADIAL", 4, 1, ColmapModel::kPolynomial},
     {"RADIAL", 5, 1, ColmapModel::kPolynomial},
     {"OPENCV", 8, 2, ColmapModel::kPolynomial},
     {"OPENCV_FISHEYE", 8, 2, ColmapModel::kFisheye},
     {"FULL_OPENCV", 12, 2, ColmapModel::kPolynomial},
     {"FOV", 5, 2, ColmapModel::kOther},
     {"SIMPLE_RADIAL_FISHEYE", 4, 1, ColmapModel::kFisheye},
     {"RADIAL_FISHEYE", 5, 1, ColmapModel::kFisheye},
     {"THIN_PRISM_FISHEYE", 12, 2, ColmapModel::kOther},
     {"RAD_TAN_THIN_PRISM_FISHEYE", 16, 2, ColmapModel::kOther}}};

/// The folder whose files are read; empty if there is none.
std::string files_folder(const std::string& folder, const char* extension) {
  for (const char* inner : {"", "sparse/0", "sparse", "0"}) {
    const std::filesystem::path path = std::filesystem::path(folder) / inner;
    std::error_code none;
    if (std::filesystem::exists(path / (std::string("cameras") + extension), none) &&
        std::filesystem::exists(path / (std::string("images") + extension), none)) {
      return path.string();
    }
  }
  return {};
}

/// The lens of a model; nullopt where it bends nothing.
std::optional<Lens> lens_of(const ColmapModel& model, const std::array<double, 16>& values) {
  const std::size_t first = static_cast<std::size_t>(model.focals) + 2;
  const std::size_t count = static_cast<std::size_t>(model.parameters) - first;
  Lens lens;
  if (model.lens == ColmapModel::kFisheye) lens.model = Lens::Model::kFisheye;
  // Polynomials have k1, k2, p1, p2, k3 ...; fisheye lenses k1, k2, k3, k4.
  std::size_t next_k = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const bool tangential = model.lens == ColmapModel::kPolynomial && (i == 2 || i == 3);
    (tangential ? lens.p[i - 2] : lens.k[next_k++]) = values[first + i];
  }
  const auto zero = [](double k) { return k == 0; };
  const bool pinhole = model.lens != ColmapModel::kFisheye &&
                       std::all_of(lens.k.begin(), lens.k.end(), zero) &&
                       std::all_of(lens.p.begin(), lens.p.end(), zero);
  return pinhole ? std::nullopt : std::optional<Lens>(lens);
}

/// Turns the numbers of a camera into a view without its pose; fail(message) says where they are.
template <class Fail>
View camera_of(const ColmapModel& model, std::int64_t width, std::int64_t height,
               const std::array<double, 16>& values, const std::string& folder, const Fail& fail) {
  if (width < 1 || height < 1 || width > Camera::kMostSide || height > Camera::kMostSide) {
    fail(fmt::format("the picture has {}x{} pixels; each side must be in 1..{}", width, height,
                     Camera::kMostSide));
  }
  if (model.lens == ColmapModel::kOther) {
    fail(
        fmt::format("the camera model {} is not supported; make pictures and cameras without "
                    "distortion: colmap image_undistorter --image_path IMAGES --input_path {} "
                    "--output_path undistorted",
                    model.name, shell_file(folder)));
  }
  if (!std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
    fail("a parameter of the camera is not finite");
  }
  View view;
  Camera& camera = view.camera;
  camera.width = static_cast<int>(width);
  camera.height = static_cast<int>(height);
  camera.focal_x = values[0];
  camera.focal_y = values[static_cast<std::size_t>(model.focals) - 1];
  camera.center_x = values[static_cast<std::size_t>(model.focals)];
  camera.center_y = values[static_cast<std::size_t>(model.focals) + 1];
  for (const std::string& problem : camera.problems()) fail(problem);
  view.lens = lens_of(model, values);
  return view;
}

/// Gives a camera its pose: a rotation as quaternion w x y z and a translation, from world to
/// camera.
template <class Fail>
void pose(Camera& camera, const std::array<double, 7>& values, const Fail& fail) {
  Eigen::Quaterniond rotation(values[0], values[1], values[2], values[3]);
  const Vec3d translation(values[4], values[5], values[6]);
  const double norm = rotation.norm();
  // Programs write unit quaternions with 6 digits and more.
  if (!(std::abs(norm - 1) < 1e-2)) {
    fail(fmt::format("the rotation is a quaternion of length {:g}, which must be 1", norm));
  }
  if (!translation.allFinite()) fail("the translation is not finite");
  rotation.coeffs() /= norm;
  camera.camera_from_world = rotation.toRotationMatrix();
  camera.eye = -(camera.camera_from_world.transpose() * translation);
}

/// Views without pose and name, by the number of their camera.
using Cameras = std::map<std::int64_t, View>;

template <class Fail>
View camera_by_number(const Cameras& cameras, std::int64_t number, const Fail& fail) {
  const auto found = cameras.find(number);
  if (found == cameras.end()) fail(fmt::format("there is no camera {}", number));
  return found->second;
}

TextScanner text_of(const InputFile& file) {
  return {file.name(), as_text(file.bytes()), TextFormat{.comments = true}};
}

Cameras read_text_cameras(const InputFile& file, const std::string& folder) {
  Cameras cameras;
  TextScanner text = text_of(file);
  const auto fail = [&](const std::string& message) { text.fail(message); };
  while (text.skip_to_content()) {
    const std::int64_t number = text.integer("the camera's number");
    const std::string name(text.word());
    const auto* model = std::find_if(kModels.begin(), kModels.end(),
                                     [&](const ColmapModel& m) { return name == m.name; });
    if (model == kModels.end()) {
      text.fail(fmt::format("the camera model {} is not known", quoted_excerpt(name)));
    }
    const std::int64_t width = text.integer("the width");
    const std::int64_t height = text.integer("the height");
    std::array<double, 16> values{};
    for (int i = 0; i < model->parameters; ++i) {
      values[static_cast<std::size_t>(i)] = text.number("a parameter of the camera");
    }
    if (!text.at_line_end()) {
      text.fail(fmt::format("more than the {} parameters of {}", model->parameters, model->name));
    }
    if (!cameras.emplace(number, camera_of(*model, width, height, values, folder, fail)).second) {
      text.fail(fmt::format("there are two cameras {}", number));
    }
    text.next_line();
  }
  return cameras;
}

std::vector<View> read_text_images(const InputFile& file, const Cameras& cameras) {
  std::vector<View> views;
  TextScanner text = text_of(file);
  const auto fail = [&](const std::string& message) { text.fail(message); };
  while (text.skip_to_content()) {
    text.integer("the image's number");
    std::array<double, 7> values{};
    for (double& value : values) value = text.number("a number of the pose");
    View view = camera_by_number(cameras, text.integer("the camera's number"), fail);
    pose(view.camera, values, fail);
    view.name = text.rest_of_line();
    if (view.name.empty()) text.fail("the image has no name");
    views.push_back(std::move(view));
    text.next_line();
    text.next_line();  // The points that the image shows, none of them on an empty line.
  }
  return views;
}

/// Reads the values of a binary file one after another; each must be inside of the file.
class ColmapBytes {
 public:
  explicit ColmapBytes(const InputFile& file) : name_(file.name()), left_(file.bytes()) {}

  template <class T>
  T take() {
    static_assert(sizeof(T) == 4 || sizeof(T) == 8);
    require(sizeof(T));
    // The format is little-endian, whatever the machine.
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      bits |= static_cast<std::uint64_t>(left_[i]) << (8 * i);
    }
    left_ = left_.subspan(sizeof(T));
    if constexpr (sizeof(T) == 4) {
      return std::bit_cast<T>(static_cast<std::uint32_t>(bits));
    } else {
      return std::bit_cast<T>(bits);
    }
  }
  std::string take_text() {
    const auto end = std::find(left_.begin(), left_.end(), std::byte{0});
    if (end == left_.end()) fail("the file ends within a name; it is truncated");
    const auto size = static_cast<std::size_t>(end - left_.begin());
    std::string text(as_text(left_.first(size)));
    left_ = left_.subspan(size + 1);
    return text;
  }
  /// A count of things of so many bytes at least.
  std::uint64_t take_count(const char* things, std::uint64_t least_bytes) {
    const auto count = take<std::uint64_t>();
    require_room(
        count, least_bytes, left_.size(), [&] { return "the file, " + where_ + ","; }, things,
        [&](const std::string& message) { throw_input(name_, message); });
    return count;
  }
  void skip(std::uint64_t size) {
    require(size);
    left_ = left_.subspan(size);
  }
  /// Says where the values to come are, for messages.
  void at(std::string where) { where_ = std::move(where); }
  [[noreturn]] void fail(const std::string& message) const {
    throw_input(name_, where_ + ": " + message);
  }
  void require_end() const {
    if (!left_.empty()) {
      fail(
          fmt::format("{} bytes follow the last one; the file is of another format", left_.size()));
    }
  }

 private:
  void require(std::uint64_t size) const {
    if (left_.size() < size) fail("the file ends here; it is truncated");
  }

  std::string name_;
  std::string where_ = "at its start";
  std::span<const std::byte> left_;
};

Cameras read_binary_cameras(const InputFile& file, const std::string& folder) {
  constexpr std::uint64_t kLeastBytes = 4 + 4 + 8 + 8 + 3 * 8;
  Cameras cameras;
  ColmapBytes bytes(file);
  const auto fail = [&](const std::string& message) { bytes.fail(message); };
  const std::uint64_t count = bytes.take_count("cameras", kLeastBytes);
  for (std::uint64_t i = 0; i < count; ++i) {
    bytes.at(fmt::format("camera {} of {}", i + 1, count));
    const auto number = bytes.take<std::uint32_t>();
    const auto model = bytes.take<std::uint32_t>();
    if (model >= kModels.size()) bytes.fail(fmt::format("camera model {} is not known", model));
    const auto width = bytes.take<std::int64_t>();
    const auto height = bytes.take<std::int64_t>();
    std::array<double, 16> values{};
    for (int k = 0; k < kModels[model].parameters; ++k) {
      values[static_cast<std::size_t>(k)] = bytes.take<double>();
    }
    if (!cameras.emplace(number, camera_of(kModels[model], width, height, values, folder, fail))
             .second) {
      bytes.fail(fmt::format("there are two cameras {}", number));
    }
  }
  bytes.require_end();
  return cameras;
}

std::vector<View> read_binary_images(const InputFile& file, const Cameras& cameras) {
  constexpr std::uint64_t kLeastBytes = 4 + 7 * 8 + 4 + 1 + 8;
  constexpr std::uint64_t kPointBytes = 24;
  std::vector<View> views;
  ColmapBytes bytes(file);
  const auto fail = [&](const std::string& message) { bytes.fail(message); };
  const std::uint64_t count = bytes.take_count("images", kLeastBytes);
  for (std::uint64_t i = 0; i < count; ++i) {
    bytes.at(fmt::format("image {} of {}", i + 1, count));
    bytes.take<std::uint32_t>();  // The image's number.
    std::array<double, 7> values{};
    for (double& value : values) value = bytes.take<double>();
    View view = camera_by_number(cameras, bytes.take<std::uint32_t>(), fail);
    view.name = bytes.take_text();
    pose(view.camera, values, fail);
    if (view.name.empty()) bytes.fail("the image has no name");
    bytes.skip(kPointBytes * bytes.take_count("points", kPointBytes));
    views.push_back(std::move(view));
  }
  bytes.require_end();
  return views;
}

bool is_binary(const InputFile& file) { return lower_extension(file.name()) == ".bin"; }

}  // namespace

bool holds_colmap(const std::string& folder) {
  return !files_folder(folder, ".bin").empty() || !files_folder(folder, ".txt").empty();
}

std::vector<View> read_colmap(const std::string& folder) {
  for (const char* extension : {".bin", ".txt"}) {
    const std::filesystem::path found = files_folder(folder, extension);
    if (found.empty()) continue;
    return read_colmap(InputFile((found / (std::string("cameras") + extension)).string()),
                       InputFile((found / (std::string("images") + extension)).string()));
  }
  throw_input(folder,
              "holds neither cameras.bin and images.bin nor cameras.txt and images.txt, as COLMAP "
              "writes them; name the folder of a reconstruction, such as sparse/0");
}

std::vector<View> read_colmap(const InputFile& cameras, const InputFile& images) {
  const std::string folder = std::filesystem::path(cameras.name()).parent_path().string();
  const Cameras found = is_binary(cameras) ? read_binary_cameras(cameras, folder)
                                           : read_text_cameras(cameras, folder);
  std::vector<View> views =
      is_binary(images) ? read_binary_images(images, found) : read_text_images(images, found);
  if (views.empty()) throw_input(images.name(), "holds no image");
  std::stable_sort(views.begin(), views.end(),
                   [](const View& a, const View& b) { return a.name < b.name; });
  return views;
}

}  // namespace surfel
