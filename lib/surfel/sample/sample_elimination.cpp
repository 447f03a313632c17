#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/sample/mesh_face.h>
#include <surfel/sample/sample_elimination.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 11;
/// Random points for each sample, as the paper has it.
constexpr std::size_t kCandidatesPerSample = 5;
/// Neighbours that a point looks at, itself among them: in the mean those within 0.98 spacings of
/// an even surface. The others within kReach weigh nothing. Where sheets crowd, the nearest ones
/// are told apart at a finer distance.
constexpr std::size_t kMostNeighbors = 16;
/// Points among which they are looked for: half of them face away on a thin plate.
constexpr std::size_t kMostFound = 2 * kMostNeighbors;
constexpr std::uint32_t kNone = ~std::uint32_t{0};

/// The paper's 2 r_max, the distance of neighbours in the densest packing, in spacings.
const double kReach = std::sqrt(2 / std::sqrt(3.0));

/// A random point of the surface, beside its position.
struct Candidate {
  std::uint32_t face;
  float size;  ///< The field there.
};

/// Faces to choose from by their area in units of the field.
class FacesByArea {
 public:
  FacesByArea(const TriangleMesh& mesh, const SizingField& field) : mesh_(mesh), field_(field) {
    const std::size_t n = mesh.face.size();
    finest_.resize(n);
    area_up_to_.resize(n);
    parallel_each(n, kGrain, [&](std::size_t f) { measure(f); });
    double sum = 0;
    for (double& area : area_up_to_) area = sum += area;
  }

  /// The point of a face, or of one chosen by the numbers if it is kNone.
  Candidate draw(std::uint32_t face, std::uint64_t seed, std::uint64_t index,
                 Vec3f& position) const {
    if (face == kNone) {
      const double at = random_uniform(seed, index, 0) * area_up_to_.back();
      const auto found = std::upper_bound(area_up_to_.begin(), area_up_to_.end() - 1, at);
      face = static_cast<std::uint32_t>(found - area_up_to_.begin());
    }
    const FaceCorners corner = face_corners(mesh_, face);
    // Within a face the density follows the field by rejection.
    constexpr std::uint64_t kTries = 16;
    for (std::uint64_t i = 0;; ++i) {
      double a = random_uniform(seed, index, 3 * i + 1);
      double b = random_uniform(seed, index, 3 * i + 2);
      if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
      }
      const Vec3d p = corner[0] + a * (corner[1] - corner[0]) + b * (corner[2] - corner[0]);
      position = p.cast<float>();
      const double size = field_.at(position);
      const double share = finest_[face] / size;
      if (i + 1 == kTries || random_uniform(seed, index, 3 * i + 3) <= share * share) {
        return {face, static_cast<float>(size)};
      }
    }
  }

 private:
  void measure(std::size_t f) {
    const FaceCorners corner = face_corners(mesh_, f);
    const Vec3d middle = (corner[0] + corner[1] + corner[2]) / 3;
    const double area = area_vector(corner).norm() / 2;
    const double size = field_.at(middle.cast<float>());
    // Centroids of parts that are not much longer than the field's spacing.
    constexpr double kMostParts = 16;
    const int n =
        field_.gradient() > 0
            ? static_cast<int>(std::clamp(std::ceil(longest_edge(corner) / size), 1.0, kMostParts))
            : 1;
    double sum = 0;
    finest_[f] = size;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        const Vec3d p = corner[0] + (i + 1 / 3.0) / n * (corner[1] - corner[0]) +
                        (j + 1 / 3.0) / n * (corner[2] - corner[0]);
        const double spacing = field_.at(p.cast<float>());
        finest_[f] = std::min(finest_[f], spacing);
        sum += 1 / (spacing * spacing);
      }
    }
    area_up_to_[f] = area * sum * 2 / (n * (n + 1));
  }

  const TriangleMesh& mesh_;
  const SizingField& field_;
  std::vector<double> finest_;      ///< Least value of the field over each face.
  std::vector<double> area_up_to_;  ///< Sum over the faces up to each one.
};

/// A heap of all points by their weight, the heaviest first, equal ones by index. Weights only
/// fall. The heap is larger than the processor's caches: four children a node, beside each other
/// with their weights, are fetched less often than two.
class HeaviestFirst {
 public:
  explicit HeaviestFirst(const std::vector<float>& weight)
      : heap_(weight.size()), place_(weight.size()) {
    for (std::size_t i = 0; i < heap_.size(); ++i) {
      put(i, {weight[i], static_cast<std::uint32_t>(i)});
    }
    for (std::size_t i = heap_.size(); i-- > 0;) sink(i);
  }

  bool empty() const { return heap_.empty(); }
  std::uint32_t pop() {
    const std::uint32_t top = heap_.front().point;
    const Entry last = heap_.back();
    heap_.pop_back();
    place_[top] = kNone;
    if (!heap_.empty()) {
      put(0, last);
      sink(0);
    }
    return top;
  }
  void lower(std::uint32_t i, float by) {
    if (place_[i] == kNone) return;
    heap_[place_[i]].weight -= by;
    sink(place_[i]);
  }

 private:
  static constexpr std::size_t kChildren = 4;
  struct Entry {
    float weight;
    std::uint32_t point;

    bool before(const Entry& other) const {
      return weight > other.weight || (weight == other.weight && point < other.point);
    }
  };
  void put(std::size_t place, const Entry& entry) {
    heap_[place] = entry;
    place_[entry.point] = static_cast<std::uint32_t>(place);
  }
  void sink(std::size_t place) {
    const Entry sinking = heap_[place];
    for (;;) {
      const std::size_t first = kChildren * place + 1;
      if (first >= heap_.size()) break;
      const std::size_t end = std::min(first + kChildren, heap_.size());
      std::size_t child = first;
      for (std::size_t k = first + 1; k < end; ++k) {
        if (heap_[k].before(heap_[child])) child = k;
      }
      if (!heap_[child].before(sinking)) break;
      put(place, heap_[child]);
      place = child;
    }
    put(place, sinking);
  }

  std::vector<Entry> heap_;
  std::vector<std::uint32_t> place_;  ///< Of each point in the heap, or kNone.
};

class Elimination {
 public:
  Elimination(const TriangleMesh& mesh, const Array<std::uint32_t>& component,
              const SizingField& field, double spacing, std::size_t count, std::uint64_t seed)
      : mesh_(mesh), component_(component), spacing_(spacing), count_(count), seed_(seed) {
    draw(FacesByArea(mesh, field));
    const std::size_t n = candidate_.size();
    // The paper's d_min: points nearer than that count alike, however near they are.
    constexpr double kBeta = 0.65;
    const double share = static_cast<double>(count) / static_cast<double>(n);
    nearest_ = static_cast<float>(kReach * (1 - share * std::sqrt(share)) * kBeta);
    find_neighbors(field);
    eliminate();
  }

  EliminatedSamples samples() const;

 private:
  /// One point in each component, the others by area; along a space-filling curve.
  void draw(const FacesByArea& faces) {
    const std::size_t n = component_.size();
    std::vector<std::uint32_t> drawn_from;
    std::vector<double> largest(n, 0);
    std::vector<std::uint32_t> largest_face(n, kNone);
    component_area_.assign(n, 0);
    for (std::size_t f = 0; f < n; ++f) {
      const double area = area_vector(face_corners(mesh_, f)).norm() / 2;
      const std::uint32_t c = component_[f];
      component_area_[c] += area;
      if (area > largest[c]) {
        largest[c] = area;
        largest_face[c] = static_cast<std::uint32_t>(f);
      }
    }
    for (const std::uint32_t f : largest_face) {
      if (f != kNone) drawn_from.push_back(f);
    }
    const std::size_t forced = drawn_from.size();
    Array<Candidate> drawn(forced + kCandidatesPerSample * count_);
    Array<Vec3f> position(drawn.size());
    parallel_each(drawn.size(), kGrain, [&](std::size_t i) {
      drawn[i] = faces.draw(i < forced ? drawn_from[i] : kNone, seed_, i, position[i]);
    });
    const Array<std::uint32_t> order = morton_order(position);
    candidate_.resize(drawn.size());
    share_.resize(drawn.size());
    position_.resize(drawn.size());
    // A point stands for as much area as the field has there, and for no more than its component.
    const double per_candidate = spacing_ * spacing_ / static_cast<double>(kCandidatesPerSample);
    for (std::size_t i = 0; i < order.size(); ++i) {
      const Candidate& c = candidate_[i] = drawn[order[i]];
      position_[i] = position[order[i]];
      share_[i] = static_cast<float>(
          std::min(per_candidate * c.size * c.size, component_area_[component_[c.face]]));
    }
    normal_.resize(mesh_.face.size());
    parallel_each(normal_.size(), kGrain, [&](std::size_t f) {
      normal_[f] = area_vector(face_corners(mesh_, f)).normalized().cast<float>();
    });
  }

  void find_neighbors(const SizingField& field) {
    const std::size_t n = candidate_.size();
    neighbor_.assign(n * kMostNeighbors, kNone);
    reach2_.resize(n);
    const double reach = kReach * spacing_ * field.largest();
    const auto limit2 = static_cast<float>(reach * reach);
    make_neighbor_search(position_)->for_each(
        kMostFound, limit2, [&](std::size_t i, std::span<const Neighbor> found, int) {
          std::size_t kept = 0;
          reach2_[i] = found.size() < kMostFound ? std::numeric_limits<float>::infinity()
                                                 : found.back().distance2;
          for (const Neighbor& other : found) {
            if (!(cosine(i, other.index) >= PoissonDisk::kOpposedCosine)) continue;
            if (kept == kMostNeighbors) {
              reach2_[i] = other.distance2;
              break;
            }
            neighbor_[i * kMostNeighbors + kept++] = other.index;
          }
        });
  }

  float cosine(std::size_t i, std::size_t j) const {
    return normal_[candidate_[i].face].dot(normal_[candidate_[j].face]);
  }

  /// Distance of two points in units of their mean spacing, or infinity where neither sees the
  /// other: beyond the neighbours of one, or facing away.
  float distance(std::uint32_t i, std::uint32_t j) const {
    constexpr float kUnseen = std::numeric_limits<float>::infinity();
    const float d2 = (position_[i] - position_[j]).squaredNorm();
    if (!(d2 < reach2_[i] && d2 < reach2_[j])) return kUnseen;
    const float agreement = cosine(i, j);
    if (agreement < PoissonDisk::kOpposedCosine) return kUnseen;
    const auto mean = static_cast<float>(spacing_ / 2) * (candidate_[i].size + candidate_[j].size);
    constexpr auto kAside =
        static_cast<float>(PoissonDisk::kConflictRadius / PoissonDisk::kAsideRadius);
    return std::sqrt(d2) / mean * (agreement < PoissonDisk::kAgreeCosine ? kAside : 1);
  }

  /// How much one point crowds another: the paper's (1 - d / (2 r_max))^8.
  float crowding(std::uint32_t i, std::uint32_t j) const {
    const float d = std::max(distance(i, j), nearest_);
    const float left = 1 - d / static_cast<float>(kReach);
    if (!(left > 0)) return 0;
    const float left2 = left * left;
    const float left4 = left2 * left2;
    return left4 * left4;
  }

  std::span<const std::uint32_t> neighbors(std::size_t i) const {
    return {neighbor_.data() + i * kMostNeighbors, kMostNeighbors};
  }
  template <class Body>
  void each_neighbor(std::uint32_t i, const Body& body) const {
    for (const std::uint32_t j : neighbors(i)) {
      if (j == kNone) return;
      if (j != i) body(j);
    }
  }

  void eliminate() {
    const std::size_t n = candidate_.size();
    std::vector<float> weight(n);
    parallel_each(n, kGrain, [&](std::size_t i) {
      const auto at = static_cast<std::uint32_t>(i);
      // Of points that are crowded alike a random one goes, not the next along the curve.
      float sum = 1e-6f * static_cast<float>(random_uniform(~seed_, i));
      each_neighbor(at, [&](std::uint32_t j) { sum += crowding(at, j); });
      weight[i] = sum;
    });
    std::vector<std::uint32_t> left(component_.size(), 0);
    for (const Candidate& c : candidate_) ++left[component_[c.face]];
    kept_.assign(n, 1);
    HeaviestFirst heap(weight);
    for (std::size_t remaining = n; remaining > count_ && !heap.empty();) {
      const std::uint32_t i = heap.pop();
      std::uint32_t& others = left[component_[candidate_[i].face]];
      if (others == 1) continue;  // The last of its component stays.
      --others;
      --remaining;
      kept_[i] = 0;
      each_neighbor(i, [&](std::uint32_t j) {
        if (!kept_[j]) return;
        if (const float by = crowding(i, j); by > 0) heap.lower(j, by);
      });
    }
  }

  const TriangleMesh& mesh_;
  const Array<std::uint32_t>& component_;
  double spacing_;
  std::size_t count_;
  std::uint64_t seed_;
  float nearest_ = 0;  ///< The paper's 2 r_min.
  Array<Candidate> candidate_;
  Array<Vec3f> position_;
  Array<float> share_;                  ///< Area that a point stands for.
  std::vector<double> component_area_;  ///< By the lowest face.
  Array<Vec3f> normal_;                 ///< Of the faces.
  Array<std::uint32_t> neighbor_;       ///< kMostNeighbors for each point, itself among them.
  Array<float> reach2_;                 ///< Squared distance that its neighbours are within.
  Array<std::uint8_t> kept_;
};

EliminatedSamples Elimination::samples() const {
  const std::size_t n = candidate_.size();
  // The nearest sample of each point and how far it is; for a sample the nearest other one.
  Array<std::uint32_t> nearest(n);
  Array<float> away(n);
  parallel_each(n, kGrain, [&](std::size_t i) {
    const auto at = static_cast<std::uint32_t>(i);
    nearest[i] = kNone;
    away[i] = std::numeric_limits<float>::infinity();
    each_neighbor(at, [&](std::uint32_t j) {
      if (!kept_[j]) return;
      const float d = distance(at, j);
      if (d < away[i]) {
        away[i] = d;
        nearest[i] = j;
      }
    });
  });
  Array<double> area;
  area.assign(n, 0);
  EliminatedSamples out;
  std::size_t uncovered = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (kept_[i]) {
      area[i] += share_[i];
    } else if (nearest[i] != kNone) {
      area[nearest[i]] += share_[i];
    }
    uncovered += !kept_[i] && !(away[i] <= static_cast<float>(PoissonDisk::kCoverageRadius));
  }
  out.uncovered = static_cast<double>(uncovered) / static_cast<double>(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (!kept_[i]) continue;
    const Candidate& c = candidate_[i];
    const float distance =
        nearest[i] == kNone ? away[i] : (position_[i] - position_[nearest[i]]).norm();
    out.sample.push_back({position_[i], c.face, static_cast<float>(area[i]), distance, c.size});
  }
  return out;
}

/// Area of the triangle within the radius around p, or more: of the strip along its longest edge
/// that is as wide as the triangle is high.
double area_around(const FaceCorners& corner, double area, const Vec3d& p, double radius) {
  int longest = 0;
  const auto edge = [&](int k) -> Vec3d { return corner[(k + 1) % 3] - corner[k]; };
  for (int k = 1; k < 3; ++k) {
    if (edge(k).squaredNorm() > edge(longest).squaredNorm()) longest = k;
  }
  const double length = edge(longest).norm();
  if (!(length > 0)) return 0;
  const double height = 2 * area / length;
  const Vec3d to_p = p - corner[longest];
  const double at = to_p.dot(edge(longest)) / length;
  const double reach2 = (radius + height) * (radius + height) - (to_p.squaredNorm() - at * at);
  const double reach = std::sqrt(std::max(0.0, reach2));
  const double strip = std::min(length, at + reach) - std::max(0.0, at - reach);
  return std::min(area, height * std::max(0.0, strip));
}

}  // namespace

double least_uncovered(const TriangleMesh& mesh, const SizingField& field, double spacing,
                       std::uint64_t seed) {
  constexpr std::size_t kPlaces = 32;
  const FacesByArea faces(mesh, field);
  std::array<double, kPlaces> uncovered{};
  parallel_each(kPlaces, 1, [&](std::size_t i) {
    Vec3f place;
    const Candidate c = faces.draw(kNone, seed, i, place);
    const Vec3d normal = area_vector(face_corners(mesh, c.face)).normalized();
    const double size = spacing * static_cast<double>(c.size);
    double area = 0;
    for (std::size_t f = 0; f < mesh.face.size(); ++f) {
      const FaceCorners corner = face_corners(mesh, f);
      const Vec3d twice_area = area_vector(corner);
      const double length = twice_area.norm();
      if (twice_area.dot(normal) < static_cast<double>(PoissonDisk::kOpposedCosine) * length) {
        continue;
      }
      area += area_around(corner, length / 2, place.cast<double>(),
                          PoissonDisk::kCoverageRadius * size);
    }
    uncovered[i] = 1 - std::min(1.0, kCandidatesPerSample * area / (size * size));
  });
  return std::accumulate(uncovered.begin(), uncovered.end(), 0.0) / kPlaces;
}

EliminatedSamples eliminate_samples(const TriangleMesh& mesh, const Array<std::uint32_t>& component,
                                    const SizingField& field, double spacing, std::size_t count,
                                    std::uint64_t seed) {
  return Elimination(mesh, component, field, spacing, count, seed).samples();
}

}  // namespace surfel
