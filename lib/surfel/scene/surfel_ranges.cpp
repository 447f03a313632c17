#include <surfel/scene/surfel_ranges.h>

namespace surfel {

OrderedCloud::OrderedCloud(const SurfelCloud& cloud)
    : cloud_(cloud),
      grid_(morton_grid({cloud.position.data(), cloud.position.size()})),
      order_(morton_order(cloud.position, grid_)) {}

SurfelCloud OrderedCloud::read(std::size_t begin, std::size_t end) const {
  return cloud_.gathered({order_.begin() + static_cast<std::ptrdiff_t>(begin),
                          order_.begin() + static_cast<std::ptrdiff_t>(end)});
}

}  // namespace surfel
