#pragma once

// Half-planes of surfels in simplification: which surfels may be merged, where the merged ones end,
// and what goes on beyond.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/merged_lines.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/surface/sheet.h>

namespace surfel {

struct SheetClusters;

/// The edges of a cloud, as its surfels' half-planes tell them. Empty where no surfel is cut.
struct CloudEdges {
  Array<LinedSurfel> surfel;               ///< Of every surfel of the cloud.
  Array<std::uint32_t> clipped;            ///< The surfels that half-planes cut.
  Array<Vec3f> place;                      ///< Their positions.
  std::unique_ptr<NeighborSearch> search;  ///< Searches `place`.
  /// Mirror images: surfels that continue surfels of the cloud beyond the lines that cut these.
  SurfelCloud images;
  Array<std::uint32_t> image_of;  ///< The surfel of the cloud that each image continues.

  bool empty() const { return clipped.empty(); }
};

/// The edges of a cloud.
/// \param cloud   usable surfels; their centres are not cut off.
/// \param images  surfels whose centres are cut off, with the columns of the cloud.
CloudEdges find_edges(const SurfelCloud& cloud, SurfelCloud images);

/// What a cluster may take in without sticking out past an edge, as it grows around its seed.
/// Between the cluster's members no line may pass: each line of a member must leave the other ones,
/// and the members end at two lines at most. Lines of surfels beside the cluster are walls, which
/// it does not look behind.
class SURFEL_API ClusterEdges {
 public:
  /// Starts a cluster with its seed alone.
  /// \param normal  of the seed, unit.
  void start(std::span<const LinedSurfel> surfels, std::uint32_t seed, const Vec3f& normal);
  /// Whether a surfel may be a member. Surfels must come by ascending distance from the seed.
  bool admits(std::uint32_t i) const;
  void add_member(std::uint32_t i);
  void add_wall(std::uint32_t i);

 private:
  /// A piece of a line.
  struct Wall {
    CutLine line;
    Vec3f middle;
    Vec3f along;        ///< Unit.
    float first, last;  ///< From the middle.
  };
  bool separates(const Wall& wall, const Vec3f& place) const;
  bool fits(const CutLine& line) const;

  std::span<const LinedSurfel> surfels_;
  Vec3f seed_, seed_normal_;
  std::vector<std::uint32_t> members_;
  std::vector<CutLine> lines_;
  std::vector<Wall> walls_;
};

/// Sets the half-planes of the merged surfels of `merged`, of which there is one for each cluster,
/// with its variances: merged_lines() of the members and of all surfels of the sheet whose lines
/// the merged one reaches.
void end_at_lines(const CloudEdges& edges, const SurfelCloud& cloud, const SheetClusters& clusters,
                  const SheetRules& sheets, SurfelCloud& merged);

/// Adds to `merged`, behind its surfels, the surfels that go on beyond their lines: of an unmerged
/// surfel the images that it has, of a merged one, if a member has images, its own.
/// \return for each surfel added, the surfel that it continues.
Array<std::uint32_t> add_images(const CloudEdges& edges, const SheetClusters& clusters,
                                SurfelCloud& merged);

}  // namespace surfel
