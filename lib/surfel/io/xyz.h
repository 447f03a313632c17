#pragma once

#include <memory>
#include <string>
#include <vector>

#include <surfel/io/cloud_from_records.h>
#include <surfel/io/input_file.h>

namespace surfel {

/// Does the name end like a text file of points (.xyz .txt .pts .asc .csv .xyzn .xyzrgb)?
bool is_xyz_name(const std::string& path);

/// The points of a text file, one point a line (which ends in LF, CR LF or CR). Numbers are
/// separated by blanks, tabs, commas or semicolons. Empty lines and lines that start with # or //
/// are skipped.
///
/// A first line of one whole number is the count of the points that follow (PTS). After as many
/// points, a line of one whole number starts a further list with its own count. A line of names
/// above the points names the columns, as PLY names its properties; other names are kept as
/// properties. A comment above the points names the columns, too, if it has as many words as the
/// points have columns and x, y and z are among the words. Without names the number of columns
/// decides:
///
/// - 3: x y z
/// - 4: x y z intensity
/// - 6: x y z nx ny nz if every line's last three numbers have a length of 1 within 1 %, or 0
///   (unknown); else x y z r g b
/// - 7: x y z intensity r g b
/// - 9: x y z nx ny nz r g b, if the middle triple of every line has a length of 1 or 0 likewise;
///   else x y z r g b nx ny nz
///
/// `columns` wins over all of that: the names of the columns, "-" for one to be left out.
///
/// Colours are sRGB codes: of 8 bits or of 16 where all are whole numbers, as the largest tells;
/// otherwise, and where none is above 1, 0..1, 0..255 or 0..65535 by the largest. They are linear
/// light where a comment above the points has the word "linear". Numbers with decimal commas are
/// refused where a line cannot be taken for numbers that commas part. Throws Error(kInput) naming
/// the line for a word that is no number, for a line with another number of columns than the lines
/// before, and for more or fewer points than the count.
///
/// The text is read block by block, in parallel: once to know its lines and the values of its
/// columns, and again whenever points are asked for. Internal to the io module.
class XyzPoints final : public PointRecords {
 public:
  explicit XyzPoints(InputFile file, const std::vector<std::string>& columns = {});
  ~XyzPoints() override;

  const RecordTable& table() const override;
  const std::string& file() const override;
  bool double_positions() const override { return false; }
  void describe(SurfelCloud&) const override {}

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
