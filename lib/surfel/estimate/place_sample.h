#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// A random sample of the places at which there are points, by which properties of a whole cloud
/// are told: the places whose hashes are least. It depends neither on the order of the points, nor
/// on how they are handed in, nor on how many lie at one place, so that a cloud that is read piece
/// by piece is judged as one in memory is.
class SURFEL_API PlaceSample {
 public:
  /// \param most  places of the sample, fewer if the points have not as many.
  explicit PlaceSample(std::size_t most) : most_(most) {}

  /// Adds points that are finite.
  void add(std::span<const Vec3f> points);
  /// The sample of all points added, in an order of its own.
  std::vector<Vec3f> places() const;

 private:
  struct Hashed {
    std::uint64_t hash;
    Vec3f place;
  };
  static void keep_least(std::size_t most, std::vector<Hashed>& some);

  std::size_t most_;
  std::vector<Hashed> least_;  ///< Ascending.
};

/// The sample of points that are all in memory.
inline std::vector<Vec3f> sample_places(std::span<const Vec3f> points, std::size_t most) {
  PlaceSample sample(most);
  sample.add(points);
  return sample.places();
}

/// Finds the positions of the `k` points nearest to a place, nearest first, at equal distances in
/// the order of morton_order() of the whole cloud.
using NearestPlaces = FunctionRef<void(const Vec3f& place, std::size_t k, std::vector<Vec3f>& out)>;

/// The NearestPlaces of points in the order of morton_order().
inline auto nearest_places(const Array<Vec3f>& points, const NeighborSearch& search) {
  return [&points, &search, near = std::vector<Neighbor>()](const Vec3f& place, std::size_t k,
                                                            std::vector<Vec3f>& out) mutable {
    search.nearest(place, k, near);
    out.clear();
    for (const Neighbor& n : near) out.push_back(points[n.index]);
  };
}

}  // namespace surfel
