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
struct PoissonSample {
  Vec3f position;      ///< Relative to the mesh's origin.
  std::uint32_t face;  ///< Face that the sample lies on.
  float area;     ///< Area of the surface that is nearer to this sample than to any other sample
                  ///< of its sheet.
  float nearest;  ///< Distance to the nearest other sample of its sheet; infinity if all are
                  ///< further away than the coverage radius.
  float size;     ///< Value of the field at the sample, in units of the spacing.
};

/// Poisson-disk samples over a whole surface by dart throwing with subdivision (White, Cline,
/// Egbert 2007, "Poisson disk point sets by hierarchical dart throwing"; Cline et al. 2009, "Dart
/// throwing on surfaces"): a triangle gets a dart; then, unless one disk covers it, it is halved
/// and its halves are treated alike.
///
/// Two points are of one sheet where faces connect them inside a ball of kSheetRadius spacings
/// around one of them and their faces agree in direction (kAgreeCosine). (Points without a mesh are
/// told apart by the rules of surface/sheet.h; a mesh knows its connections.) A sample is announced
/// to the triangles that a walk over the edges reaches, and darts in a triangle look at no other
/// samples: the two sides of a thin plate, or nested shells, do not see each other, however close
/// they are. Where the surface bends by between 60 and 100 degrees within the ball, samples on
/// either side of the bend keep the smaller distance kAsideRadius, and cover only places on the
/// other side that no dart can reach.
///
/// Darts keep kConflictRadius from the samples of their sheet; a triangle is finished when all of
/// it is within kCoverageRadius of one sample. The gap between the two radii makes the subdivision
/// end: a triangle no larger than the gap is covered by the sample that rejects its dart.
///
/// Where the spacing varies, a sample's radii follow the spacing at its own place, whatever the
/// spacing is where a dart falls.
class SURFEL_API PoissonDisk {
 public:
  /// Radii are in units of the spacing h. A set saturated at the conflict radius r has 1.436 r^2 of
  /// surface a sample (discs of radius r / 2 jam at a density of 0.547); with the gaps that
  /// kCoverageRadius leaves, a sample has h^2, within 1 % on smooth surfaces.
  static constexpr double kConflictRadius = 0.82;
  static constexpr double kCoverageRadius = 0.98;
  /// Further than kCoverageRadius, so that a walk around a bend still meets the sample behind it.
  static constexpr double kSheetRadius = 1.25;
  /// Distance that darts keep from samples that face aside, and that the samples of fill() keep
  /// from all samples: three quarters of kConflictRadius, so that there is room for them.
  static constexpr double kAsideRadius = 0.62;
  /// Faces agree from the cosine of 60 degrees on; below the cosine of 100 degrees, which leaves
  /// right-angled edges some rounding, they are opposed, and their samples independent.
  static constexpr float kAgreeCosine = 0.5f;
  static constexpr float kOpposedCosine = -0.17f;
  /// Largest change of the spacing by distance at which samples see each other.
  static constexpr double kMaxGradient = 0.42;

  /// Samples the whole surface, unless its triangles are so long and thin that they would have to
  /// be cut into more than `most_chunks` chunks (surface_chunks.h): null then. The samples do not
  /// depend on the number of threads.
  /// \param neighbor  edge_rings() of the mesh.
  /// \param field     spacing by place, in units of `spacing`; its gradient times `spacing` is
  ///                  kMaxGradient at most.
  static std::unique_ptr<PoissonDisk> make(const TriangleMesh& mesh,
                                           const Array<std::uint32_t>& neighbor,
                                           const SizingField& field, double spacing,
                                           std::uint64_t seed, std::size_t most_chunks);
  ~PoissonDisk();
  PoissonDisk(const PoissonDisk&) = delete;
  PoissonDisk& operator=(const PoissonDisk&) = delete;

  std::size_t size() const;
  /// Adds samples at random places, as dense as the others, that keep kAsideRadius from all
  /// samples, up to `count` samples in all; fewer where there is no more room.
  void fill(std::size_t count);
  /// The samples with their areas, in the order of a space-filling curve through blocks.
  Array<PoissonSample> samples() const;

 private:
  class Impl;
  explicit PoissonDisk(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
