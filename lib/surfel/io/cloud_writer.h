#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

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
/// gets the steps of SurfelCloud::las, and columns that it has no field for as extra bytes; values
/// that its fields do not hold are scaled, rounded or clamped. Returns a line for each column that
/// the file holds otherwise than the cloud. Throws Error(kIo), and Error(kUsage) for levels of
/// detail in other formats.
SURFEL_API std::vector<std::string> write_cloud(const SurfelCloud& cloud, const std::string& path,
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
  /// \param path     The file, whose extension tells the format.
  /// \param survey   Survey of all pieces that will be written.
  /// \param options  Whether an older file is kept, and whether PLY is text.
  CloudWriter(std::string path, CloudSurvey survey, const CloudWriteOptions& options = {});
  ~CloudWriter();
  CloudWriter(const CloudWriter&) = delete;
  CloudWriter& operator=(const CloudWriter&) = delete;

  /// Writes the next surfels. The first piece decides on the columns and comments of the file.
  /// Throws Error(kInput) if a later piece has other columns or positions that need another type,
  /// or if a cloud with levels of detail is written in more than one piece.
  void append(const SurfelCloud& piece);
  /// Completes the file; returns what write_cloud() does. Throws Error(kInput) unless `count`
  /// surfels were written.
  std::vector<std::string> commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
