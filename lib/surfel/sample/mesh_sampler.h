#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/sizing_field.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Number, spacing and pattern of the samples of a mesh.
struct SURFEL_API MeshSampleOptions {
  /// Either the root of the area per sample, scene units, > 0, ...
  std::optional<double> spacing;
  /// ... or the number of samples, 1 to 2^28, is set.
  std::optional<std::size_t> count;
  /// Spacing that varies, or null. `spacing` and MeshSampleReport::spacing are factors of the field
  /// then: 1 is the field as it is. The field's gradient times `spacing` is at most
  /// PoissonDisk::kMaxGradient.
  const SizingField* field = nullptr;
  std::uint64_t seed = 1;  ///< Chooses the pattern.
  bool flat = false;       ///< Normals of the faces instead of smooth ones.
  /// Standard deviation of the kernels in units of the spacing, > 0. The default is the sharpest
  /// value that leaves no holes: cut off at beta = 1 kernels reach 0.99 spacings, and no point of
  /// the surface is further from a sample than 0.98 spacings. SS01 section 5 has V = h^2 I: a value
  /// of 1.
  double variance_scale = kVarianceScale;
  static constexpr double kVarianceScale = 0.7;
  /// Most samples by elimination (eliminate_samples()) at a spacing. Where they would be more the
  /// cloud comes out empty, and the report tells a spacing at which they are not.
  std::size_t most_eliminated = std::numeric_limits<std::size_t>::max();
  double crease_angle = std::numbers::pi / 4;  ///< Faces that meet at a larger angle share no
                                               ///< normal where the file has none; radians.
  /// Surfels end at the mesh's borders and creases (MeshClips), beyond which mirrored surfels go on
  /// for as far as kernels reach, cut off where the others are: the sums of kernels are as even at
  /// the edge as elsewhere. The mirrored surfels come on top of `count`.
  bool clip = false;
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Figures of a sample_mesh(): faces left out, and the spacing reached.
struct MeshSampleReport {
  std::size_t faces = 0;
  std::size_t degenerate_faces = 0;  ///< Faces without area: dropped on reading, or skipped.
  std::size_t repeated_faces = 0;    ///< Faces left out, as a lower face has the same corners in
                                     ///< the same direction around.
  std::size_t flat_uv_faces = 0;     ///< Faces whose uv span no area: dpdu = dpdv = 0 there.
  std::size_t components = 0;        ///< Parts that no edge connects.
  bool eliminated = false;  ///< The triangles are so long and thin that the samples come from
                            ///< eliminate_samples().
  EdgeCounts edges;
  std::size_t clipped = 0;    ///< Surfels that end at a border or crease ...
  std::size_t mirrored = 0;   ///< ... and those among them that go on beyond it, see
                              ///< MeshSampleOptions::clip.
  double area = 0;            ///< Area of the mesh, every face once.
  double spacing = 0;         ///< Spacing asked for, or found for the count.
  double least_distance = 0;  ///< Least distance between samples of one sheet; infinity if no
                              ///< two samples are near each other.
  double mean_distance = 0;   ///< Mean distance to the nearest sample of the sheet, over the
                              ///< samples that have one near.
  StageTimes times;
};

/// Throws Error(kInput) that starts with `name`, and names the first such vertex (from 0), where
/// the mesh is too large to be sampled, or met by rays: lengths squared, of which the sampling and
/// the kernels consist, are numbers of single precision, which coordinates beyond 1e18 (after the
/// mesh's origin is taken off) would bring near to their end.
SURFEL_API void require_sampleable(const TriangleMesh& mesh, const std::string& name);

/// Blue-noise samples over the whole surface: samples of one sheet (poisson_disk.h) are at least
/// 0.62 spacings apart, 0.82 where the surface does not bend sharply, and no point of the surface
/// is further than 0.98 spacings from a sample. Every component has at least one sample. Of faces
/// with the same corners in the same direction the lowest is sampled: the others show nothing else.
///
/// With a count, a spacing is searched for at which slightly fewer samples come out; random samples
/// that keep 0.62 spacings from all others fill the number up exactly. Where there are more
/// components than samples the number is the nearest that was found.
///
/// Where triangles are so long and thin that they would be cut into several times as many pieces as
/// there are triangles and samples, samples come from eliminate_samples() (sample_elimination.h),
/// as they do where there is no room for the count: sheets that face the same way within a spacing
/// share their samples then, and a point in ten thousand is further from a sample than 0.98
/// spacings. With a count, loose slivers narrower than the spacing get samples by their area; with
/// a spacing, dart throwing covers them along their length where elimination leaves 3 % of the
/// surface uncovered.
///
/// Columns: position, normal (the face's), shading_normal (smooth, where that is another), variance
/// = (variance_scale * spacing there)^2 (of a component smaller than spacing^2: its area instead),
/// area (the areas sum to the mesh's area, mirrored surfels left out), clip1 and clip2 where some
/// surfel ends at an edge; uv, dpdu and dpdv where the mesh has uv; color where it has vertex
/// colours or materials without texture; alpha where a material is see-through; material where it
/// has more than one. The mesh's origin and its upward direction are kept.
///
/// `name` is the mesh's file, which messages start with, or empty.
/// Throws Error: kUsage for bad options; kInput where the mesh has no area, or the samples would
/// not fit into memory or be finer than the coordinates' precision or than 1e-18, and what
/// require_sampleable() refuses. The samples do not depend on the number of threads. A sample takes
/// about 2.5 microseconds of one core and 200 bytes.
SURFEL_API SurfelCloud sample_mesh(const TriangleMesh& mesh, const MeshSampleOptions& options,
                                   MeshSampleReport* report = nullptr,
                                   const std::string& name = {});

/// What the colours of the faces' materials and textures are, which sample_mesh() gives the cloud.
/// `face_material` names rows of `material`.
SURFEL_API ColorLight color_light(const TriangleMesh& mesh);

}  // namespace surfel
