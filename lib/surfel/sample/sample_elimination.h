#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/types.h>
#include <surfel/sample/poisson_disk.h>
#include <surfel/sample/sizing_field.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// What eliminate_samples() chose.
struct EliminatedSamples {
  Array<PoissonSample> sample;  ///< Along a space-filling curve.
  /// Share of the surface's random points that have no sample of their sheet within
  /// PoissonDisk::kCoverageRadius spacings.
  double uncovered = 0;
};

/// Bytes of all tables of eliminate_samples(), per sample.
inline constexpr double kEliminationBytes = 1000;

/// Samples of a surface at a cost that depends on their number alone, however long and thin the
/// triangles are: of five random points for each sample the most crowded one is taken out again and
/// again (Yuksel 2015, "Sample Elimination for Generating Poisson Disk Sample Sets").
///
/// Connections of faces are not followed. Two points are of one sheet where their faces agree in
/// direction (PoissonDisk::kAgreeCosine), so that sheets which face the same way within a spacing
/// share their samples; faces that turn aside see each other at the smaller distance that
/// PoissonDisk keeps as well. Loose slivers narrower than the spacing are not covered along their
/// length: `uncovered` tells.
///
/// \param component  face_components() of the mesh; each keeps a sample, even where they are more
///                   than `count`.
/// \param spacing    in units of the field: the root of the area per sample.
///
/// The samples do not depend on the number of threads. 5 microseconds of one core a sample.
EliminatedSamples eliminate_samples(const TriangleMesh& mesh, const Array<std::uint32_t>& component,
                                    const SizingField& field, double spacing, std::size_t count,
                                    std::uint64_t seed);

/// The share of the surface that eliminate_samples() leaves uncovered for a spacing, or less, at a
/// hundredth of its cost: the mean over 32 places of how many candidates lie around them, as far as
/// these are less than one.
double least_uncovered(const TriangleMesh& mesh, const SizingField& field, double spacing,
                       std::uint64_t seed);

}  // namespace surfel
