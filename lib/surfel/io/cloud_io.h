#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/io/cloud_writer.h>
#include <surfel/io/input_file.h>
#include <surfel/io/ply.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Which part of a file is read, and how.
struct CloudReadOptions {
  bool levels = false;  ///< Read all levels of detail and their tree, not the finest level alone.
  /// Of a COPC file the points of this level and of the coarser ones alone, 0 = the coarsest; no
  /// more of the file is read. Unset: all levels, of any file.
  std::optional<int> level = {};
  /// The points inside alone, world coordinates; of a COPC file little more is read. Unset: all.
  std::optional<Bounds> bounds = {};
  /// Of the points that are left one in so many, the first one on; >= 1.
  std::uint64_t every = 1;

  /// Names of the columns of a text file, as PLY names its properties, "-" for one to be left out:
  /// they win over names in the file. Empty: by the file's names or else by their number.
  std::vector<std::string> columns = {};

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Reads surfels or points from PLY (ascii, binary of either byte order), PCD (ascii, binary,
/// binary_compressed, organised), LAS and LAZ (1.0 to 1.4, all point formats), E57 or binary Expe
/// point sets, which are told apart by content, or from text (PTX, XYZ, PTS, CSV), which is known
/// by the file's name. "-" is standard input, any but text. Properties may have any
/// order and type; list properties and other elements are skipped, and unknown scalar properties
/// are kept in `extra`. Integer colours are decoded from sRGB. Positions that are not finite are
/// kept; the tools count or drop them. The origin is (0, 0, 0) unless the points lie so far from it
/// that float offsets would lose precision. Of a file with levels of detail (surfel-lod) only the
/// finest is read, unless the options ask for all; SurfelCloud::coarser_skipped is the number of
/// surfels left out. Throws Error (kIo, kInput) naming the file and the line or element, and
/// Error(kUsage) for unusable options.
SURFEL_API SurfelCloud read_cloud(const std::string& path, const CloudReadOptions& options = {});
/// Reads surfels or points from a file that is open.
SURFEL_API SurfelCloud read_cloud(InputFile input, const CloudReadOptions& options = {});
SURFEL_API SurfelCloud read_cloud(PlyFile& ply, const CloudReadOptions& options = {});

/// The surfels or points of a file, piece by piece in the order of the file. Binary PLY and PCD
/// files, LAS, LAZ, E57 and text but PLY and PCD are read piece by piece; other files are held in
/// memory.
class SURFEL_API CloudReader {
 public:
  /// Opens a file. Throws as read_cloud() does.
  explicit CloudReader(const std::string& path, const CloudReadOptions& options = {});
  ~CloudReader();
  CloudReader(const CloudReader&) = delete;
  CloudReader& operator=(const CloudReader&) = delete;

  /// The first surfel of the file, whether the options ask for it or not, with all columns and all
  /// that the file says of the whole cloud. Throws as read_cloud() does.
  SurfelCloud first() const;

  /// Hands on what the options ask for, some 2^18 surfels at a time, each piece with an origin of
  /// its own and with all that the file says of the whole cloud. What only all points tell, namely
  /// how many bits the colours of a LAS file have, is right from the second call on. Throws as
  /// read_cloud() does.
  void for_each(FunctionRef<void(SurfelCloud piece)> visit) const;
  /// As for_each(), with the values that read_cloud() gives the surfels: all pieces have its
  /// origin. Reads all coordinates when it is called for the first time, which tells the origin.
  /// \param most   Surfels of a piece, >= 1; a piece has more only where the file has larger
  ///               blocks.
  /// \param visit  Gets the pieces, in the order of the file.
  void for_each_placed(std::size_t most, FunctionRef<void(SurfelCloud piece)> visit) const;

  /// Points of the file, before the options leave some out.
  std::uint64_t size() const;
  /// Is a file read piece by piece, and not held in memory? Throws Error(kIo).
  static bool reads_pieces(const std::string& path);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
