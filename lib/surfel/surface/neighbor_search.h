#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>

namespace surfel {

/// How neighbours are searched for. kExact and kFlann find the same neighbours. kFlannApproximate
/// stops early (FLANN's eps = 1): it finds as many, but may miss about 1 in 100 of the nearest.
enum class SearchMethod : std::uint8_t {
  kExact,  ///< A tree of SIMD vectors in Morton order, see exact_search.h; the fastest.
  kFlann,
  kFlannApproximate
};

/// A point that was found, and how far it is.
struct Neighbor {
  std::uint32_t index;
  float distance2;  ///< Squared distance to the query, unit^2.
};

/// Indices of the points nearest to every point, nearest first, a row a point.
struct NeighborRows {
  const std::uint32_t* index = nullptr;
  std::size_t count = 0;      ///< Indices of a row.
  std::size_t stride = 0;     ///< Indices from row to row.
  Array<std::uint32_t> kept;  ///< The rows; empty if the search keeps them.

  std::span<const std::uint32_t> of(std::size_t point) const {
    return {index + point * stride, count};
  }
};

/// Neighbour search among fixed points. Neighbours come by ascending distance, at equal distances
/// by index; they are the same for any number of threads. Queries may run in parallel. The searches
/// for all points at once are several times as fast as queries one by one.
class SURFEL_API NeighborSearch {
 public:
  /// Called with the neighbourhood of point `i`; the span is valid during the call only.
  using Body = FunctionRef<void(std::size_t i, std::span<const Neighbor> neighbors, int worker)>;

  /// The `limit2` of searches that find points at any distance.
  static constexpr float kNoLimit = std::numeric_limits<float>::infinity();

  virtual ~NeighborSearch() = default;

  virtual std::size_t size() const = 0;
  /// Points of the cloud that neighbourhoods may hold: of a search of a part (halo_search.h) more
  /// than it has.
  virtual std::size_t whole() const { return size(); }
  /// Finds the `most` points nearest to `query` (all, if there are fewer) among the points whose
  /// squared distance is at most `limit2`.
  virtual void search(const Vec3f& query, std::size_t most, float limit2,
                      std::vector<Neighbor>& out) const = 0;
  /// Calls body in parallel with what search() finds for every point, the point itself included.
  /// Fastest where the points are in the order of a space-filling curve.
  virtual void for_each(std::size_t most, float limit2, Body body) const = 0;

  /// The k points nearest to `query` (all, if there are fewer), a point at the query itself
  /// included.
  void nearest(const Vec3f& query, std::size_t k, std::vector<Neighbor>& out) const {
    search(query, k, kNoLimit, out);
  }
  /// The points within `radius` (inclusive) of `query`, at most the `most` nearest.
  void within(const Vec3f& query, float radius, std::size_t most,
              std::vector<Neighbor>& out) const {
    search(query, most, radius * radius, out);
  }
  /// Calls body with what nearest() or within() finds for every point, as for_each() does.
  void for_each_nearest(std::size_t k, Body body) const { for_each(k, kNoLimit, body); }
  void for_each_within(float radius, std::size_t most, Body body) const {
    for_each(most, radius * radius, body);
  }

  /// The k nearest neighbours of every point (all points, if there are fewer), the point itself
  /// included.
  virtual NeighborRows rows(std::size_t k) const;
};

/// `points` are finite and outlive the search.
SURFEL_API std::unique_ptr<NeighborSearch> make_neighbor_search(
    const Array<Vec3f>& points, SearchMethod method = SearchMethod::kExact);

/// Share of the k nearest neighbours that `search`, which searches `points`, finds: compared with
/// an exact search at up to 1000 points, spread evenly. A neighbour as far away as the k-th counts
/// as found. 1 if there are no points.
SURFEL_API double neighbor_recall(const Array<Vec3f>& points, const NeighborSearch& search,
                                  std::size_t k);

}  // namespace surfel
