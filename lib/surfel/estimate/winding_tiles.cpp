#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/estimate/point_sheets.h>
#include <surfel/estimate/winding_tiles.h>
#include <surfel/surface/exact_search.h>
#include <surfel/surface/neighbor_lists.h>

namespace surfel {
namespace {

constexpr std::size_t kTileGrain = 1024;
constexpr std::size_t kAreaNeighbors = kOrientationNeighbors + 1;
/// Cells that a sheet needs for the winding number to tell its side.
constexpr double kSheetCells = 4;
/// Points of a tile from which its grid is told.
constexpr std::size_t kGridSample = 65536;

/// Surface that a point stands for: its nearest points, itself included, lie in a circle around it,
/// and each has its share of the circle's area.
float area_within(const Vec3f& furthest, const Vec3f& point, std::size_t points) {
  return (furthest - point).squaredNorm() * std::numbers::pi_v<float> / static_cast<float>(points);
}

Array<float> point_areas(const Array<Vec3f>& position, const NeighborSearch& search) {
  const NeighborRows rows = search.rows(kAreaNeighbors);
  Array<float> area(position.size());
  parallel_each(position.size(), kTileGrain, [&](std::size_t i) {
    const std::span<const std::uint32_t> near = rows.of(i);
    area[i] = area_within(position[near.back()], position[i], near.size());
  });
  return area;
}

WindingGrid grid_of(const Array<Vec3f>& position, const Array<float>& area) {
  std::vector<Vec3f> places;
  std::vector<float> areas;
  const std::size_t step = position.size() / kGridSample + 1;
  for (std::size_t i = 0; i < position.size(); i += step) {
    places.push_back(position[i]);
    areas.push_back(area[i]);
  }
  return winding_grid(position.size(), places, areas);
}

}  // namespace

WindingGrid sampled_grid(std::size_t count, std::span<const Vec3f> places,
                         const NearestPlaces& nearest) {
  std::vector<float> area;
  std::vector<Vec3f> near;
  for (const Vec3f& place : places) {
    nearest(place, kAreaNeighbors, near);
    area.push_back(area_within(near.back(), place, near.size()));
  }
  return winding_grid(count, places, area);
}

WindingTiles::WindingTiles(std::size_t count, const std::optional<WindingGrid>& grid)
    : count_(count) {
  if (grid) dipoles_.emplace(*grid);
}

Array<std::uint32_t> WindingTiles::add(const Array<Vec3f>& position, const NeighborSearch& search,
                                       Array<Vec3f>& normal) {
  const auto least = static_cast<std::size_t>(kSheetCells * winding_cell_points(count_));
  PointSheets sheets = cut_sheets(position, search, least, normal);
  const Array<float> area = point_areas(position, search);
  if (!dipoles_) dipoles_.emplace(grid_of(position, area));
  const std::uint32_t first = dipoles_->sheets();
  dipoles_->add(position, normal, area, sheets);
  parallel_each(position.size(), kTileGrain, [&](std::size_t i) {
    if (sheets.of[i] != PointSheets::kNone) sheets.of[i] += first;
  });
  return std::move(sheets.of);
}

Array<std::uint32_t> WindingTiles::add(const Array<Vec3f>& position, Array<Vec3f>& normal) {
  const ExactSearch tree(position);
  return add(position, NeighborLists(tree, position, kAreaNeighbors), normal);
}

void WindingTiles::finish() {
  if (dipoles_) sides_ = winding_sides(*dipoles_);
  dipoles_.reset();
}

void WindingTiles::set_sides(WindingSides sides) {
  sides_ = std::move(sides);
  dipoles_.reset();
}

Vec3f WindingTiles::side(const Vec3f& normal, std::uint32_t sheet) const {
  if (sheet == PointSheets::kNone) return Vec3f::Zero();
  const WindingSides::Sheet& of = sides_.sheet[sheet];
  const float length = 1 + std::round(of.certainty * 256) / 256;
  return of.turned != sides_.part[of.part].turned ? Vec3f(-length * normal) : length * normal;
}

}  // namespace surfel
