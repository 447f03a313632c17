#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Exact neighbour search among fixed points. Queries may run in parallel.
class Neighbors {
 public:
  /// `points` are finite and outlive this object.
  explicit Neighbors(const Array<Vec3f>& points);
  ~Neighbors();
  Neighbors(const Neighbors&) = delete;
  Neighbors& operator=(const Neighbors&) = delete;

  /// The `count` points nearest to `query` (all, if there are fewer), by ascending distance.
  std::vector<std::uint32_t> nearest(const Vec3f& query, std::size_t count) const;
  /// Those within `radius`, the `most` nearest of them at most, by ascending distance.
  std::vector<std::uint32_t> within(const Vec3f& query, float radius, std::size_t most) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
