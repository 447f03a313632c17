#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// What becomes of materials, scans and columns where clouds are joined.
struct JoinOptions {
  /// For each cloud, the row of the material table that its surfels get, 0..65535; -1: the cloud's
  /// surfels keep their rows. Empty: all surfels keep their rows.
  std::vector<int> material;
  /// The rows of a cloud come after those of the clouds before it, so that no two clouds share
  /// one; not together with `material`.
  bool separate_materials = false;

  /// Empty if usable for so many clouds, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems(std::size_t clouds) const;
};

/// What joining did to the columns.
struct JoinReport {
  /// A column that some clouds lack, and what it is filled with there.
  struct Filled {
    std::size_t cloud;
    std::string column;
  };
  std::vector<Filled> filled;        ///< Columns that a cloud lacked and got defaults for.
  std::vector<std::string> dropped;  ///< What not every cloud had, or not alike.
  bool basis_differs = false;        ///< Coefficients were fitted for different cutoffs.
  bool viewpoints_dropped = false;   ///< Not all clouds know where their scans were taken from.
};

/// Joins clouds piece by piece, so that they need not be in memory at once: what join_clouds()
/// makes of the surfels, each piece about an origin of its own.
class SURFEL_API CloudJoiner {
 public:
  /// \param heads    head() of each cloud, or of any piece of it.
  /// \param options  Rows of the material table that the surfels get.
  /// \param names    One for each cloud, for messages.
  ///
  /// Throws Error(kUsage) for unusable options, and Error(kInput) where a cloud has no variance and
  /// others do.
  CloudJoiner(std::vector<SurfelCloud> heads, const JoinOptions& options,
              std::span<const std::string> names);
  ~CloudJoiner();
  CloudJoiner(const CloudJoiner&) = delete;
  CloudJoiner& operator=(const CloudJoiner&) = delete;

  /// What joining does to the columns.
  const JoinReport& report() const;
  /// Surfels of cloud `k` with the columns and the header of the joined cloud. Pieces of a cloud
  /// come in its order, after all pieces of the clouds before it. Throws Error(kInput) where
  /// separate materials need more than 65,536 rows, and for a scan whose viewpoint is missing.
  SurfelCloud joined(std::size_t k, SurfelCloud piece);

  /// What the constructor needs of a cloud: its first surfel with all columns, and its header.
  static SurfelCloud head(const SurfelCloud& cloud);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The surfels of several clouds in one, in their order. A single cloud keeps all that it has; of
/// several:
///  - what some lack is filled: normal 0 (unknown); area sqrt |V|; alpha 1; colour
///    SurfelCloud::colorless(); coefficients the colour that would be rendered; material and level
///    0; other properties 0;
///  - variances become anisotropic where one cloud's variances are: along any tangent, both the
///    same;
///  - uv, dpdu, dpdv, group and group_radius stay where all clouds have them: there is no value for
///    none. Groups stay as they are: where bodies overlap, splats of one group may;
///  - `source` is numbered anew, so that splats of different clouds never share it;
///  - coordinate systems (scene/coordinate_system.h) that differ are left out;
///  - properties whose types differ become double; colours the wider of their encodings;
///  - provenance and comments follow one another, each line once; `up` stays if all have the same,
///    as does the basis' cutoff of the clouds that have coefficients;
///  - viewpoints stay as they are if all have the same. Else, where they are known of all clouds,
///    each cloud's are scan_viewpoints of the joined cloud, and the property `scan` is numbered
///    anew in the order of the clouds; a cloud with one viewpoint is one scan. Where a cloud does
///    not know them there are none;
///  - colours of which some are recorded light and some are not (meaning_of_colors()) are
///    ColorLight::kMixed; the grey of colourless surfels is not recorded;
///  - positions move to an origin for all.
///
/// \param clouds   The clouds, one at least.
/// \param options  Rows of the material table that the surfels get.
/// \param names    One for each cloud, for messages.
/// \param report   If not null, filled.
///
/// Throws what CloudJoiner throws, and Error(kInput) for more than 2^32 - 1 surfels.
SURFEL_API SurfelCloud join_clouds(std::vector<SurfelCloud> clouds, const JoinOptions& options,
                                   std::span<const std::string> names,
                                   JoinReport* report = nullptr);

}  // namespace surfel
