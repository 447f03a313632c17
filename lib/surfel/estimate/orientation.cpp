#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/estimate/spanning_forest.h>
#include <surfel/estimate/surface_edges.h>
#include <surfel/estimate/surface_parts.h>
#include <surfel/estimate/winding_tiles.h>

namespace surfel {
namespace {

constexpr std::size_t kOrientationGrain = 1024;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

class Spreader {
 public:
  Spreader(const Array<Vec3f>& position, const NeighborSearch& search, Array<Vec3f>& normal)
      : position_(position),
        search_(search),
        normal_(normal),
        edges_(position, normal),
        sets_(position.size()) {}

  /// Makes points whose sides are right one part, and keeps their sides.
  void settle(const std::vector<bool>& given) {
    for (std::uint32_t i = 0; i < given.size(); ++i) {
      if (!given[i]) continue;
      if (settled_ == kNone) settled_ = i;
      sets_.unite(settled_, i, [] { return false; });
    }
  }
  /// One of the settled points, or kNone.
  std::uint32_t settled() const { return settled_; }

  /// Turns the normals of each part to one side, whichever that is unless points are settled.
  void spread() {
    join_neighbors();
    look_up();
    if (parts_ > 1) {
      join_parts();
      look_up();
    }
    const bool right_opposed = settled_ != kNone && opposed_[settled_] != 0;
    const std::uint32_t right = settled_ == kNone ? kNone : part_[settled_];
    parallel_each(position_.size(), kOrientationGrain, [&](std::size_t i) {
      if ((opposed_[i] != 0) != (part_[i] == right && right_opposed)) normal_[i] = -normal_[i];
    });
  }

  bool known(std::size_t i) const { return edges_.known(i); }
  /// For each point the one point that stands for its part. Set by spread().
  const Array<std::uint32_t>& part() const { return part_; }
  /// How many parts there are, besides points without a normal.
  std::size_t parts() const { return parts_; }

 private:
  /// Joins points along the spanning forest of the edges to the nearest points.
  void join_neighbors() {
    NeighborGraph graph{search_.rows(kOrientationNeighbors + 1), {}};
    graph.length.resize(position_.size() * graph.degree());
    parallel_for(position_.size(), kOrientationGrain, [&](std::size_t begin, std::size_t end, int) {
      std::uint16_t* length = graph.length.data() + begin * graph.degree();
      for (std::size_t i = begin; i < end; ++i) {
        for (const std::uint32_t j : graph.rows.of(i)) {
          const float w =
              j != i && known(i) && known(j) ? edges_.weight(i, j) : SurfaceEdges::kNoEdge;
          *length++ = NeighborGraph::length_of(w);
        }
      }
    });
    unite_spanning_forest(
        graph, settled_ != kNone,
        [&](std::uint32_t i, std::uint32_t j) { return edges_.opposed(i, j); }, sets_);
  }

  /// Finds the part of every point.
  void look_up() {
    part_.resize(position_.size());
    opposed_.resize(position_.size());
    parts_ = count_where(position_.size(), [&](std::size_t i) {
      const SignedSets::Root root = sets_.root(static_cast<std::uint32_t>(i));
      part_[i] = root.index;
      opposed_[i] = root.opposed ? 1 : 0;
      return root.index == i && known(i);
    });
  }

  /// Joins parts to other parts near them.
  void join_parts() {
    const std::size_t count = position_.size();
    Array<std::uint32_t> size;  // Known points of each part, by the part's root.
    size.assign(count, 0);
    for (std::size_t i = 0; i < count; ++i) size[part_[i]] += known(i) ? 1 : 0;
    // The largest part (of several, the part of the lowest point) waits for the others to come.
    std::uint32_t largest = kNone;
    for (std::uint32_t i = 0; i < count; ++i) {
      if (known(i) && (largest == kNone || size[part_[i]] > size[largest])) largest = part_[i];
    }
    PartJoins joins = find_joins({position_, normal_, part_}, search_, opposed_, largest);
    for (const PartJoin& join : joins.forest()) {
      sets_.unite(join.from, join.to, [&] { return join.opposed; });
    }
  }

  const Array<Vec3f>& position_;
  const NeighborSearch& search_;
  Array<Vec3f>& normal_;
  SurfaceEdges edges_;
  SignedSets sets_;
  std::uint32_t settled_ = kNone;
  Array<std::uint32_t> part_;
  Array<std::uint8_t> opposed_;  ///< 1: the normal is on the other side than the one of part_.
  std::size_t parts_ = 0;
};

/// Turns whole parts, except the part `settled`, see parts_to_turn().
/// \param before  whether the x of each normal had a sign before any was turned.
void turn_parts(const Array<Vec3f>& position, const Array<std::uint32_t>& part,
                std::uint32_t settled, Orientation method, const Array<std::uint8_t>& before,
                Array<Vec3f>& normal) {
  const std::size_t count = position.size();
  Array<std::uint32_t> number(count);
  std::uint32_t parts = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (part[i] == i && i != settled && !normal[i].isZero(0)) number[i] = parts++;
  }
  Array<std::uint32_t> voting(count);
  Array<std::uint8_t> turned(count);
  parallel_each(count, kOrientationGrain, [&](std::size_t i) {
    const bool votes = !normal[i].isZero(0) && part[i] != settled;
    voting[i] = votes ? number[part[i]] : PartPoints::kNoPart;
    turned[i] = (std::signbit(normal[i].x()) ? 1 : 0) != before[i] ? 1 : 0;
  });
  const std::vector<bool> turn = parts_to_turn({position, normal, voting}, parts, turned, method);
  parallel_each(count, kOrientationGrain, [&](std::size_t i) {
    if (voting[i] != PartPoints::kNoPart && turn[voting[i]]) normal[i] = -normal[i];
  });
}

/// Turns normals to the side of given ones; returns which points have one.
std::vector<bool> align(const Array<Vec3f>& previous, Array<Vec3f>& normal) {
  std::vector<bool> given(previous.size());
  for (std::size_t i = 0; i < previous.size(); ++i) {
    if (!previous[i].allFinite() || previous[i].isZero(0) || normal[i].isZero(0)) continue;
    if (normal[i].dot(previous[i]) < 0) normal[i] = -normal[i];
    given[i] = true;
  }
  return given;
}

/// Multiplies confidences by how far the edges to the nearest points agree with each normal's side.
void multiply_agreement(const Array<Vec3f>& position, const NeighborSearch& search,
                        const Array<Vec3f>& normal, Array<float>& confidence) {
  const NeighborRows rows = search.rows(kOrientationNeighbors + 1);
  const SurfaceEdges edges(position, normal);
  parallel_each(position.size(), kOrientationGrain, [&](std::size_t i) {
    if (!edges.known(i)) {
      confidence[i] = 0;
      return;
    }
    float sum = 0;
    float size = 0;
    for (const std::uint32_t j : rows.of(i)) {
      if (j == i || !edges.known(j)) continue;
      const float w = edges.weight(i, j);
      if (w == SurfaceEdges::kNoEdge) continue;
      sum += edges.opposed(i, j) ? w - 1 : 1 - w;
      size += 1 - w;
    }
    confidence[i] *= size > 0 ? std::max(0.0F, sum / size) : 0.0F;
  });
}

/// The side of each point by the winding number, as WindingTiles::side() has it; returns the number
/// of parts.
std::size_t winding_sides_of(const Array<Vec3f>& position, const NeighborSearch& search,
                             std::size_t tile_points, Array<Vec3f>& normal) {
  const std::size_t count = position.size();
  std::optional<WindingGrid> grid;
  if (count > tile_points) {
    auto nearest = nearest_places(position, search);
    grid = sampled_grid(count, sample_places(position, kWindingSample), nearest);
  }
  WindingTiles tiles(count, grid);
  Array<std::uint32_t> sheet;
  if (!grid) {
    sheet = tiles.add(position, search, normal);
  } else {
    sheet.resize(count);
    for (std::size_t begin = 0; begin < count; begin += tile_points) {
      const auto from = static_cast<std::ptrdiff_t>(begin);
      const auto to = static_cast<std::ptrdiff_t>(std::min(begin + tile_points, count));
      const Array<Vec3f> places(position.begin() + from, position.begin() + to);
      Array<Vec3f> normals(normal.begin() + from, normal.begin() + to);
      const Array<std::uint32_t> some = tiles.add(places, normals);
      std::copy(some.begin(), some.end(), sheet.begin() + from);
      std::copy(normals.begin(), normals.end(), normal.begin() + from);
    }
  }
  tiles.finish();
  parallel_each(count, kOrientationGrain,
                [&](std::size_t i) { normal[i] = tiles.side(normal[i], sheet[i]); });
  return tiles.sides().part.size();
}

}  // namespace

std::vector<std::string> OrientationOptions::problems() const {
  std::vector<std::string> found;
  if (viewpoint && !viewpoint->allFinite())
    found.emplace_back("`viewpoint` must be three finite numbers");
  if (!up.allFinite() || up.isZero(0)) found.emplace_back("`up` must be finite and not zero");
  if (tile_points == 0) found.emplace_back("`tile_points` must be at least 1");
  return found;
}

void turn_to_sides(const Array<Vec3f>& position, const NeighborSearch& search,
                   const Array<Vec3f>& side, Array<Vec3f>& normal, Array<float>* confidence) {
  parallel_each(position.size(), kOrientationGrain, [&](std::size_t i) {
    if (normal[i].dot(side[i]) < 0) normal[i] = -normal[i];
  });
  if (!confidence) return;
  confidence->resize(position.size());
  parallel_each(position.size(), kOrientationGrain, [&](std::size_t i) {
    (*confidence)[i] = side[i].isZero(0) ? 0 : certainty_of(side[i]);
  });
  multiply_agreement(position, search, normal, *confidence);
}

OrientationReport orient_normals(const Array<Vec3f>& position, const Vec3d& origin,
                                 const NeighborSearch& search, const Array<Vec3f>& previous,
                                 const OrientationOptions& options, Array<Vec3f>& normal,
                                 Array<float>* confidence) {
  require_usable(options);
  OrientationReport report;
  report.method = options.method;
  if (options.method == Orientation::kAuto) {
    report.method =
        options.viewpoint || !previous.empty() ? Orientation::kViewpoint : Orientation::kWinding;
  }
  const std::size_t count = position.size();
  // Turning a normal changes the sign of its x, of a zero too.
  Array<std::uint8_t> before(count);
  const auto negative = [&](std::size_t i) { return std::signbit(normal[i].x()) ? 1 : 0; };
  parallel_each(count, kOrientationGrain,
                [&](std::size_t i) { before[i] = static_cast<std::uint8_t>(negative(i)); });
  switch (report.method) {
    case Orientation::kAuto:
    case Orientation::kNone:
      break;
    case Orientation::kViewpoint:
    case Orientation::kUp: {
      const bool up = report.method == Orientation::kUp;
      const bool several = !up && !options.viewpoint;
      if (several && previous.size() != count) {
        throw_usage("`viewpoint` is not given, and the points do not tell it; give three numbers");
      }
      if (confidence) confidence->assign(count, 0);
      const Vec3d eye = options.viewpoint.value_or(Vec3d(0, 0, 0)) - origin;
      parallel_each(count, kOrientationGrain, [&](std::size_t i) {
        const Vec3d to = up        ? options.up
                         : several ? Vec3d(previous[i].cast<double>())
                                   : Vec3d(eye - position[i].cast<double>());
        const double toward = normal[i].cast<double>().dot(to);
        if (toward < 0) normal[i] = -normal[i];
        if (confidence && to.norm() > 0)
          (*confidence)[i] = static_cast<float>(std::abs(toward) / to.norm());
      });
      break;
    }
    case Orientation::kWinding: {
      Array<Vec3f> side = normal;
      report.components = winding_sides_of(position, search, options.tile_points, side);
      turn_to_sides(position, search, side, normal, confidence);
      break;
    }
    case Orientation::kMst:
    case Orientation::kOutward:
    case Orientation::kAlign: {
      Spreader spreader(position, search, normal);
      if (options.method == Orientation::kAlign) spreader.settle(align(previous, normal));
      spreader.spread();
      report.components = spreader.parts();
      const Array<std::uint32_t>& part = spreader.part();
      const std::uint32_t settled = spreader.settled() == kNone ? kNone : part[spreader.settled()];
      turn_parts(position, part, settled, options.method, before, normal);
      if (confidence) {
        confidence->assign(count, 1);
        multiply_agreement(position, search, normal, *confidence);
      }
      break;
    }
  }
  const auto unknown = [&](std::size_t i) { return normal[i].isZero(0); };
  report.unknown = count_where(count, unknown);
  report.flipped =
      count_where(count, [&](std::size_t i) { return !unknown(i) && negative(i) != before[i]; });
  return report;
}

}  // namespace surfel
