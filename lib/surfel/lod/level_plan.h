#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/curve_blocks.h>

namespace surfel {

/// Most surfels of a block, for which it becomes a cluster that is full: kClusterSurfels times the
/// largest power of `reduction` that leaves blocks of at most 2^17 surfels. With larger blocks less
/// of the tree lies above them, in memory at once; smaller ones stay in a processor's cache.
SURFEL_API std::size_t most_block_surfels(int reduction);

/// A part of a level of the tree, or a whole level.
struct LevelPart {
  std::size_t first_surfel = 0;  ///< Of the tree, the coarsest level's first.
  std::size_t first_cluster = 0;
  std::size_t surfels = 0;
  std::size_t clusters = 0;
};

/// Where the surfels and clusters of all levels go, which is known from the sizes and boxes of
/// blocks before any surfel is merged. Blocks are trees of the same height, each with one cluster
/// in its coarsest level. A cluster of the levels above has as children the blocks, or clusters, of
/// a box: all are cut in two across the longest side of their box, until the children's surfels, by
/// `reduction` fewer, fit into a cluster.
class SURFEL_API LevelPlan {
 public:
  /// \param blocks  one at least
  LevelPlan(const std::vector<CurveBlock>& blocks, int reduction);

  std::size_t levels() const { return levels_.size(); }
  std::size_t block_levels() const { return block_levels_; }
  std::size_t surfels() const { return levels_[0].first_surfel + levels_[0].surfels; }
  std::size_t clusters() const { return levels_[0].first_cluster + levels_[0].clusters; }
  const LevelPart& level(std::size_t level) const { return levels_[level]; }
  /// What a block has of each of its levels, finest first.
  std::vector<LevelPart> block(std::size_t block) const;

  /// A level above the blocks: its clusters, with surfels and children counted from the tree's
  /// first, and the box around the positions of the finest level below each. Other bounds are to be
  /// filled in.
  struct Upper {
    TreeCluster cluster;
    std::pair<Vec3f, Vec3f> box;
  };
  const std::vector<Upper>& upper(std::size_t level) const { return upper_[level - block_levels_]; }

 private:
  /// The first surfel and cluster of a block in one of its levels.
  struct Start {
    std::uint32_t surfel, cluster;
  };
  void place_levels(const std::vector<std::uint32_t>& order);

  int reduction_;
  std::size_t block_levels_ = 0;
  std::vector<std::uint32_t> counts_;      ///< Surfels of the finest level, by block.
  std::vector<std::vector<Upper>> upper_;  ///< By level above the blocks.
  std::vector<LevelPart> levels_;          ///< Finest first.
  std::vector<Start> starts_;              ///< By block, and by level.
};

}  // namespace surfel
