#include <cmath>

#include <fmt/format.h>
#include <surfel/base/option_check.h>
#include <surfel/scene/camera.h>

namespace surfel {

std::vector<std::string> Camera::problems() const {
  std::vector<std::string> found;
  check_rule(found, width >= 1 && width <= kMostSide && height >= 1 && height <= kMostSide,
             fmt::format("size is {}x{}; each side must be in 1..{}", width, height, kMostSide));
  check_rule(found, camera_from_world.allFinite(), "`camera_from_world` must be finite");
  check_rule(found, eye.allFinite(), "`eye` must be finite");
  check_rule(found, std::isfinite(focal_x) && focal_x > 0 && std::isfinite(focal_y) && focal_y > 0,
             fmt::format("the focal lengths are {} and {}; they must be > 0", focal_x, focal_y));
  check_rule(found, std::isfinite(center_x) && std::isfinite(center_y),
             "`center_x` and `center_y` must be finite");
  check_rule(found, rows.begin >= 0 && rows.begin < drawn_rows().end,
             fmt::format("`rows` are {} to {}; there must be some among the picture's {}",
                         rows.begin, rows.end, height));
  check_option(found, near >= 0 && std::isfinite(near), "near", near, ">= 0");
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
