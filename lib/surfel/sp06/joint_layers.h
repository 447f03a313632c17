#pragma once

// Which fragments of a pixel are of one layer of the surface, told by the fragments of all groups
// together: Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06),
// sections 4.2.1 and 4.2.2.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// A fragment of a disc in a pixel.
struct DiscFragment {
  std::uint32_t disc = 0;
  std::uint16_t group = 0;
  bool front = false;     ///< The side of the surface that is seen.
  bool enlarged = false;  ///< The disc is larger than the disc that stands for the surface.
  float depth = 0;        ///< As Splat::depth.
  float epsilon = 0;      ///< Depths that differ by no more are of one surface.
  float key = 0;          ///< sqrt(beta / cutoff): 0 at the disc's centre, 1 at its rim.
  float rho = 0;          ///< Kernel.
};

/// Tells the layers of a pixel, and picks a fragment of each group for each of them. SP06 culls
/// the fragments of a group by their depths alone. Enlarged and added discs leave a bent surface,
/// and what they show there would be further layers, which are worse than the holes that they
/// close. Here the discs of all groups, not enlarged, are the surface: they alone make layers, as
/// depth peeling makes them. Enlarged discs fill the layers in which their group has no fragment.
class SURFEL_API JointLayers {
 public:
  /// A group's fragment of a layer.
  struct Member {
    std::uint32_t disc;
    std::uint16_t group;
    bool enlarged;
    float depth;   ///< Mean depth of the layer, weighted by the kernels.
    float weight;  ///< Sum of the layer's kernels; copies of a disc count once.
    float key;     ///< DiscFragment::key.
  };

  /// The members of a pixel's layers: the farthest layer first, within a layer by group. Valid
  /// until the next call. Puts the fragments in another order. The groups are 0..groups - 1.
  std::span<const Member> tell(std::span<DiscFragment> fragments, int groups);
  /// Fragments of the last call that are no members, as their group has another fragment in their
  /// layer; without enlarged discs.
  std::size_t culled() const { return culled_; }

 private:
  struct Layer {
    bool front;
    float depth;
    float weight;
    std::size_t first;  ///< Place in best_ of the first group's fragment.
  };

  void add_layers(std::span<DiscFragment> side);
  std::size_t take_layer(std::span<DiscFragment> left, float most_epsilon);
  void choose(const Layer& layer, const DiscFragment& fragment);
  void fill(const DiscFragment& fragment);

  int groups_ = 0;
  std::size_t culled_ = 0;
  std::vector<Layer> layers_;
  std::vector<DiscFragment> taken_;  ///< Fragments of the layer at hand, farthest first.
  std::vector<DiscFragment> best_;   ///< By layer and group; of negative key where there is none.
  std::vector<Member> members_;
};

}  // namespace surfel
