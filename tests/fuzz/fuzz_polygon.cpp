// Triangulates a polygon whose corners the bytes are: n corners give n - 2 triangles of corners
// that there are.

#include <vector>

#include <surfel/io/triangulate.h>

#include "fuzz/fuzz_file.h"

using namespace surfel;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Numbers numbers(data, size);
  const bool flat = numbers.byte() % 2 == 0;
  const bool any = numbers.byte() % 4 == 0;
  std::vector<Vec3d> corners;
  while (!numbers.done()) {
    const auto next = [&] { return static_cast<double>(any ? numbers.any() : numbers.unit()); };
    const double x = next();
    const double y = next();
    corners.emplace_back(x, y, flat ? 0 : next());
  }
  if (corners.size() < 3) return 0;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  triangulate_polygon(corners, triangles);
  fuzz::require(triangles.size() == corners.size() - 2, "a wrong number of triangles");
  for (const auto& triangle : triangles) {
    for (const std::uint32_t corner : triangle) {
      fuzz::require(corner < corners.size(), "a corner that there is not");
    }
  }
  return 0;
}
