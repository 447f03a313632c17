#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/io/cloud_survey.h>
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
  /// \param most  surfels of a piece, >= 1; a piece has more only where the file has larger blocks.
  void for_each_placed(std::size_t most, FunctionRef<void(SurfelCloud piece)> visit) const;

  /// Points of the file, before the options leave some out.
  std::uint64_t size() const;
  /// Is a file read piece by piece, and not held in memory? Throws Error(kIo).
  static bool reads_pieces(const std::string& path);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Sorts a header's comments into the fields of the cloud: values that apply to the whole cloud,
/// provenance, and all other comments. `file` is its name, for messages.
SURFEL_API void read_comments(const std::vector<std::string>& comments, const std::string& file,
                              SurfelCloud& cloud);

/// How a file of surfels is written.
struct CloudWriteOptions {
  bool no_clobber = false;
  bool ascii = false;  ///< PLY ascii instead of binary little-endian.
};

/// Writes binary little-endian PLY or, by the name's extension, binary PCD (.pcd), LAS (.las), LAZ
/// (.laz), text (.xyz, .txt, .asc: blanks between the columns, which a comment names, in .xyz only
/// where other programs would not know them; .csv: commas, and a first line of names) or the
/// vertices of OBJ (.obj); "-" is standard output, as PLY. The file appears whole or not at all
/// (OutputFile). Text has the columns of PLY, OBJ has positions, normals and colours alone
/// (columns_left_out()). `radius` is written beside every variance, for other viewers. Levels of
/// detail are written to PLY only, with their tree in an element of its own (tree_records.h). LAS
/// gets the steps of SurfelCloud::las, and columns that it has no field for as extra bytes. Throws
/// Error(kIo), and Error(kUsage) for levels of detail in other formats.
SURFEL_API void write_cloud(const SurfelCloud& cloud, const std::string& path,
                            const CloudWriteOptions& options = {});

/// The columns of a cloud that a file of that name has no place for.
SURFEL_API std::vector<std::string> columns_left_out(const SurfelCloud& cloud,
                                                     const std::string& path);

/// Writes a cloud that need not be in memory at once, as write_cloud() would.
class SURFEL_API CloudWriter {
 public:
  /// Opens a file that will hold `count` surfels. Throws Error(kUsage) for LAS and LAZ, whose
  /// header and fields depend on all points.
  CloudWriter(std::string path, std::size_t count, const CloudWriteOptions& options = {});
  /// Opens a file of any format.
  /// \param survey  of all pieces that will be written
  CloudWriter(std::string path, CloudSurvey survey, const CloudWriteOptions& options = {});
  ~CloudWriter();
  CloudWriter(const CloudWriter&) = delete;
  CloudWriter& operator=(const CloudWriter&) = delete;

  /// Writes the next surfels. The first piece decides on the columns and comments of the file.
  /// Throws Error(kInput) if a later piece has other columns or positions that need another type,
  /// or if a cloud with levels of detail is written in more than one piece.
  void append(const SurfelCloud& piece);
  /// Completes the file. Throws Error(kInput) unless `count` surfels were written.
  void commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
