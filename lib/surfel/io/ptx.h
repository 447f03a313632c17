#pragma once

#include <memory>
#include <string>

#include <surfel/io/cloud_from_records.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Does the name end in .ptx?
bool is_ptx_name(const std::string& path);

/// The points of all scans of a PTX file, text that Leica's programs write: of each scan the
/// number of columns and of rows of its grid, where the scanner stood, its axes, a matrix of four
/// rows, the last of which is the translation, and then x y z intensity, or x y z intensity r g b,
/// column by column. Points are moved by the matrix, in double. Points 0 0 0, which mark lines of
/// sight without a return, are left out (SurfelCloud::unmeasured_skipped). Properties are
/// `intensity`, `row_index`, `column_index` and, where there are several scans, `scan`.
///
/// The viewpoint of a scan is where the matrix moves the scan's origin. Where the matrix moves
/// nothing it is the scanner's place as the file tells it, or the origin where the points form a
/// grid; else it is unknown. Throws Error(kInput) naming file and line.
///
/// The text is read block by block, in parallel: once to know its lines and which points were
/// measured, and again whenever points are asked for. Internal to the io module.
class PtxPoints final : public PointRecords {
 public:
  explicit PtxPoints(InputFile file);
  ~PtxPoints() override;

  const RecordTable& table() const override;
  const std::string& file() const override;
  bool double_positions() const override { return true; }
  void describe(SurfelCloud& cloud) const override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
