#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Header of a PLY file that holds `count` surfels, and a tree over them where it has clusters;
/// with comments that tell what holds for the whole of a cloud. Internal to the io module.
std::string cloud_ply_header(const SurfelCloud& cloud, const std::vector<RecordColumn>& columns,
                             std::size_t count, std::size_t clusters, bool ascii);

}  // namespace surfel
