#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/io/ply.h>
#include <surfel/scene/surfel_cloud.h>

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

/// The same of a file that is open.
SURFEL_API SurfelCloud read_cloud(InputFile input, const CloudReadOptions& options = {});
SURFEL_API SurfelCloud read_cloud(PlyFile& ply, const CloudReadOptions& options = {});

/// Sorts a header's comments into the cloud's fields: what applies to the whole cloud, and the
/// others. `file` names it in messages.
SURFEL_API void read_comments(const std::vector<std::string>& comments, const std::string& file,
                              SurfelCloud& cloud);

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

/// Writes a cloud that need not be in memory at once, as write_cloud() would.
class SURFEL_API CloudWriter {
 public:
  /// Of `count` surfels in all.
  CloudWriter(std::string path, std::size_t count, const CloudWriteOptions& options = {});
  ~CloudWriter();
  CloudWriter(const CloudWriter&) = delete;
  CloudWriter& operator=(const CloudWriter&) = delete;

  /// Writes the next surfels. The first ones' columns and comments are the file's; Error(kInput)
  /// where later ones' columns differ, or positions would need another type, or a piece has levels
  /// of detail.
  void append(const SurfelCloud& piece);
  /// Throws Error(kInput) if there were more or fewer than promised.
  void commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
