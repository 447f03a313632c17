#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/cloud/cloud.h>

namespace surfel {

struct CloudReadOptions {
  bool levels = false;  ///< All levels of detail, and their tree.
};

/// Reads surfels or points from PLY (ascii, binary of either byte order) or PCD (ascii, binary,
/// binary_compressed, organised), told apart by content, or from text (XYZ, PTS, CSV; by name); "-"
/// is standard input (PLY). Liberal as design.md section 2 says: any property order and type, list
/// properties and other elements skipped, unknown scalar properties kept in `extra`. Integer
/// colours are decoded from sRGB. Positions that are not finite are kept (the tools count or drop
/// them). The origin is (0, 0, 0) unless the file has double positions or lies so far from the
/// origin that float offsets would lose precision. Throws Error (kIo, kInput) naming the file and
/// the line or element. Of a file with levels of detail (surfel-lod) the finest alone is read,
/// unless all are asked for; SurfelCloud::coarser_skipped tells.
SURFEL_API SurfelCloud read_cloud(const std::string& path, const CloudReadOptions& options = {});

struct CloudWriteOptions {
  bool no_clobber = false;
  bool ascii = false;  ///< PLY ascii instead of binary little-endian.
};

/// Writes binary little-endian PLY ("-" for standard output) or, where the name ends in .pcd,
/// binary PCD. Whole or not at all (OutputFile). `radius` is written beside every variance, for
/// other viewers. Levels of detail are kept in PLY only: the tree is an element of its own
/// (tree_records.h). Throws Error(kIo), and Error(kUsage) for levels of detail in PCD.
SURFEL_API void write_cloud(const SurfelCloud& cloud, const std::string& path,
                            const CloudWriteOptions& options = {});

}  // namespace surfel
