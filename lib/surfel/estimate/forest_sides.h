#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/morton.h>
#include <surfel/base/scratch_file.h>
#include <surfel/base/types.h>
#include <surfel/estimate/block_forest.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/spanning_forest.h>
#include <surfel/estimate/surface_parts.h>

namespace surfel {

/// Which points' normals have to be turned.
struct TurnedPoints {
  std::size_t parts = 0;              ///< Of the surface.
  std::vector<std::uint64_t> turned;  ///< A bit a point.

  /// By the point's number among the finite points of the cloud.
  bool operator[](std::uint64_t number) const {
    return (turned[number / 64] >> number % 64 & 1) != 0;
  }
};

/// Sides that spread from edge to edge (kMst, kOutward) of a cloud that is not in memory, the same
/// as orient_normals() finds: the minimum spanning forest does not depend on the blocks.
///
/// The forests of blocks wait on scratch files; the edges between blocks are kept in
/// memory. Once all of these are known, points of a block are united along the edges that are the
/// shortest of all edges that leave a set of points [Boruvka 1926]. Such sets hold a point at the
/// block's border each, or are whole parts. Kruskal's algorithm unites them along the other edges.
///
/// To be called in this order: add() for all blocks, unite(), then, if looks_for_joins(), joins()
/// for blocks and join(), and turn(). Where that takes more memory than is given, Error(kUsage)
/// says how much is needed.
class SURFEL_API ForestSides {
 public:
  struct Options {
    Orientation method = Orientation::kMst;
    std::uint64_t memory = 0;     ///< Bytes that may be taken.
    std::uint64_t of_memory = 0;  ///< Bytes of which `memory` is the part for sides, for messages.
    std::string beside;           ///< File on whose disk the scratch files are.
  };
  /// \param count  finite points of the cloud. Throws Error(kIo) where the disk has no room.
  ForestSides(std::size_t count, const MortonGrid& grid, Options options);

  /// Bytes that a point takes on the disk.
  static constexpr std::uint64_t bytes_on_disk() {
    return sizeof(Point) + sizeof(InnerEdge) + sizeof(PointSet);
  }

  /// Adds the next block of the cloud.
  void add(const BlockForest& block);
  /// Unites the points along the forest.
  void unite();

  /// Are there parts that may be joined?
  bool looks_for_joins() const { return part_points_.size() > 1; }
  /// Points in memory, with what find_joins() asks for.
  struct Parts {
    Array<Vec3f> normal;
    Array<std::uint32_t> part;
    Array<std::uint8_t> opposed;
  };
  /// The parts of points, by their numbers; after unite().
  Parts parts_of(std::span<const std::uint64_t> numbers) const;
  bool comes(const Parts& parts, std::size_t i) const {
    return parts.part[i] != PartVotes::kNoPart && parts.part[i] != largest_;
  }
  PartJoins joins() const { return PartJoins(order_); }
  /// Throws Error(kUsage) where the memory does not hold what is found between parts.
  /// \param share_done  of the points around which joins were looked for, 0..1: the rest is
  ///                    expected to need as much.
  void require_room_for(PartJoins& joins, double share_done) const;
  /// Unites parts.
  void join(PartJoins& joins);

  /// Turns the parts.
  TurnedPoints turn() const;

 private:
  using Point = BlockForest::Point;
  using InnerEdge = BlockForest::InnerEdge;
  using Edge = BlockForest::Edge;
  /// A point that an edge to another block leads from or to.
  struct Border {
    std::uint64_t number;
    std::uint32_t shortest;  ///< Of edges_.
    std::uint32_t set;
    std::uint8_t opposed;
  };
  struct Block {
    std::size_t begin = 0, end = 0;         ///< Points.
    std::uint64_t edges_at = 0, edges = 0;  ///< Offset on the scratch file, and how many.
  };
  /// A set of points with one side.
  struct Set {
    std::uint32_t part;
    std::uint8_t opposed;  ///< The set's sign is the other than its part's.
  };

  /// Where a point stands.
  struct PointSet {
    std::uint32_t bits = ~std::uint32_t{0};

    static PointSet of(std::uint32_t set, bool opposed) { return {set << 1 | (opposed ? 1U : 0U)}; }
    std::uint32_t set() const { return bits >> 1; }
    /// Is its sign the other than its set's?
    bool opposed() const { return (bits & 1) != 0; }
  };
  /// Of points without a normal.
  static constexpr std::uint32_t kNoSet = (std::uint32_t{1} << 31) - 1;

  bool before(const Edge& a, const Edge& b) const;
  void find_borders();
  void contract(const Block& block, std::span<Border> borders);
  void number_parts(SignedSets& united);
  void find_largest();
  void require_memory(double share_done) const;
  void require_bytes(double needed) const;
  template <class Body>
  void for_each_block(const Body& body) const;
  std::uint32_t part_of(PointSet at) const {
    return at.set() == kNoSet ? PartVotes::kNoPart : sets_[at.set()].part;
  }
  std::uint8_t opposed(PointSet at) const {
    return at.set() != kNoSet && at.opposed() != (sets_[at.set()].opposed != 0) ? 1 : 0;
  }

  std::size_t count_;
  CurveOrder order_;
  Options options_;
  std::size_t added_ = 0;
  std::vector<Block> blocks_;
  ScratchFile points_;                ///< A Point of each.
  std::optional<ScratchFile> inner_;  ///< Inner edges, block by block.
  ScratchFile point_set_;             ///< A PointSet of each point.
  std::vector<Edge> edges_;  ///< The edges between blocks; in unite() also the ones left in blocks.
  std::vector<Border> borders_;
  std::vector<std::uint32_t> set_points_;  ///< By set.
  std::vector<Set> sets_;
  std::vector<std::uint64_t> part_points_;
  std::uint32_t largest_ = PartVotes::kNoPart;
};

}  // namespace surfel
