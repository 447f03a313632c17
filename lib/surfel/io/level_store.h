#pragma once

// A store of levels of detail is a folder: blocks of neighbouring surfels, each a PLY file with its
// own levels, a PLY file with the levels above all blocks, and an index that names them. Whatever
// the order in which surfels were added to it, it has the same files. Readers of files open it as
// the one PLY file with levels that it stands for (InputFile).

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/curve_cell.h>
#include <surfel/base/export.h>
#include <surfel/io/ply.h>

namespace surfel {

/// A file of a store as the index has it.
struct LevelStorePart {
  std::string file;                     ///< Its name in the folder.
  std::uint32_t checksum = 0;           ///< Of all that follows its header.
  std::vector<std::uint32_t> surfels;   ///< Of each level, finest first.
  std::vector<std::uint32_t> clusters;  ///< Likewise.

  std::uint64_t all_surfels() const;
  std::uint64_t all_clusters() const;
};

/// The surfels in a cell of space, and their levels up to one cluster.
struct LevelStoreBlock : LevelStorePart {
  CurveCell cell;
};

/// What index.json of a store of levels tells (docs/format.md).
struct LevelStoreIndex {
  int reduction = 3;               ///< HierarchyOptions::reduction of all levels.
  double normal_angle = 40;        ///< SheetRules::normal_angle.
  double sheet_weight = 3;         ///< SheetRules::sheet_weight.
  std::uint32_t most_surfels = 0;  ///< Most surfels of the finest level of a block.
  /// The finest level has the coarsest clusters of all blocks, in their order, and coarser levels
  /// are above them.
  LevelStorePart top;
  std::vector<LevelStoreBlock> blocks;  ///< One at least; all have as many levels as each other.

  std::size_t block_levels() const { return blocks.front().surfels.size(); }
};

/// Name of the index in the folder, which makes the folder a store.
inline constexpr const char* kLevelStoreIndex = "index.json";
/// Word of the line obj_info in the header of a store's files; their checksum comes after it.
inline constexpr const char* kLevelStoreChecksum = "surfel_store_checksum";

/// Path of a file in a folder, whether the folder's name ends in a slash or not.
SURFEL_API std::string path_in(const std::string& folder, const std::string& file);
SURFEL_API bool is_level_store(const std::string& folder);

/// Reads the index of a store. Throws Error (kIo, kInput) naming it where it is not whole.
SURFEL_API LevelStoreIndex read_level_store(const std::string& folder);
/// The bytes of an index.
SURFEL_API std::string level_store_text(const LevelStoreIndex& index);

/// A checksum as the index, headers and names of files have it.
SURFEL_API std::string checksum_text(std::uint32_t checksum);

/// Opens a file of a store. Throws Error (kIo, kInput) where it is missing, was cut short, or is
/// not the file that the index names; of its surfels nothing is read.
SURFEL_API PlyFile open_part(const std::string& folder, const LevelStorePart& part);
/// Throws Error(kInput) where the surfels or clusters of an open file are not those that the index
/// names. Reads all of them.
SURFEL_API void check_part(PlyFile& file, const LevelStorePart& part);

}  // namespace surfel
