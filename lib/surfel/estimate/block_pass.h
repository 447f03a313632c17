#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/peers.h>
#include <surfel/base/types.h>
#include <surfel/estimate/block_sizes.h>
#include <surfel/estimate/estimate.h>
#include <surfel/estimate/estimate_facts.h>
#include <surfel/estimate/halo_loader.h>
#include <surfel/estimate/normals.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/surface/exact_search.h>
#include <surfel/surface/halo_search.h>
#include <surfel/surface/neighbor_lists.h>

namespace surfel {

/// A cloud that is estimated by blocks, and what all passes over it have to know.
struct BlockCloud {
  const SurfelRanges& points;
  EstimateOptions options;  ///< `grow_in_noise` is off, as normals of blocks never grow.
  const EstimateFacts& facts;
  CloudRules rules = {};
  BlockSizes sizes = {};
  MortonGrid grid;     ///< Of the points.
  std::string beside;  ///< File on whose disk scratch files are.
  std::string name;    ///< Of the cloud, for messages.
  Peers* peers = nullptr;

  const RunIndex& index() const { return facts.index; }
  std::size_t finite() const { return facts.index.finite(); }
};

/// Points that one thread takes at a time.
inline constexpr std::size_t kBlockGrain = std::size_t{1} << 14;

/// Points that are in memory with their halo.
struct LoadedBlock {
  const HaloPoints& points;
  Array<std::uint8_t> wanted;  ///< 1: a point of the block that is looked at.

  /// Calls body(i, number among the block's points) for the wanted points that are certain, in
  /// parallel.
  template <class Body>
  void for_each_certain(const HaloSearch& search, const Body& body) const {
    parallel_each(points.size(), kBlockGrain, [&](std::size_t i) {
      if (wanted[i] != 0 && search.certain(i)) body(i, points.point[i]);
    });
  }
};

/// Reads blocks of a cloud, and looks at their points among halos that are as wide as each point
/// turns out to need.
class BlockPass {
 public:
  /// Keeps a reference to the cloud.
  BlockPass(const BlockCloud& cloud, HaloOptions halo);
  /// Halos for the neighbourhoods of normals.
  static HaloOptions normal_halo(const BlockCloud& cloud);

  /// Reads the finite points of consecutive runs.
  BlockPoints read(std::size_t begin_run, std::size_t end_run, bool all_columns) const;
  /// The points of a block along the curve; measures how wide their halos should be.
  Array<std::uint32_t> along_curve(BlockPoints& block) const;
  /// Loads points of a block, given along the curve, with their halos, and calls look(loaded),
  /// which returns the points that it is not certain of (uncertain()), until there are none.
  void look_at(Array<std::uint32_t> points, const BlockPoints& block,
               FunctionRef<HaloTask(const LoadedBlock&)> look) const;
  /// The wanted points that are not certain, with what they need.
  HaloTask uncertain(const LoadedBlock& loaded, const HaloSearch& search,
                     const BlockPoints& block) const;

 private:
  std::vector<HaloRegion> needed_regions(const LoadedBlock& loaded, const HaloSearch& search,
                                         const HaloTask& uncertain, const BlockPoints& block) const;

  const BlockCloud& cloud_;
  std::function<Array<Vec3f>(const SurfelCloud& points, std::size_t run)> directions_;
  HaloLoader halos_;
};

/// The normals of points that are loaded with their halo, and the searches that later stages use.
struct HaloNormals {
  /// Keeps references to the points.
  HaloNormals(const LoadedBlock& loaded, const BlockCloud& cloud);

  const ExactSearch tree;
  const NeighborLists lists;
  HaloSearch search;
  NormalEstimate normals;
};

}  // namespace surfel
