#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Leaves out all columns but the positions and those named: by a property of the file format, such
/// as `nx`, `red` or `intensity`, where all components of a vector and all that tells a splat's
/// size stay together, or by `normal`, `color` or `size` for these. Case is ignored. Groups and
/// levels of detail need columns of their own: without `group` or `level` they are gone.
/// \param cloud  Loses the other columns.
/// \param names  Columns to keep.
/// \param name   The cloud's file, for messages.
///
/// Throws Error(kInput) for a name that the cloud has no column of.
SURFEL_API void keep_columns(SurfelCloud& cloud, const std::vector<std::string>& names,
                             const std::string& name);

}  // namespace surfel
