#include <surfel/scene/camera.h>

namespace surfel {

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
