#pragma once

#include <optional>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/io/input_file.h>
#include <surfel/io/las_header.h>
#include <surfel/io/laz_points.h>

namespace surfel {

/// Part of a COPC file: an octree whose nodes are chunks of LAZ, where each level adds points to
/// the coarser ones.
struct CopcPart {
  std::vector<LazChunk> chunks;  ///< In the order of the file.
  std::uint64_t count = 0;       ///< Points in all.
};

/// The nodes of the levels up to `level` (0: the root alone; unset: all) that meet `bounds` (unset:
/// all). Only pages of the tree that may hold such nodes are read. The tree is checked against the
/// file's size. Throws Error(kInput) naming the file, also where it is no COPC file. Internal to
/// the io module.
CopcPart copc_part(const InputFile& file, const LasHeader& header, std::optional<int> level,
                   const std::optional<Bounds>& bounds);

}  // namespace surfel
