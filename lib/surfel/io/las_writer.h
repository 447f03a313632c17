#pragma once

#include <memory>
#include <string>
#include <vector>

#include <surfel/io/cloud_survey.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Writes surfels or points as LAS, or, if the name ends in .laz, as LAZ in chunks of 50,000 points
/// that are compressed in parallel: LAS 1.2 with point formats 0 to 3, or 1.4 with 6 to 8 where a
/// column (`nir`, `scan_angle`, `overlap`, `scanner_channel`), a value that formats 0 to 3 do not
/// hold, or the number of points wants it, or the cloud came from such a file (SurfelCloud::las).
/// Columns with the names of las_fields(), case aside, fill these fields: `intensity` and `nir` of
/// 0 to 1 times 65535, of 0 to 255 with fractions times 257, and moved and scaled into 16 bits
/// where more than ten values, and one in 100, lie outside of them; a `scan_angle` with fractions
/// is taken for degrees; all other values are rounded and clamped, and what is not a number becomes
/// 0. All other columns are extra bytes under their names, of 32 characters at most. Colours have
/// 16 bits, but 8 where the cloud came from LAS with 8. Coordinates have the scale and offset of
/// SurfelCloud::las where that reaches; else the scale is SurfelCloud::decimals', or the power of
/// ten that is finer than the cloud's positions, or, where floats do not hold these, the finest one
/// that reaches. How pieces are cut does not change the file, which
/// appears whole or not at all (OutputFile). Internal to the io module.
class LasWriter {
 public:
  /// \param survey  of all pieces that will be written
  ///
  /// Throws Error(kIo), and Error(kInput) for positions that are not finite.
  LasWriter(std::string path, const CloudSurvey& survey, bool no_clobber);
  ~LasWriter();
  LasWriter(const LasWriter&) = delete;
  LasWriter& operator=(const LasWriter&) = delete;

  /// Writes the next surfels. The first piece decides on the columns, the steps of coordinates and
  /// the blocks of the file.
  /// \param comments  lines that are stored in a block of their own; the first piece's count
  void append(const SurfelCloud& piece, const std::vector<std::string>& comments);
  /// Completes the file. Returns a line for each column whose values or name the file holds
  /// otherwise than the cloud: "intensity: 3 of 500 values clamped to 0 to 65535".
  std::vector<std::string> commit();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Who defines the block of comments, and its number.
inline constexpr const char* kCommentUser = "surfelkit";
inline constexpr int kCommentId = 1;

}  // namespace surfel
