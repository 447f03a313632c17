#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sample/sizing_field.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// One triangle of a surface that was refined until no edge is longer than a limit.
struct SurfaceChunk {
  static constexpr std::uint32_t kBorder = std::numeric_limits<std::uint32_t>::max();
  std::array<Vec3f, 3> corner;
  /// Edge k runs from corner k to corner k + 1. neighbor[k] is 3 * chunk + edge of the next chunk
  /// around that edge (with more than two chunks at an edge they form a ring), or kBorder.
  std::array<std::uint32_t, 3> neighbor;
  std::uint32_t face;  ///< Face of the mesh that the chunk is a part of.

  double area() const;
  Vec3f normal() const;  ///< Unit; zero where the chunk has no area.
};

/// A mesh cut into chunks of bounded size, sorted into cubic blocks, so that blocks far enough
/// apart can be worked on at the same time.
struct SurfaceChunks {
  Array<SurfaceChunk> chunk;               ///< Chunks, block by block.
  std::vector<std::uint32_t> block_first;  ///< First chunk of each block, then the chunks' number.
  /// Blocks of one phase (of 8) are at least a block's side apart.
  std::array<std::vector<std::uint32_t>, 8> phase;
};

/// Refines `mesh` until no edge is longer than `edge_spacings` times the spacing at its ends and
/// its middle (edges are halved, alike on both sides, so that neighbours fit), and sorts the chunks
/// by the block of side `block_side` that holds their centroid. Chunks of zero area are kept: they
/// connect their neighbours. Nothing where more than `most_chunks` would come out, which long thin
/// triangles do; they are counted before they are made.
/// \param neighbor  edge_rings() of the mesh.
SURFEL_API std::optional<SurfaceChunks> make_surface_chunks(const TriangleMesh& mesh,
                                                            const Array<std::uint32_t>& neighbor,
                                                            const SizingField& spacing,
                                                            double edge_spacings, double block_side,
                                                            std::size_t most_chunks);

}  // namespace surfel
