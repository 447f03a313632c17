#pragma once

#include <cstddef>
#include <vector>

namespace surfel {

/// How many values lie between two edges each.
struct Histogram {
  std::vector<double> edges;        ///< Ascending, one more than there are counts.
  std::vector<std::size_t> counts;  ///< The last one includes its upper edge.
};

}  // namespace surfel
