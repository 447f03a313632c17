#include <algorithm>
#include <cmath>

#include <surfel/base/median.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/estimate/winding_dipoles.h>

namespace surfel {
namespace {

constexpr std::size_t kDipoleGrain = 4096;

/// Adds a point to the dipoles of its cell, which come from `first` on.
void add_point(const WindingDipole& point, std::size_t first, std::vector<WindingDipole>& out) {
  const auto same = std::find_if(out.begin() + static_cast<std::ptrdiff_t>(first), out.end(),
                                 [&](const WindingDipole& d) { return d.sheet == point.sheet; });
  if (same == out.end()) {
    out.push_back(point);
  } else {
    same->add(point, false);
  }
}

}  // namespace

double winding_cell_points(std::size_t count) {
  // Below 4 points' areas a cell holds one or two, and above 40,000 dipoles, or twice as many in
  // noise, the time would show. Cells of more than 1000 points would not see what tiles see.
  return std::clamp(static_cast<double>(count) / 25000, 4.0, 1000.0);
}

Vec3d WindingGrid::place(const Vec3f& position) const {
  constexpr double kCells = 1 << kLevels;
  const Vec3d p = (position.cast<double>() - middle) / cell + Vec3d::Constant(kCells / 2);
  return p.cwiseMax(0).cwiseMin(kCells - 1);
}

WindingGrid winding_grid(std::size_t count, std::span<const Vec3f> position,
                         std::span<const float> area) {
  WindingGrid grid;
  std::vector<float> sample;
  for (const float a : area) {
    if (a > 0) sample.push_back(a);
  }
  if (sample.empty()) return grid;
  grid.cell = std::sqrt(winding_cell_points(count) * static_cast<double>(median(sample)));
  for (int d = 0; d < 3; ++d) {
    sample.clear();
    for (std::size_t i = 0; i < area.size(); ++i) {
      if (area[i] > 0) sample.push_back(position[i][d]);
    }
    grid.middle[d] = static_cast<double>(median(sample));
  }
  return grid;
}

void WindingDipoles::add(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                         const Array<float>& area, const PointSheets& sheets) {
  const std::uint32_t first_sheet = sheets_;
  sheets_ += sheets.count;
  if (!(grid_.cell > 0)) return;
  const std::size_t count = position.size();
  Array<std::uint64_t> keys(count);
  parallel_each(count, kDipoleGrain, [&](std::size_t i) {
    const Vec3d p = grid_.place(position[i]);
    keys[i] = morton_code(static_cast<std::uint32_t>(p.x()), static_cast<std::uint32_t>(p.y()),
                          static_cast<std::uint32_t>(p.z()));
  });
  const Array<std::uint32_t> order = sort_keys(keys);
  // Each range sums the cells that begin in it.
  std::vector<std::vector<WindingDipole>> found((count + kDipoleGrain - 1) / kDipoleGrain);
  parallel_for(count, kDipoleGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<WindingDipole>& out = found[begin / kDipoleGrain];
    while (begin > 0 && begin < end && keys[begin] == keys[begin - 1]) ++begin;
    while (begin < end) {
      std::size_t next = begin;
      const std::size_t first = out.size();
      for (; next < count && keys[next] == keys[begin]; ++next) {
        const std::uint32_t i = order[next];
        if (sheets.of[i] == PointSheets::kNone || !(area[i] > 0)) continue;
        WindingDipole point;
        point.center = grid_.place(position[i]);
        point.area = static_cast<double>(area[i]) / (grid_.cell * grid_.cell);
        point.moment = point.area * normal[i].cast<double>();
        point.volume = point.moment.dot(point.center);
        point.cell = keys[begin];
        point.sheet = first_sheet + sheets.of[i];
        add_point(point, first, out);
      }
      begin = next;
    }
  });
  for (const std::vector<WindingDipole>& some : found) {
    dipoles_.insert(dipoles_.end(), some.begin(), some.end());
  }
}

std::vector<WindingDipole> WindingDipoles::sorted() const {
  std::vector<WindingDipole> out = dipoles_;
  std::sort(out.begin(), out.end(), [](const WindingDipole& a, const WindingDipole& b) {
    return a.cell != b.cell ? a.cell < b.cell : a.sheet < b.sheet;
  });
  return out;
}

}  // namespace surfel
