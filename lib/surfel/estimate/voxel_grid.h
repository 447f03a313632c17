#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Cells of average_voxels().
struct VoxelOptions {
  double edge = 0;  ///< Of a cell, scene units, 0 or 1e-9..1e9; 0: twice the points' spacing, which
                    ///< leaves about a quarter of them.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Whether a grid of cells around a box can be counted: it has at most 2^21 along each axis.
SURFEL_API bool voxels_are_countable(const Bounds& box, double edge);

/// One point for every cell of a cubic grid that has points: position, normal, colour, opacity and
/// coefficients are the mean of the cell's points (colours in linear light, normals of unit length
/// again, or zero where they cancel). All other columns are copied from the point nearest to the
/// mean, whose index orders the result as well, so that the points stay in the order of the file.
/// The grid begins at the lower corner of the points' box.
///
/// \param cloud    Points with any columns. The result has the same columns.
/// \param points   The points of the cloud that are averaged, each once, all finite, in any order.
/// \param options  The edge of a cell, or what it is chosen by.
/// \param name     The cloud's file, for messages.
/// \param edge     Set to the edge that was taken.
///
/// The work takes about 60 bytes a point besides the result, which does not depend on the number of
/// threads. Throws Error(kUsage) for bad options, Error(kInput) starting with `name` for a grid
/// that cannot be counted, and where no spacing can be told.
SURFEL_API SurfelCloud average_voxels(const SurfelCloud& cloud, const Array<std::uint32_t>& points,
                                      const VoxelOptions& options, const std::string& name,
                                      double& edge);

}  // namespace surfel
