#include <algorithm>

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_single_index.h>
#include <surfel/measure/neighbors.h>

namespace surfel {
namespace {

using Index = flann::KDTreeSingleIndex<flann::L2_Simple<float>>;
constexpr int kLeafSize = 12;

// FLANN's interface is not const where it only reads.
flann::Matrix<float> as_matrix(const Vec3f* points, std::size_t count) {
  return {const_cast<float*>(points->data()), count, 3};
}

}  // namespace

struct Neighbors::Impl {
  explicit Impl(const Array<Vec3f>& points)
      : size(points.size()),
        index(as_matrix(points.data(), points.size()),
              flann::KDTreeSingleIndexParams(kLeafSize, true)) {
    index.buildIndex();
  }
  std::size_t size;
  Index index;
};

Neighbors::Neighbors(const Array<Vec3f>& points) {
  if (!points.empty()) impl_ = std::make_unique<Impl>(points);
}
Neighbors::~Neighbors() = default;

std::vector<std::uint32_t> Neighbors::nearest(const Vec3f& query, std::size_t count) const {
  if (!impl_ || count == 0) return {};
  std::vector<std::vector<std::size_t>> indices;
  std::vector<std::vector<float>> distances;
  impl_->index.knnSearch(as_matrix(&query, 1), indices, distances, std::min(count, impl_->size),
                         flann::SearchParams(flann::FLANN_CHECKS_UNLIMITED));
  return {indices[0].begin(), indices[0].end()};
}

std::vector<std::uint32_t> Neighbors::within(const Vec3f& query, float radius,
                                             std::size_t most) const {
  if (!impl_ || most == 0) return {};
  std::vector<std::vector<std::size_t>> indices;
  std::vector<std::vector<float>> distances;
  flann::SearchParams parameters(flann::FLANN_CHECKS_UNLIMITED);
  parameters.max_neighbors = static_cast<int>(std::min(most, impl_->size));
  impl_->index.radiusSearch(as_matrix(&query, 1), indices, distances, radius * radius, parameters);
  return {indices[0].begin(), indices[0].end()};
}

}  // namespace surfel
