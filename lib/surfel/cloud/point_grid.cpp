#include <algorithm>
#include <bit>

#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/cloud/point_grid.h>

namespace surfel {

PointGrid::PointGrid(const Array<Vec3f>& points, float cell) : cell_(cell) {
  constexpr float kMostCells = 1 << 20;
  constexpr std::size_t kGrain = 1 << 14;
  if (points.empty()) {
    slot_.assign(1, kFree);
    cell_begin_.assign(1, 0);
    return;
  }
  Vec3f max = points.front();
  min_ = points.front();
  for (const Vec3f& p : points) {
    min_ = min_.cwiseMin(p);
    max = max.cwiseMax(p);
  }
  const Vec3f size = max - min_;
  cell_ = std::max(cell_, size.maxCoeff() / kMostCells);
  inverse_cell_ = 1 / cell_;
  most_ = (size * inverse_cell_).array().floor();

  Array<std::uint64_t> keys(points.size());
  parallel_for(points.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) keys[i] = key(cell_of(points[i]));
  });
  index_ = sorted_order(keys);
  sorted_.resize(points.size());
  for (std::size_t i = 0; i < index_.size(); ++i) {
    sorted_[i] = points[index_[i]];
    const std::uint64_t cell_key = keys[index_[i]];
    if (cell_key_.empty() || cell_key_.back() != cell_key) {
      cell_key_.push_back(cell_key);
      cell_begin_.push_back(static_cast<std::uint32_t>(i));
    }
  }
  cell_begin_.push_back(static_cast<std::uint32_t>(points.size()));

  mask_ = std::bit_ceil(2 * cell_key_.size()) - 1;
  slot_.assign(mask_ + 1, kFree);
  for (std::size_t place = 0; place < cell_key_.size(); ++place) {
    std::size_t slot = hash(cell_key_[place]) & mask_;
    while (slot_[slot] != kFree) slot = (slot + 1) & mask_;
    slot_[slot] = static_cast<std::uint32_t>(place);
  }
}

}  // namespace surfel
