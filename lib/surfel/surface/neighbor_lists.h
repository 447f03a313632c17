#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Search that keeps the k nearest neighbours of all points (4 k bytes a point) for several stages
/// that go over all neighbourhoods. The first for_each_nearest() of no more than k neighbours
/// searches and keeps the neighbours, so that its body runs while the points are in the cache;
/// later calls, and rows(), read the lists. All other queries go to the search behind. The lists
/// change no result. One thread at a time may call for_each_nearest() and rows().
class SURFEL_API NeighborLists final : public NeighborSearch {
 public:
  /// `search` searches `points`; both outlive this object.
  NeighborLists(const NeighborSearch& search, const Array<Vec3f>& points, std::size_t k);

  std::size_t size() const override { return search_.size(); }
  void search(const Vec3f& query, std::size_t most, float limit2,
              std::vector<Neighbor>& out) const override {
    search_.search(query, most, limit2, out);
  }
  void for_each(std::size_t most, float limit2, Body body) const override;
  NeighborRows rows(std::size_t k) const override;

 private:
  const NeighborSearch& search_;
  const Array<Vec3f>& points_;
  std::size_t k_;
  mutable Array<std::uint32_t> index_;  ///< k_ a point, nearest first; empty before the search.
};

}  // namespace surfel
