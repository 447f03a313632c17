#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Search among the points of a part of a cloud and of its halo, the points around it. It finds
/// what a search of the whole cloud finds as long as neighbourhoods end before points that are not
/// there, and notes where they do not: a point is certain if none of its queries, nor any query of
/// an earlier stage at one of the neighbours that it found, reached further than all points are
/// known. Stages are passes over the points whose results later passes read at the neighbours.
///
/// A single query is one of the point whose position it refers to.
class SURFEL_API HaloSearch final : public NeighborSearch {
 public:
  /// \param search  searches `points` and outlives this object, as do the arrays.
  /// \param known   by point: all points of the whole cloud nearer than this are among `points`.
  /// \param whole   number of points of the whole cloud.
  /// \param wanted  by point: 1 where later stages than the first one are of interest.
  HaloSearch(const NeighborSearch& search, const Array<Vec3f>& points, const Array<float>& known,
             std::size_t whole, const Array<std::uint8_t>& wanted);

  std::size_t size() const override { return search_.size(); }
  std::size_t whole() const override { return whole_; }
  void search(const Vec3f& query, std::size_t most, float limit2,
              std::vector<Neighbor>& out) const override;
  void for_each(std::size_t most, float limit2, Body body) const override;
  NeighborRows rows(std::size_t k) const override { return search_.rows(k); }

  /// Ends a stage.
  void next_stage();
  bool certain(std::size_t i) const { return (mark_[i] & kUncertain) == 0; }

  /// What has to be known for points to become certain.
  struct Missing {
    std::uint32_t point;  ///< Its neighbourhood reaches beyond the points that are known, ...
    std::uint32_t most;   ///< ... which has so many points ...
    float reach;          ///< ... and ends within this distance, or infinity.
  };
  /// The neighbourhoods that made wanted points uncertain, at these points or at others.
  std::vector<Missing> missing() const;

 private:
  static constexpr std::uint8_t kUncertain = 1;
  static constexpr std::uint8_t kBefore = 2;    ///< Was uncertain in an earlier stage.
  static constexpr std::uint8_t kDisturbs = 4;  ///< Made another point uncertain.
  void check(std::size_t i, std::span<const Neighbor> found, std::size_t most, float limit2) const;
  void set(std::size_t i, std::uint8_t bit) const;

  const NeighborSearch& search_;
  const Array<Vec3f>& points_;
  const Array<float>& known_;
  std::size_t whole_;
  const Array<std::uint8_t>& wanted_;
  bool first_stage_ = true;
  mutable Array<std::uint8_t> mark_;
  /// The furthest reach that was not known, and how many points it was for; 0: none.
  mutable Array<float> reach_;
  mutable Array<std::uint32_t> most_;
};

}  // namespace surfel
