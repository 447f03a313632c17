#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <surfel/base/coordinate_spread.h>
#include <surfel/base/parallel.h>

namespace surfel {
namespace {

/// Sign, exponent and four bits of the mantissa, so that keys have the order of the numbers.
std::uint16_t key_of(double coordinate) {
  const auto top = static_cast<std::uint16_t>(std::bit_cast<std::uint64_t>(coordinate) >> 48);
  return static_cast<std::uint16_t>((top & 0x8000) != 0 ? ~top : top | 0x8000);
}

}  // namespace

void CoordinateSpread::Axis::add(const Cell& part) {
  std::uint16_t& on = page[part.key >> 8];
  if (on == 0) {
    pages.push_back({});
    on = static_cast<std::uint16_t>(pages.size());
  }
  std::uint16_t& at = pages[on - 1U][part.key & 0xff];
  if (at == 0) {
    cells.push_back({part.key, 0, part.min, part.max});
    at = static_cast<std::uint16_t>(cells.size());
  }
  Cell& cell = cells[at - 1U];
  cell.count += part.count;
  cell.min = std::min(cell.min, part.min);
  cell.max = std::max(cell.max, part.max);
}

void CoordinateSpread::add(int axis, std::span<const double> coordinates) {
  Axis& to = axes_[static_cast<std::size_t>(axis)];
  Cell all{0, 0, std::numeric_limits<double>::max(), std::numeric_limits<double>::lowest()};
  for (const double coordinate : coordinates) {
    const bool finite = coordinate * 0 == 0;  // Without a branch.
    all.count += finite ? 1 : 0;
    all.min = finite && coordinate < all.min ? coordinate : all.min;
    all.max = finite && coordinate > all.max ? coordinate : all.max;
  }
  if (all.count == 0) return;
  all.key = key_of(all.min);
  if (all.key == key_of(all.max)) return to.add(all);
  for (const double coordinate : coordinates) {
    if (std::isfinite(coordinate)) to.add({key_of(coordinate), 1, coordinate, coordinate});
  }
}

void CoordinateSpread::add(const CoordinateSpread& other) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const Cell& cell : other.axes_[axis].cells) axes_[axis].add(cell);
  }
}

void CoordinateSpread::add(const Vec3d& origin, std::span<const Vec3f> offsets) {
  constexpr std::size_t kGrain = 4096;
  PerWorker<CoordinateSpread> parts;
  parallel_for(offsets.size(), kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    std::array<double, kGrain> coordinates;
    for (int axis = 0; axis < 3; ++axis) {
      for (std::size_t i = begin; i < end; ++i) {
        coordinates[i - begin] = origin[axis] + static_cast<double>(offsets[i][axis]);
      }
      parts[worker].add(axis, std::span(coordinates).first(end - begin));
    }
  });
  parts.for_each([this](const CoordinateSpread& part) { add(part); });
}

Bounds CoordinateSpread::box() const {
  Bounds box;
  for (int axis = 0; axis < 3; ++axis) {
    for (const Cell& cell : axes_[static_cast<std::size_t>(axis)].cells) {
      box.min[axis] = std::min(box.min[axis], cell.min);
      box.max[axis] = std::max(box.max[axis], cell.max);
    }
  }
  return box;
}

Bounds CoordinateSpread::core(const Bounds& box) const {
  Bounds half;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<Cell> cells = axes_[static_cast<std::size_t>(axis)].cells;
    if (cells.empty()) return box;
    std::sort(cells.begin(), cells.end(),
              [](const Cell& a, const Cell& b) { return a.key < b.key; });
    std::uint64_t all = 0;
    for (const Cell& cell : cells) all += cell.count;
    // The cells of the quarter's last coordinate from below and from above.
    const auto quarter = [all](auto begin) {
      for (std::uint64_t below = 0;; ++begin) {
        below += begin->count;
        if (below > all / 4) return *begin;
      }
    };
    half.min[axis] = quarter(cells.begin()).min;
    half.max[axis] = quarter(cells.rbegin()).max;
  }
  const double margin = (half.max - half.min).maxCoeff();
  Bounds core;
  for (int axis = 0; axis < 3; ++axis) {
    const double least = half.min[axis] - margin;
    const double most = half.max[axis] + margin;
    for (const Cell& cell : axes_[static_cast<std::size_t>(axis)].cells) {
      if (cell.max < least || cell.min > most) continue;
      core.min[axis] = std::min(core.min[axis], std::max(cell.min, least));
      core.max[axis] = std::max(core.max[axis], std::min(cell.max, most));
    }
  }
  return box.diagonal() > kStray * core.diagonal() ? core : box;
}

}  // namespace surfel
