#pragma once

#include <string>
#include <vector>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Name of the PLY element that holds a cloud's tree (SurfelCloud::tree), one record a cluster:
/// `begin count first_child child_count` (uint), `level` (uchar), `x y z` of the sphere (double,
/// world), `radius spacing max_deviation cone_x cone_y cone_z cone_cosine` (float), and the box
/// `min_x min_y min_z max_x max_y max_z` (double, world).
inline constexpr const char* kTreeElement = "surfel_cluster";

/// Columns of that element, packed. Internal to the io module, as all here.
std::vector<RecordColumn> tree_columns();
/// Its records in this machine's byte order.
Array<std::byte> tree_to_records(const SurfelCloud& cloud);

/// A tree over `surfels` surfels from such records; spheres and boxes stay relative to the world's
/// origin until recentered_tree(). Throws Error(kInput) if a column is missing or the tree is
/// broken (tree_problem()).
struct TreeRecords {
  ClusterTree tree;
  std::vector<Vec3d> center;
  std::vector<Bounds> reach;
};
TreeRecords tree_from_records(const RecordTable& table, std::size_t surfels,
                              const std::string& file);
/// The tree with its spheres and boxes relative to `origin`.
ClusterTree recentered_tree(TreeRecords records, const Vec3d& origin);

}  // namespace surfel
