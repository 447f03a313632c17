#pragma once

#include <cstddef>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// The numbers of surfels found, and the distances. The first three add up to the number of
/// surfels.
struct SurfaceLookupReport {
  std::size_t located = 0;
  std::size_t too_far = 0;           ///< No face within three standard deviations: uv are NaN.
  std::size_t without_position = 0;  ///< Position not finite: uv are NaN.
  std::size_t flat_uv = 0;           ///< Located on a face whose uv span no area: dpdu = dpdv = 0.
  std::size_t turned_away = 0;       ///< Located on a face turned away from the surfel's normal.
  double mean_distance = 0;          ///< Mean distance of the located surfels from the mesh.
  double largest_distance = 0;
  StageTimes times;
};

/// Gives every surfel the uv, dpdu and dpdv (columns as sample_mesh() writes them) of the nearest
/// point of the mesh, and the material where the mesh has more than one; otherwise the cloud's
/// material column is dropped, as it would not be the mesh's. All other columns stay as they are.
///
/// The normal tells the sides of a thin sheet apart: a face turned away from it (by more than 90
/// degrees) counts as twice as far plus one standard deviation of the surfel, so that it is chosen
/// only where no other face is that near. A face is turned where the sum of its corners' normals
/// is, if the file gave normals, else by the order of its corners. Surfels without normal take
/// whatever is nearest. Of faces equally far, the lowest; faces without area are no surface.
///
/// Surfels further from the mesh than three of their (larger) standard deviations, beyond the
/// coordinates' rounding, are not located: their uv are NaN.
///
/// \param cloud  Surfels near the mesh. Their columns of texture coordinates change.
/// \param mesh   The mesh that the surfels were sampled from.
/// \param name   The mesh's file, to start messages with, or empty.
///
/// Throws Error(kInput) where the mesh has no uv, or the surfels have no variance. The cloud is
/// unchanged then. The same for any number of threads. Cost: 1.5 microseconds of one core a surfel
/// near the mesh and 0.3 a face; 50 bytes for each of both.
SURFEL_API SurfaceLookupReport locate_on_mesh(SurfelCloud& cloud, const TriangleMesh& mesh,
                                              const std::string& name = {});

/// How a cloud lies to a mesh.
struct MeshProximity {
  std::size_t near = 0;       ///< Surfels on the mesh, as locate_on_mesh() has it.
  std::size_t far = 0;        ///< All others with a finite position.
  double least_distance = 0;  ///< The least distance of a surfel from the mesh; 0 without surfels.
};

/// Measures surfels at even steps through the cloud, `most` of them or all if there are fewer.
/// The mesh needs no uv. The same for any number of threads; cost as locate_on_mesh().
/// Throws Error(kInput) where the surfels have no variance.
SURFEL_API MeshProximity mesh_proximity(const SurfelCloud& cloud, const TriangleMesh& mesh,
                                        std::size_t most);

}  // namespace surfel
