#pragma once

#include <cstddef>

#include <surfel/base/parallel.h>

namespace surfel {

/// Calls body(i) for every i below `count`, in parallel, `grain` of them one after the other in one
/// thread: a parallel_for() whose body needs neither its range nor a worker's scratch. A grain of
/// tens of microseconds' work makes handing it out cost nothing; no result depends on it.
template <class Body>
void parallel_each(std::size_t count, std::size_t grain, const Body& body) {
  parallel_for(count, grain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) body(i);
  });
}

}  // namespace surfel
