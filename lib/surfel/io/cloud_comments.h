#pragma once

// What a file's comments say of the whole of a cloud.

#include <string>
#include <vector>

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Sorts a header's comments into the fields of the cloud: values that apply to the whole cloud,
/// provenance, and all other comments. `file` is its name, for messages.
void read_comments(const std::vector<std::string>& comments, const std::string& file,
                   SurfelCloud& cloud);

/// The finest step of the LAS file that the points come from, if one of a header's comments tells
/// it, else 0. `file` is its name, for messages.
double finest_las_step(const std::vector<std::string>& comments, const std::string& file);

/// The reverse of read_comments(), for LAS files, which have fields for SurfelCloud::las.
/// \param pcd  PCD has a header line of its own for the viewpoint, which means unknown where it is
///             the default; a sensor that stood there needs the comment.
std::vector<std::string> write_comments(const SurfelCloud& cloud, bool pcd);

/// The comments of a file that is no LAS file: they tell SurfelCloud::las, too.
std::vector<std::string> file_comments(const SurfelCloud& cloud, bool pcd);

}  // namespace surfel
