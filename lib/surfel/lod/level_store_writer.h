#pragma once

// Stores of levels of detail (io/level_store.h), made and appended to.
//
// A block is the largest cell of the octree through all of space that holds at most so many
// surfels, so that the blocks depend on the surfels alone. Its file has the surfels themselves as
// they came, bit by bit, and the levels that build_hierarchy() makes of them, which depend on
// nothing else. Surfels that are added can but fill blocks, divide them and make new ones: all
// other files stay as they are. The levels above all blocks are made anew of the blocks' roots.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/timing.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>

namespace surfel {

/// Shape of the levels of a store, and the memory to make them in.
struct LevelStoreOptions {
  /// Of all levels; checkpoints, peers and least_levels have no effect. `memory` is what sorting
  /// and the levels above all blocks may take.
  HierarchyOptions hierarchy = {};
  /// Most surfels of a block, 1..most_block_surfels() of the reduction; 0: as many.
  std::size_t block_surfels = 0;
  bool no_clobber = false;  ///< Refuse a folder that has a store already.

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// What was written to a store.
struct LevelStoreReport {
  UnusableSurfels dropped;          ///< Surfels that were left out.
  std::uint64_t added = 0;          ///< Surfels that were not.
  std::vector<std::size_t> levels;  ///< Surfels of each level of the whole store, finest first.
  std::size_t clusters = 0;         ///< Of the whole store.
  std::size_t blocks = 0;           ///< Of the whole store.
  std::size_t blocks_written = 0;
  std::uint64_t bytes_written = 0;  ///< Of all files that were written and stay.
  std::uint64_t bytes_sorted = 0;   ///< Of the sorted surfels, which took disk meanwhile.
  StageTimes stages;                ///< sort, blocks, top.
};

/// Hands on all surfels piece by piece, the same whenever it is called.
using SurfelPieces = FunctionRef<void(FunctionRef<void(SurfelCloud piece)> visit)>;

/// Makes a store, in a folder that is not there, is empty, or has another store, which it replaces:
/// until the new one is whole, and if anything fails, the older one stays. The surfels may be in
/// any order; they are handed on twice. They are sorted on the disk of the store (cloud_sort.h),
/// which takes as much as they do, and twice that where they do not fit into memory; some blocks
/// are in memory at a time, and the roots of all. The files have the same bytes for any order of
/// the surfels, memory and number of threads.
///
/// Throws Error(kUsage) for bad options, Error(kInput), starting with `name`, for surfels without
/// variance, pieces of unlike columns, no surfel that can be drawn, and too many at one place, and
/// Error(kIo) where something cannot be written, or where another process writes to the store.
SURFEL_API void make_level_store(const std::string& folder, SurfelPieces pieces,
                                 const LevelStoreOptions& options,
                                 LevelStoreReport* report = nullptr, const std::string& name = {});

/// Adds surfels, with the columns of level_store_head(), to a store: it has the files that
/// make_level_store() makes of all surfels together. Blocks that no surfel is added to are not
/// written, and of their files the roots alone are read. Whenever the process ends, the store is
/// the older one or the new one; what a process that was killed left in the folder is removed by
/// the next one. \param memory  bytes, as HierarchyOptions::memory. Throws as make_level_store(),
/// and Error(kInput) where a file of the store is missing or damaged.
SURFEL_API void append_to_level_store(const std::string& folder, SurfelPieces pieces,
                                      std::uint64_t memory, LevelStoreReport* report = nullptr,
                                      const std::string& name = {});

/// A surfel of a store, with all columns, and all that the store tells of its surfels.
SURFEL_API SurfelCloud level_store_head(const std::string& folder);

}  // namespace surfel
