#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

struct VoxelOptions {
  double edge = 0;  ///< Of a cell, scene units, 0 or 1e-9..1e9; 0: twice the points' spacing, which
                    ///< leaves about a quarter of them.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// One point for every cell of a cubic grid that has points: position, normal, colour, opacity and
/// coefficients are the mean of the cell's points (colours in linear light, normals of unit length
/// again, or zero where they cancel), by PCL's VoxelGrid (in libsurfel_filters.so, loaded when
/// first needed). All other columns are copied from the point nearest to the mean, whose index
/// orders the result as well, so that the points stay in the order of the file. The grid begins at
/// the lower corner of the cloud's box.
///
/// \param cloud  Its positions are finite.
/// \param edge   Set to the edge that was taken.
/// The result does not depend on the number of threads. Throws Error(kUsage) for bad options,
/// Error(kInput) starting with `name` for a grid of 2^31 cells or more, and where no spacing can be
/// told, Error(kIo) if the plug-in cannot be loaded.
SURFEL_API SurfelCloud average_voxels(const SurfelCloud& cloud, const VoxelOptions& options,
                                      const std::string& name, double& edge);

}  // namespace surfel
