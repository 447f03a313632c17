#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/render/pixel_explanation.h>

namespace surfel {

void require_in_picture(const Camera& camera, int x, int y) {
  if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) {
    throw_usage(fmt::format("pixel {},{} is outside of the picture, which has {}x{} pixels", x, y,
                            camera.width, camera.height));
  }
  const RowRange rows = camera.drawn_rows();
  if (y < rows.begin || y >= rows.end) {
    throw_usage(fmt::format("pixel {},{} is outside of the part that is drawn, rows {} to {}", x, y,
                            rows.begin, rows.end - 1));
  }
}

}  // namespace surfel
