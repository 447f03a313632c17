#include "bench/peer_searches.h"

#include <algorithm>

#include <flann/flann.hpp>
#include <omp.h>
#ifdef SURFEL_HAVE_NANOFLANN
#include <nanoflann.hpp>
#endif

namespace surfel::bench {
namespace {

/// FLANN's exact single tree; its indices are int.
void flann_search(const float* xyz, std::size_t points, int k, int threads, std::uint32_t* index,
                  float* distance2) {
  // FLANN's interface is not const where it only reads.
  auto* data = const_cast<float*>(xyz);
  flann::Index<flann::L2_Simple<float>> tree(flann::Matrix<float>(data, points, 3),
                                             flann::KDTreeSingleIndexParams(15));
  tree.buildIndex();
  const flann::SearchParams parameters(flann::FLANN_CHECKS_UNLIMITED, 0.0F);
  const std::size_t columns = k;
  constexpr std::size_t kBlock = 4096;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
  for (std::size_t begin = 0; begin < points; begin += kBlock) {
    const std::size_t rows = std::min(kBlock, points - begin);
    const flann::Matrix<float> query(data + 3 * begin, rows, 3);
    flann::Matrix<int> found(reinterpret_cast<int*>(index) + begin * columns, rows, columns);
    flann::Matrix<float> at(distance2 + begin * columns, rows, columns);
    tree.knnSearch(query, found, at, columns, parameters);
  }
}

#ifdef SURFEL_HAVE_NANOFLANN

struct Points {
  const float* xyz;
  std::size_t count;
  std::size_t kdtree_get_point_count() const { return count; }
  float kdtree_get_pt(std::size_t i, std::size_t d) const { return xyz[3 * i + d]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

void nanoflann_search(const float* xyz, std::size_t points, int k, int threads,
                      std::uint32_t* index, float* distance2) {
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>,
                                                   Points, 3, std::uint32_t>;
  const Points adaptor{xyz, points};
  Tree tree(3, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(20));
  tree.buildIndex();
#pragma omp parallel for schedule(dynamic, 1024) num_threads(threads)
  for (std::size_t i = 0; i < points; ++i) {
    tree.knnSearch(xyz + 3 * i, k, index + i * k, distance2 + i * k);
  }
}

#endif

}  // namespace

std::vector<PeerSearch> peer_searches() {
  return {
      {"flann", flann_search},
#ifdef SURFEL_HAVE_NANOFLANN
      {"nanoflann", nanoflann_search},
#endif
  };
}

}  // namespace surfel::bench
