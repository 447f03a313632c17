#pragma once

#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/sp06/disc_tree.h>

namespace surfel {

/// Discs to be added to groups so that the groups cover more of the surface: SP06 section 4.2.2,
/// method (1), with the greedy order by gain that its priority queue stands for.
class SURFEL_API Duplication {
 public:
  /// \param discs  of the whole cloud, outlives this object.
  /// \param least_gain  a disc is added if it newly covers more than this share of its own area,
  ///     > 0; that is the paper's "too big".
  Duplication(const Discs& discs, double least_gain);

  /// Discs to add to a group that consists of `members`, ascending, all indices into the discs. The
  /// gain of a disc is the area that no disc of the group covers, closed form in its tangent plane
  /// (UncoveredDiscArea); it can only shrink while discs are added, so that the first of the queue
  /// is added if its gain, computed anew, is still the largest. Equal gains go by index. O(n log n)
  /// for bounded overlap within a group. May be called from several threads.
  Array<std::uint32_t> discs_to_add(std::span<const std::uint32_t> members) const;

 private:
  const Discs& discs_;
  Array<std::uint32_t> candidates_;
  DiscTree tree_;
  double least_gain_;
};

}  // namespace surfel
