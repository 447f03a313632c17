#include <vector>

#include <surfel/io/triangulate.h>

#include "fuzz/checks.h"

namespace surfel::fuzz {

/// Triangulates a polygon whose corners the bytes are: n corners give n - 2 triangles of corners
/// that there are.
void polygon(Bytes bytes) {
  Numbers numbers(bytes);
  const bool flat = numbers.byte() % 2 == 0;
  const bool any = numbers.byte() % 4 == 0;
  std::vector<Vec3d> corners;
  constexpr std::size_t kMost = 60;
  while (!numbers.done() && corners.size() < kMost) {
    const auto next = [&] { return static_cast<double>(any ? numbers.any() : numbers.unit()); };
    const double x = next();
    const double y = next();
    corners.emplace_back(x, y, flat ? 0 : next());
  }
  if (corners.size() < 3) return;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  triangulate_polygon(corners, triangles);
  require(triangles.size() == corners.size() - 2, "a wrong number of triangles");
  for (const auto& triangle : triangles) {
    for (const std::uint32_t corner : triangle) {
      require(corner < corners.size(), "a corner that there is not");
    }
  }
}

}  // namespace surfel::fuzz
