#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sample/sizing_field.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// A surface sample that Poisson-disk sampling made.
struct SurfaceSample {
  Vec3f position;      ///< Relative to the mesh's origin.
  std::uint32_t face;  ///< That it lies on.
  float area;          ///< Surface nearer to it than to any other sample of its sheet.
  float nearest;       ///< Distance to the nearest other sample of its sheet; infinity if that is
                       ///< further than the coverage radius.
  float size;          ///< The field there, in units of the spacing.
};

/// Poisson-disk samples over a whole surface by dart throwing with subdivision (White, Cline,
/// Egbert 2007, "Poisson disk point sets by hierarchical dart throwing"; Cline et al. 2009, "Dart
/// throwing on surfaces"): a triangle gets a dart; then, unless one disk covers it, it is halved
/// and its halves are treated alike.
///
/// Two points are of one sheet where faces connect them inside a ball of kSheetRadius spacings
/// around one of them and their faces agree in direction (kAgreeCosine). A sample is announced to
/// those triangles that a walk over the edges reaches, and darts there look at no others: the two
/// sides of a thin plate, or nested shells, do not see each other, however close they are. In
/// between, where the surface bends by more than about 60 and less than 100 degrees within the
/// ball, samples keep the smaller distance kAsideRadius and cover only what no dart can reach.
///
/// Darts keep kConflictRadius from the samples of their sheet; a triangle is finished when all of
/// it is within kCoverageRadius of one of them. The gap between the two makes the subdivision end:
/// a triangle no larger than the gap is covered by the sample that rejects its dart.
///
/// Where the spacing varies, a sample's radii are those of the spacing at its own place, whatever
/// the spacing is where a dart falls.
class SURFEL_API PoissonDisk {
 public:
  /// In units of the spacing h. A set saturated at the conflict radius r has 1.436 r^2 of surface
  /// a sample (discs of radius r / 2 jam at a density of 0.547); with the gaps that kCoverageRadius
  /// leaves, these two make it h^2 (measured: within 1 % on smooth surfaces).
  static constexpr double kConflictRadius = 0.82;
  static constexpr double kCoverageRadius = 0.98;
  static constexpr double kSheetRadius = 1.25;
  /// Kept from samples that face aside, and from all by those that fill up to an exact number.
  static constexpr double kAsideRadius = 0.62;
  /// Faces agree from this cosine on; below the other one they are opposed and independent.
  static constexpr float kAgreeCosine = 0.5f;
  static constexpr float kOpposedCosine = -0.17f;
  static constexpr double kMaxGradient = 0.42;

  /// \param neighbor  as of make_surface_chunks().
  /// \param field     spacing by place, in units of `spacing`. Its gradient is at most
  ///                  kMaxGradient: beyond, samples would not see each other.
  /// Samples the whole surface. The same for any number of threads.
  PoissonDisk(const TriangleMesh& mesh, const Array<std::uint32_t>& neighbor,
              const SizingField& field, double spacing, std::uint64_t seed);
  ~PoissonDisk();
  PoissonDisk(const PoissonDisk&) = delete;
  PoissonDisk& operator=(const PoissonDisk&) = delete;

  std::size_t size() const;
  /// Adds samples at random places, as dense as the others, that keep kAsideRadius from them, up to
  /// `count` in all; fewer where there is no more room.
  void fill(std::size_t count);
  /// The samples with their areas, in the order of a space-filling curve through blocks.
  Array<SurfaceSample> samples() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
