#include <algorithm>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/stored_sides.h>

namespace surfel {
namespace {

constexpr std::size_t kSideGrain = 1 << 14;

std::optional<WindingGrid> grid_of_tiles(std::size_t count, std::size_t tile_points,
                                         std::span<const Vec3f> sample,
                                         const NearestPlaces& nearest) {
  if (count <= tile_points) return std::nullopt;
  return sampled_grid(count, sample.first(std::min(kWindingSample, sample.size())), nearest);
}

}  // namespace

StoredSides::StoredSides(const RunIndex& index, std::size_t tile_points,
                         std::span<const Vec3f> sample, const NearestPlaces& nearest,
                         const std::string& beside)
    : index_(index),
      tile_points_(tile_points),
      tiles_(index.finite(), grid_of_tiles(index.finite(), tile_points, sample, nearest)),
      points_(beside) {
  const std::uint64_t needed = index.finite() * sizeof(Point);
  if (points_.free_bytes() < needed) {
    throw_io(beside, fmt::format("the sides of {} points take {:.3g} GB on its disk while surfels "
                                 "are made, and {:.3g} GB are left; make room, or orient by "
                                 "another method",
                                 index.finite(), static_cast<double>(needed) / 1e9,
                                 static_cast<double>(points_.free_bytes()) / 1e9));
  }
}

std::uint64_t StoredSides::bytes(std::size_t points, std::size_t tile_points) {
  // A point of a tile is searched for and cut into sheets; a dipole is kept, sorted and merged.
  constexpr std::uint64_t kTilePointBytes = 200;
  constexpr std::uint64_t kDipoleBytes = 400;
  const auto dipoles =
      static_cast<std::uint64_t>(2 * static_cast<double>(points) / winding_cell_points(points));
  return std::min(points, tile_points) * kTilePointBytes + dipoles * kDipoleBytes;
}

void StoredSides::add(const Array<Vec3f>& position, const Array<Vec3f>& normal) {
  for (std::size_t from = 0; from < position.size();) {
    const std::size_t to = std::min(position.size(), from + (tile_points_ - position_.size()));
    const auto append = [&](const Array<Vec3f>& values, Array<Vec3f>& out) {
      out.insert(out.end(), values.begin() + static_cast<std::ptrdiff_t>(from),
                 values.begin() + static_cast<std::ptrdiff_t>(to));
    };
    append(position, position_);
    append(normal, normal_);
    if (position_.size() == tile_points_) cut_tile();
    from = to;
  }
}

void StoredSides::cut_tile() {
  const Array<std::uint32_t> sheet = tiles_.add(position_, normal_);
  Array<Point> points(sheet.size());
  parallel_each(sheet.size(), kSideGrain, [&](std::size_t i) {
    points[i] = {normal_[i], sheet[i]};
  });
  points_.append(points.data(), points.size() * sizeof(Point));
  position_.clear();
  normal_.clear();
}

void StoredSides::finish() {
  if (!position_.empty()) cut_tile();
  position_ = {};
  normal_ = {};
  tiles_.finish();
}

void StoredSides::share(Peers& peers) {
  constexpr std::uint64_t kPiece = std::uint64_t{1} << 16;
  const bool tells = peers.rank() == 0;
  WindingSides sides;
  if (tells) sides = tiles_.sides();
  sides.sheet = gather_lists(&peers, sides.sheet).front();
  sides.part = gather_lists(&peers, sides.part).front();
  if (!tells) tiles_.set_sides(std::move(sides));
  for (std::uint64_t begin = 0; begin < index_.finite(); begin += kPiece) {
    Bytes bytes;
    if (tells) {
      bytes.resize(std::min<std::uint64_t>(kPiece, index_.finite() - begin) * sizeof(Point));
      points_.read_at(begin * sizeof(Point), bytes.data(), bytes.size());
    }
    const std::vector<Bytes> from =
        peers.exchange(std::vector<Bytes>(static_cast<std::size_t>(peers.count()), bytes));
    if (!tells) points_.append(from.front().data(), from.front().size());
  }
}

Array<Vec3f> StoredSides::of(const Array<Vec3f>& position, std::size_t run) const {
  Array<Vec3f> out;
  out.assign(position.size(), Vec3f::Zero());
  const auto finite = [&](std::size_t i) { return position[i].allFinite(); };
  Array<Point> points(count_where(position.size(), finite));
  points_.read_at(index_.finite_before(run) * sizeof(Point), points.data(),
                  points.size() * sizeof(Point));
  const Point* next = points.data();
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (!finite(i)) continue;
    out[i] = tiles_.side(next->normal, next->sheet);
    ++next;
  }
  return out;
}

}  // namespace surfel
