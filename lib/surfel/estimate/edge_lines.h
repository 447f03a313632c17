#pragma once

#include <array>

#include <surfel/base/types.h>

namespace surfel {

/// A half-plane in a point's tangent plane: the surface that the point stands for lies within
/// `distance` along `outward`.
struct EdgeLine {
  Vec3f outward{0, 0, 0};  ///< Unit, in the tangent plane.
  float distance = 0;      ///< Of the line from the point, scene units, >= 0.
};

/// The lines at which a point's surface ends, two at most.
struct EdgeLines {
  std::array<EdgeLine, 2> line;
  int count = 0;

  bool full() const { return count == 2; }
  void add(const EdgeLine& another) {
    if (!full()) line[static_cast<std::size_t>(count++)] = another;
  }
  const EdgeLine* begin() const { return line.data(); }
  const EdgeLine* end() const { return line.data() + count; }
};

}  // namespace surfel
