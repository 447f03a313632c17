#pragma once

#include <memory>
#include <string>

#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The points of a LAS or LAZ file: versions 1.0 to 1.4, point formats 0 to 10. LAZ is decompressed
/// chunk by chunk, in parallel; of a COPC file only the nodes that the options ask for are, and
/// points outside of the options' bounds may be among them. The header is checked against the
/// file's size before anything is allocated. Fields and extra bytes become columns (LasLayout);
/// colours are 8-bit where none that was read so far is larger than 255, else 16-bit, and left out
/// where all are zero, as writers without colours store them. Up is z. SurfelCloud::las tells how
/// the points were stored; positions keep every step of the file's scale where up to 2^24 of them
/// lie across the points that are read together. Internal to the io module.
class LasPoints final : public PointRecords {
 public:
  /// Throws Error(kInput) naming the file.
  LasPoints(InputFile file, const CloudReadOptions& options);
  ~LasPoints() override;

  const RecordTable& table() const override;
  const std::string& file() const override;
  bool double_positions() const override { return true; }
  void describe(SurfelCloud& cloud) const override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
