#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/morton.h>
#include <surfel/base/types.h>
#include <surfel/estimate/orientation.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Parts are joined by edges below this weight, to the kJoinNeighbors nearest points.
inline constexpr float kJoinWeight = 0.1F;
inline constexpr std::size_t kJoinNeighbors = 64;

/// A point by its place along the curve through the whole cloud.
struct CurvePlace {
  Vec3f position;
  std::uint64_t number = 0;  ///< Of points at one place the lowest number comes first.
};

/// Tells which of two points comes first along the curve.
class CurveOrder {
 public:
  /// For points whose numbers ascend along the curve.
  CurveOrder() = default;
  /// For points in any order: as morton_order() has them.
  explicit CurveOrder(const MortonGrid& grid) : grid_(grid) {}

  bool operator()(const CurvePlace& a, const CurvePlace& b) const {
    if (grid_ && a.number != b.number) {
      const std::uint64_t code_a = grid_->code(a.position);
      const std::uint64_t code_b = grid_->code(b.position);
      if (code_a != code_b) return code_a < code_b;
      if (before_on_curve(a.position, b.position)) return true;
      if (before_on_curve(b.position, a.position)) return false;
    }
    return a.number < b.number;
  }

 private:
  std::optional<MortonGrid> grid_;
};

/// An edge between two parts of a surface.
struct PartJoin {
  CurvePlace place;                ///< Of the point that found the edge.
  float weight = 0;                ///< As orient_normals() has it.
  std::uint32_t from = 0, to = 0;  ///< The parts.
  std::uint8_t rank = 0;           ///< Of the other point among the nearest ones.
  bool opposed = false;            ///< The signs of the parts differ.
};

/// Edges between parts, of which those are kept that may be in the minimum spanning forest: an edge
/// that closes a cycle of edges before it (by weight, then place, then rank) is in no forest of
/// these and more edges. Whatever the order in which edges are added, the forest is the same.
class SURFEL_API PartJoins {
 public:
  /// Bytes that an edge of the forest takes while more are added.
  static constexpr std::uint64_t kJoinBytes = 200;

  explicit PartJoins(const CurveOrder& order) : order_(order) {}

  const CurveOrder& order() const { return order_; }
  void add(const PartJoin& join);
  void add(const PartJoins& more);
  /// The edges along which Kruskal's algorithm unites parts, in their order.
  std::span<const PartJoin> forest();

 private:
  /// Edges that are kept before the first cycles are looked for.
  static constexpr std::size_t kFew = 1024;

  bool before(const PartJoin& a, const PartJoin& b) const;

  CurveOrder order_;
  std::vector<PartJoin> joins_;
  std::size_t most_ = kFew;  ///< Edges with which cycles are looked for next.
};

/// Points of a surface that may be joined, a value per point in each list.
struct JoinPoints {
  const Array<Vec3f>& position;
  const Array<Vec3f>& normal;  ///< Zero = unknown: not of a part.
  const Array<std::uint32_t>& part;
  const Array<std::uint8_t>& opposed;     ///< 1: the normal is on the other side than its part's.
  std::span<const std::uint64_t> number;  ///< As CurvePlace has it; empty: from 0 on.
};

/// Adds the edges from points to other parts among the kJoinNeighbors nearest points.
/// \param search  searches the positions.
/// \param comes   whether edges from a point are looked for; called in parallel, as is `counts`.
/// \param counts  whether what has just been found around a point may be added.
SURFEL_API void find_joins(const JoinPoints& points, const NeighborSearch& search,
                           FunctionRef<bool(std::size_t)> comes,
                           FunctionRef<bool(std::size_t)> counts, PartJoins& joins);

/// Which parts of a surface have to be turned, so that the furthest point of each in a probed
/// direction (of several, the first along the curve) looks there: up by kMst; by kOutward by the
/// sum over 26 directions. Where the sum is zero, as of an upright plane, the furthest point in the
/// last direction keeps the side that its normal had before.
///
/// Some parts are looked at in one pass over all points: parts() holds as many as kBytes allow.
class SURFEL_API PartVotes {
 public:
  static constexpr std::uint32_t kNoPart = std::numeric_limits<std::uint32_t>::max();
  static constexpr std::size_t kBytes = std::size_t{32} << 20;

  /// Parts that one pass looks at.
  static std::size_t parts(Orientation method);
  /// \param first  part that the pass begins with.
  /// \param count  of the parts, parts() at most.
  PartVotes(Orientation method, std::uint32_t first, std::size_t count, const CurveOrder& order);

  /// Points of the surface.
  struct Points {
    std::span<const Vec3f> position;
    std::span<const Vec3f> normal;         ///< On the side of their part.
    std::span<const std::uint32_t> part;   ///< kNoPart: none.
    std::span<const std::uint8_t> turned;  ///< 1: the normal is on another side than before.
    std::uint64_t first = 0;               ///< Number of the first one; the others follow.
  };
  void add(const Points& points);
  /// Whether each part has to be turned, from the first one on.
  std::vector<bool> turned() const;

 private:
  struct Extreme {
    CurvePlace place;
    float along = 0;   ///< The position by the direction.
    float normal = 0;  ///< The normal by the direction.
    bool turned = false;
    bool any = false;
  };

  std::uint32_t first_;
  std::size_t count_;
  CurveOrder order_;
  std::vector<Vec3f> directions_;
  std::vector<Extreme> extreme_;  ///< By direction, then part.
};

}  // namespace surfel
