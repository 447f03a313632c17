#include <cmath>

#include <fmt/format.h>
#include <surfel/scene/camera.h>

namespace surfel {

std::vector<std::string> Camera::problems() const {
  std::vector<std::string> found;
  const auto check = [&](bool ok, const std::string& message) {
    if (!ok) found.push_back(message);
  };
  check(width >= 1 && width <= kMostSide && height >= 1 && height <= kMostSide,
        fmt::format("size is {}x{}; each side must be in 1..{}", width, height, kMostSide));
  check(camera_from_world.allFinite(), "`camera_from_world` must be finite");
  check(eye.allFinite(), "`eye` must be finite");
  check(std::isfinite(focal_x) && focal_x > 0 && std::isfinite(focal_y) && focal_y > 0,
        fmt::format("the focal lengths are {} and {}; they must be > 0", focal_x, focal_y));
  check(std::isfinite(center_x) && std::isfinite(center_y),
        "`center_x` and `center_y` must be finite");
  check(near >= 0 && std::isfinite(near), fmt::format("`near` is {}; it must be >= 0", near));
  return found;
}

std::vector<float> world_to_camera_matrix(const Camera& camera) {
  const Vec3d translation = -(camera.camera_from_world * camera.eye);
  std::vector<float> matrix;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      matrix.push_back(static_cast<float>(camera.camera_from_world(row, column)));
    }
    matrix.push_back(static_cast<float>(translation[row]));
  }
  matrix.insert(matrix.end(), {0, 0, 0, 1});
  return matrix;
}

}  // namespace surfel
