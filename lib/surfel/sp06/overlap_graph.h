#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Which splats overlap: SP06 (5) with its relaxations 1 to 3.
struct OverlapOptions {
  double cutoff = 1;   ///< c of beta < c: a splat's radius is sqrt(2 c max V), 0.01..16.
  double overlap = 1;  ///< SP06's c, relaxation 3: discs shrunk to this share of their radius may
                       ///< not overlap, 0..4; above 1 keeps a distance.
  /// Relaxation 1: no edge between splats that a picture can hardly tell apart: the same material,
  /// colours and opacities nearly equal, and the normals and the line between the centres within
  /// coplanar_angle of one plane. Splats of unknown normal are never in one plane.
  bool relax_coplanar = false;
  double coplanar_angle = 3;     ///< Degrees, 0..45.
  double coplanar_color = 0.02;  ///< Largest difference of a linear colour channel or alpha, >= 0.
  bool relax_opposite = false;   ///< Relaxation 2: no edge where n_i . n_j < 0.
  /// Most that the edges may take, in bytes, while the graph is made; 0: what 256 neighbours of
  /// every splat take, at least 96 MB, at most half of the memory that the machine has left. More
  /// is an error, not a crash. Pairs that a relaxation takes out count as edges here.
  std::uint64_t max_memory = 0;
  SURFEL_API std::vector<std::string> problems() const;
};

/// Undirected graph in compressed sparse rows. Its vertices are the usable splats: those of similar
/// radius together and, among them, along a Morton curve, so that neighbours lie together in memory
/// and a shuffled cloud gives the same graph.
struct SURFEL_API OverlapGraph {
  Array<std::uint32_t> splat;      ///< For each vertex, its splat's index in the cloud.
  Array<std::uint64_t> row_begin;  ///< size() + 1
  Array<std::uint32_t> neighbor;   ///< Every edge twice; ascending in a row, no vertex its own.
  std::size_t unusable = 0;  ///< Splats left out: position not finite, or variance not positive.

  std::size_t size() const { return splat.size(); }
  std::uint64_t edges() const { return neighbor.size() / 2; }
  std::size_t degree(std::size_t v) const { return row_begin[v + 1] - row_begin[v]; }
  std::span<const std::uint32_t> neighbors(std::size_t v) const {
    return {neighbor.data() + row_begin[v], degree(v)};
  }
  std::size_t max_degree() const;
  double mean_degree() const;  ///< 0 without vertices.
  std::uint64_t memory_bytes() const;
};

/// Radius of the disc of splat i, sqrt(2 cutoff max V), scene units: where beta reaches the cutoff
/// along the longer axis. 0 if the splat is unusable. The cloud has variances.
SURFEL_API float splat_radius(const SurfelCloud& cloud, std::size_t i, double cutoff);

/// The graph of all pairs with |p_i - p_j| < overlap (r_i + r_j), evaluated in double from the
/// cloud's single precision values, without the pairs that an enabled relaxation takes out.
///
/// The search is a hierarchy of boxes over blocks of splats of similar radius: time and memory
/// follow the number of edges, which is bounded, whatever the ratio of the radii. 8 bytes an edge
/// while it runs and 8 after, 60 a splat. The same for any number of threads. Throws Error(kUsage)
/// for bad options, Error(kInput) starting with `name` if the cloud has no variance, no usable
/// splat, or more edges than options.max_memory holds (all splats in one place, say).
SURFEL_API OverlapGraph make_overlap_graph(const SurfelCloud& cloud, const OverlapOptions& options,
                                           StageTimes* times = nullptr,
                                           const std::string& name = {});

}  // namespace surfel
