#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/scene/view.h>

namespace surfel {
namespace {

/// Letters, digits, and what else stands for itself everywhere; bytes of UTF-8 are letters.
bool is_plain(unsigned char c) {
  return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' ||
         c == '-' || c == '+' || c == '.' || c >= 0x80;
}

/// The name of a file without its folders and its extension.
std::string plain_name(const std::string& name) {
  const std::size_t slash = name.find_last_of("/\\");
  std::string plain = slash == std::string::npos ? name : name.substr(slash + 1);
  const std::size_t dot = plain.rfind('.');
  // A dot at the start of a name begins no extension.
  if (dot != std::string::npos && dot > 0) plain.erase(dot);
  std::replace_if(
      plain.begin(), plain.end(), [](char c) { return !is_plain(static_cast<unsigned char>(c)); },
      '_');
  // Hidden files, and what looks like an option.
  if (plain.starts_with('.') || plain.starts_with('-')) plain.front() = '_';
  constexpr std::size_t kLongest = 200;  // Bytes; systems take 255, with extension and temporaries.
  if (plain.size() > kLongest) plain.resize(kLongest);
  return plain.empty() ? "view" : plain;
}

}  // namespace

Vec3d mean_up(const std::vector<View>& views) {
  Vec3d sum(0, 0, 0);
  for (const View& view : views) sum -= view.camera.camera_from_world.row(1).transpose();
  const double common = 1e-3 * static_cast<double>(views.size());
  return sum.norm() > common ? Vec3d(sum.normalized()) : Vec3d(0, 1, 0);
}

void resize_views(std::vector<View>& views, int width, int height) {
  for (View& view : views) {
    Camera& camera = view.camera;
    const double x = static_cast<double>(width) / camera.width;
    const double y = static_cast<double>(height) / camera.height;
    if (std::abs(x * camera.height - height) > 1 && std::abs(y * camera.width - width) > 1) {
      throw_usage(
          fmt::format("the picture of {} has {}x{} pixels, which {}x{} would distort; ask "
                      "for the same shape, such as {}x{}",
                      view.name, camera.width, camera.height, width, height, width,
                      std::max(1L, std::lround(x * camera.height))));
    }
    camera.focal_x *= x;
    camera.center_x *= x;
    camera.focal_y *= y;
    camera.center_y *= y;
    camera.width = width;
    camera.height = height;
  }
}

std::vector<std::string> file_names(const std::vector<View>& views) {
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const View& view : views) {
    const std::string plain = plain_name(view.name);
    std::string name = plain;
    for (int number = 2; !taken.insert(name).second; ++number) {
      name = fmt::format("{}_{}", plain, number);
    }
    names.push_back(name);
  }
  return names;
}

}  // namespace surfel
