#include <algorithm>
#include <cmath>
#include <filesystem>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/scene/map_place.h>

namespace surfel {

Camera map_camera(const Bounds& box, double pixel) {
  const Vec3d low = box.empty() ? Vec3d(0, 0, 0) : box.min;
  const Vec3d high = box.empty() ? Vec3d(0, 0, 0) : box.max;
  // A box that ends at a multiple, but for rounding, needs no further pixels.
  constexpr double kRounding = 1e-6;
  const double left = std::floor(low.x() / pixel + kRounding);
  const double bottom = std::floor(low.y() / pixel + kRounding);
  const double width = std::max(1.0, std::ceil(high.x() / pixel - kRounding) - left);
  const double height = std::max(1.0, std::ceil(high.y() / pixel - kRounding) - bottom);
  if (!(std::max(width, height) <= Camera::kMostSide)) {
    throw_usage(
        fmt::format("`map` is {:g}; the picture would have {:.0f}x{:.0f} pixels, and each "
                    "side must be in 1..{}",
                    pixel, width, height, Camera::kMostSide));
  }
  Camera camera;
  camera.orthographic = true;
  camera.width = static_cast<int>(width);
  camera.height = static_cast<int>(height);
  camera.focal_x = camera.focal_y = 1 / pixel;
  camera.center_x = width / 2;
  camera.center_y = height / 2;
  camera.camera_from_world = Vec3d(1, -1, -1).asDiagonal();
  const Vec3d size = high - low;
  const double above = std::max({size.maxCoeff(), pixel, 1e-6 * high.cwiseAbs().maxCoeff()});
  camera.eye = Vec3d((left + width / 2) * pixel, (bottom + height / 2) * pixel, high.z() + above);
  return camera;
}

MapPlace map_place(const Camera& camera) {
  const double pixel = 1 / camera.focal_x;
  return {pixel, camera.eye.x() - camera.center_x * pixel,
          camera.eye.y() + camera.center_y * pixel};
}

std::string world_file(const MapPlace& place) {
  return fmt::format("{:.15g}\n0\n0\n{:.15g}\n{:.15g}\n{:.15g}\n", place.pixel, -place.pixel,
                     place.left + place.pixel / 2, place.top - place.pixel / 2);
}

std::string world_file_name(const std::string& picture) {
  std::filesystem::path path(picture);
  std::string extension = path.extension().string();
  for (const auto& [name, world] : {std::pair{".png", ".pgw"},
                                    {".tif", ".tfw"},
                                    {".tiff", ".tfw"},
                                    {".jpg", ".jgw"},
                                    {".jpeg", ".jgw"},
                                    {".bmp", ".bpw"}}) {
    if (extension == name) return path.replace_extension(world).string();
  }
  return path.replace_extension(extension + "w").string();
}

}  // namespace surfel
