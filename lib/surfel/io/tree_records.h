#pragma once

#include <span>
#include <string>
#include <vector>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

// A cloud's tree of levels of detail as an element of a PLY file. Internal to the library.

/// Name of the element that holds SurfelCloud::tree, one record a cluster:
/// `begin count first_child child_count` (uint), `level` (uchar), `x y z` of the sphere (double,
/// world), `radius spacing max_deviation cone_x cone_y cone_z cone_cosine` (float), and the box
/// `min_x min_y min_z max_x max_y max_z` (double, world).
inline constexpr const char* kTreeElement = "surfel_cluster";

/// Columns of the element, without gaps between them.
std::vector<RecordColumn> tree_columns();
/// The records of clusters of a tree, in this machine's byte order.
/// \param origin  what the bounds are relative to, world coordinates.
Array<std::byte> tree_to_records(std::span<const TreeCluster> tree, const Vec3d& origin);
/// The lines of a PLY header that declare an element.
std::string ply_element(const std::string& name, const std::vector<RecordColumn>& columns,
                        std::size_t count);

/// A tree whose spheres and boxes are in world coordinates, beside the clusters.
struct TreeRecords {
  ClusterTree tree;
  std::vector<Vec3d> center;  ///< Centre of each cluster's sphere.
  std::vector<Bounds> reach;  ///< Box around each cluster's discs.
};
/// Reads the element's records as a tree over `surfels` surfels. Throws Error(kInput) naming `file`
/// if a column is missing or the tree is broken (tree_problem()).
TreeRecords tree_from_records(const RecordTable& table, std::size_t surfels,
                              const std::string& file);
/// Moves the spheres and boxes into the clusters, relative to `origin`.
ClusterTree recentered_tree(TreeRecords records, const Vec3d& origin);

}  // namespace surfel
