#pragma once

#include <memory>
#include <string>

#include <surfel/io/cloud_from_records.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The points of all scans of an E57 file (ASTM E2807), read block by block and in parallel; every
/// page that is read is checked.
///
/// Cartesian coordinates, else spherical ones, are moved by their scan's pose, in double. Points
/// that the file marks as not measured are left out (SurfelCloud::unmeasured_skipped). Colours are
/// sRGB codes between the limits that the file tells: of 8 bits where all ranges are whole numbers
/// up to 255, else of 16; those marked as invalid become SurfelCloud::colorless(). Normals (the
/// extension of libE57) are turned by the pose. All other fields but strings become properties,
/// named in lower case and without prefix ("rowIndex" is row_index); intensities marked as invalid
/// are NaN. Where there are several scans the property `scan` counts them from 0; fields that some
/// scans lack are NaN there, or 0 where they are integers.
///
/// A scan's pose tells where its scanner stood, as do coordinates that are spherical or in rows
/// where there is no pose: that is the cloud's viewpoint, or SurfelCloud::scan_viewpoints. An
/// identity pose of Cartesian points without rows tells nothing, because programs write it around
/// points from anywhere. Up is z where it is known where the scanners stood. Internal to the io
/// module.
class E57Points final : public PointRecords {
 public:
  /// Throws Error(kInput) naming the file, as reading the points does.
  explicit E57Points(InputFile file);
  ~E57Points() override;

  const RecordTable& table() const override;
  const std::string& file() const override;
  bool double_positions() const override;
  void describe(SurfelCloud& cloud) const override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
