#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/base/peers.h>
#include <surfel/base/timing.h>
#include <surfel/scene/level_sink.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/usable_surfels.h>
#include <surfel/surface/sheet.h>

namespace surfel {

/// Shape of the levels that build_hierarchy() makes.
struct HierarchyOptions {
  /// Surfels of a level for one surfel of the next coarser level, 2..16: finer steps come closer to
  /// what a picture needs, and make a larger file (1 / (reduction - 1) more surfels).
  int reduction = 3;
  SheetRules sheets = {};
  /// Levels of a block at least, >= 1. Trees over whole clouds of different sizes have as many
  /// levels as each other where each is one block and none needs more.
  int least_levels = 1;
  /// Bytes that may be taken, besides what the source and the sink hold; 0: no limit. The result
  /// does not depend on it.
  std::uint64_t memory = 0;
  Checkpoints* checkpoints = nullptr;  ///< Keeps the blocks that are finished; null: none.
  /// Processes among which the blocks are shared, which all call build_hierarchy() with the same
  /// arguments; null: this one alone. The sink of each gets the surfels of its blocks, the first
  /// one's also the levels above, and the tree.
  Peers* peers = nullptr;

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// The surfels that build_hierarchy() left out, and the levels that it made.
struct HierarchyReport {
  UnusableSurfels dropped;          ///< Surfels left out of all levels.
  std::vector<std::size_t> levels;  ///< Surfels of each level, finest first.
  std::vector<double> spacing;      ///< By level: root of the mean square by area, scene units.
  std::size_t surfels = 0;          ///< Of all levels.
  std::size_t clusters = 0;
  std::size_t blocks = 0;
  std::size_t blocks_at_once = 0;  ///< Blocks that the threads worked on at the same time.
  StageTimes stages;               ///< cut, merge, join.
};

/// Makes levels of detail: the surfels of a cloud and, level by level, fewer surfels that stand for
/// the surface, with the tree of their clusters.
///
/// The order of morton_order() is cut into blocks (curve_blocks.h). The surfels of a block are cut
/// in two by their positions, across the longer side, until clusters of kClusterSurfels are left
/// (all but one are full). A cluster of the next level holds the surfels of `reduction`
/// neighbouring clusters, merged into `reduction` times fewer (surfel_partition.h, surfel_merge.h),
/// and so on to one cluster a block. Blocks are joined by boxes to the clusters of further levels
/// (level_plan.h), up to a single one. All variances become anisotropic; attributes that are not
/// merged come from one of the members. The result depends neither on the memory nor on the number
/// of threads, nor on the order of the surfels in memory. Time: about 2.5 s for 4.8 million
/// surfels on 2 threads.
///
/// Returns false, before the sink is told anything, if the ranges are in another order than
/// morton_order(). Throws Error(kUsage) for bad options, Error(kInput) if the cloud has no
/// variance, no usable surfel, too many surfels for 32-bit indices, or needs more memory; `name`
/// starts the messages.
SURFEL_API bool build_hierarchy(const SurfelRanges& ranges, const HierarchyOptions& options,
                                LevelSink& sink, HierarchyReport* report = nullptr,
                                const std::string& name = {});

/// The same for a cloud in memory, in any order; the result has the tree (SurfelCloud::tree).
SURFEL_API SurfelCloud build_hierarchy(const SurfelCloud& cloud, const HierarchyOptions& options,
                                       HierarchyReport* report = nullptr,
                                       const std::string& name = {});

/// Makes the levels above trees of levels of detail that are as high as each other. The finest
/// level of what the sink gets has the roots of the trees, unchanged, as its clusters, in an order
/// of their boxes.
/// \param surfels      Surfels of all roots, with the columns of levels.
/// \param roots        The root of each tree, one at least: its surfels by their numbers in
///                     `surfels`, and its bounds relative to the origin of `surfels`.
/// \param roots_level  Level of detail of the roots. Merged surfels get higher ones.
/// \param options      The options that the trees were made with.
/// \param sink         Gets the surfels and the clusters of all levels from the roots on.
/// \param report       If not null, filled.
/// \param name         Starts the messages of errors.
/// \return For each tree the place of its root among the clusters of the finest level.
///
/// The result depends on the order of the trees where their boxes have equal middles, and on the
/// order of the surfels within a root. Throws Error(kUsage) for bad options.
SURFEL_API std::vector<std::size_t> join_hierarchies(
    const SurfelCloud& surfels, const ClusterTree& roots, std::size_t roots_level,
    const HierarchyOptions& options, LevelSink& sink, HierarchyReport* report = nullptr,
    const std::string& name = {});

}  // namespace surfel
