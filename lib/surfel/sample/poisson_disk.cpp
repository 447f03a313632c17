#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/random.h>
#include <surfel/sample/poisson_disk.h>
#include <surfel/sample/surface_chunks.h>

namespace surfel {
namespace {

/// Chunks' longest edge and blocks' side in units of the spacing. Working on a block touches chunks
/// up to kChunkEdge (sample to centroid of its chunk, at most 2/3 of an edge, and the same at the
/// far end) + kSheetRadius away; twice that is less than a block's side.
constexpr double kChunkEdge = 5;
constexpr double kBlockSide = 16;
/// Where the spacing varies, it is linear over a chunk.
constexpr double kGradedChunkEdge = 2;
static_assert(2 * (2 * kChunkEdge * 2 / 3 + PoissonDisk::kSheetRadius) < kBlockSide);

using Triangle = std::array<Vec3f, 3>;

float segment_distance2(const Vec3f& p, const Vec3f& a, const Vec3f& b) {
  const Vec3f along = b - a;
  const Vec3f to_p = p - a;
  const float length2 = along.squaredNorm();
  const float t = length2 > 0 ? std::clamp(to_p.dot(along) / length2, 0.0f, 1.0f) : 0.0f;
  return (to_p - t * along).squaredNorm();
}

/// Whether `p` lies straight above the inside of the triangle, closer than sqrt(radius2).
bool hovers_over(const Vec3f& p, const Triangle& t, float radius2) {
  const Vec3f normal = (t[1] - t[0]).cross(t[2] - t[0]);
  const float height = (p - t[0]).dot(normal);
  if (height * height > radius2 * normal.squaredNorm()) return false;
  for (int k = 0; k < 3; ++k) {
    if ((t[(k + 1) % 3] - t[k]).cross(p - t[k]).dot(normal) < 0) return false;
  }
  return true;
}

/// Square of the distance from `p` to the furthest point of the triangle, a corner.
float furthest_corner2(const Vec3f& p, const Triangle& t) {
  return std::max({(t[0] - p).squaredNorm(), (t[1] - p).squaredNorm(), (t[2] - p).squaredNorm()});
}

/// A point uniform in the triangle by area, from two numbers in [0, 1).
Vec3f point_in(const Triangle& t, float a, float b) {
  if (a + b > 1) {
    a = 1 - a;
    b = 1 - b;
  }
  return t[0] + a * (t[1] - t[0]) + b * (t[2] - t[0]);
}

/// Most points that keep the distance r in a triangle: Oler's bound for convex regions (Oler 1961,
/// "An inequality in the geometry of numbers"), and one for rounding.
std::uint32_t packing_bound(const SurfaceChunk& chunk, double r) {
  double perimeter = 0;
  for (int k = 0; k < 3; ++k) perimeter += (chunk.corner[(k + 1) % 3] - chunk.corner[k]).norm();
  const double bound = 2 / std::sqrt(3.0) * chunk.area() / (r * r) + perimeter / (2 * r) + 1;
  return static_cast<std::uint32_t>(bound * (1 + 1e-4)) + 1;
}

/// Uniform in [0, 1) from 24 bits of the lower or upper half.
float fraction(std::uint64_t bits, int half) {
  return static_cast<float>((bits >> (32 * half)) & 0xffffff) * 0x1p-24f;
}

/// How far two triangles face the same way.
enum class Facing { kAgree, kAside, kOpposed };

Facing facing(const Vec3f& normal, const Vec3f& other) {
  const float cosine = normal.dot(other);
  if (cosine >= PoissonDisk::kAgreeCosine) return Facing::kAgree;
  return cosine >= PoissonDisk::kOpposedCosine ? Facing::kAside : Facing::kOpposed;
}

}  // namespace

class PoissonDisk::Impl {
 public:
  Impl(SurfaceChunks surface, const SizingField& field, double spacing, std::uint64_t seed)
      : seed_(seed),
        spacing_(spacing),
        largest_(static_cast<float>(field.largest())),
        gap_((kCoverageRadius - kConflictRadius) / (1 + spacing * field.gradient())),
        surface_(std::move(surface)) {
    prepare_chunks(field);
    std::size_t all = 0;
    for (const std::vector<std::uint32_t>& blocks : surface_.phase) all += blocks.size();
    ProgressStage stage("sampling", all, "blocks");
    for (const std::vector<std::uint32_t>& blocks : surface_.phase) {
      parallel_each(blocks.size(), 1, [&](std::size_t i) {
        sample_block(blocks[i]);
        stage.add(1);
      });
    }
    for (const std::uint16_t used : used_) size_ += used;
  }

  std::size_t size() const { return size_; }

  void fill(std::size_t count) {
    if (size_ >= count) return;
    std::vector<double> area_up_to(surface_.chunk.size());
    double area = 0;
    for (std::size_t c = 0; c < area_up_to.size(); ++c) {
      const double coarser = largest_ / grade_[c].at_corner;
      area += surface_.chunk[c].area() * coarser * coarser;
      area_up_to[c] = area;
    }
    Walk walk;
    const std::uint64_t attempts = 1000 * (count - size_) + 10000;
    for (std::uint64_t i = 0; i < attempts && size_ < count; ++i) {
      const auto at = std::upper_bound(area_up_to.begin(), area_up_to.end(),
                                       random_uniform(~seed_, i, 0) * area);
      if (at == area_up_to.end()) continue;
      const auto chunk = static_cast<std::uint32_t>(at - area_up_to.begin());
      const std::uint64_t bits = random_bits(~seed_, i, 1);
      const Vec3f dart =
          point_in(surface_.chunk[chunk].corner, fraction(bits, 0), fraction(bits, 1));
      const bool free =
          std::all_of(reach_[chunk].begin(), reach_[chunk].end(), [&](std::uint32_t entry) {
            const std::uint32_t slot = entry & ~kAsideBit;
            return (slot_[slot] - dart).squaredNorm() >= radius2(kAsideRadius, size_of_[slot]);
          });
      const float size = size_at(chunk, dart);
      if (!free || find_conflict(walk, chunk, dart, size, kAsideRadius) != kNoSlot) continue;
      add_sample(walk, chunk, dart, size);
      ++size_;
    }
  }

  Array<PoissonSample> samples() const {
    const std::size_t n = surface_.chunk.size();
    Array<std::uint32_t> first_sample(n);
    std::uint32_t sum = 0;
    double total_area = 0;
    for (std::size_t c = 0; c < n; ++c) {
      first_sample[c] = sum;
      sum += used_[c];
      total_area += surface_.chunk[c].area();
    }
    Array<PoissonSample> out(sum);
    // Shares of area are added up as whole numbers: in any order they come to the same.
    Array<std::uint64_t> share;
    share.assign(slot_.size(), 0);
    const double unit = total_area * 0x1p-60;
    parallel_for(n, kGrain, [&](std::size_t begin, std::size_t end, int) {
      NearestShare nearest;
      for (std::size_t c = begin; c < end; ++c) {
        share_area(c, nearest);
        for (std::size_t i = 0; i < nearest.area.size(); ++i) {
          std::atomic_ref<std::uint64_t>(share[reach_[c][i] & ~kAsideBit])
              .fetch_add(static_cast<std::uint64_t>(nearest.area[i] / unit),
                         std::memory_order_relaxed);
        }
      }
    });
    parallel_each(n, kGrain, [&](std::size_t c) {
      for (std::uint32_t k = 0; k < used_[c]; ++k) {
        const std::uint32_t slot = first_slot_[c] + k;
        out[first_sample[c] + k] = {slot_[slot], surface_.chunk[c].face,
                                    static_cast<float>(static_cast<double>(share[slot]) * unit),
                                    nearest_distance(c, slot), size_of_[slot]};
      }
    });
    return out;
  }

 private:
  static constexpr std::size_t kGrain = 1 << 12;
  /// Marks slots of samples set aside.
  static constexpr std::uint32_t kAsideBit = std::uint32_t{1} << 31;
  static constexpr std::uint32_t kNoSlot = ~kAsideBit;

  static float square(double x) { return static_cast<float>(x * x); }

  /// Square of a radius in units of the spacing, for a sample of this size.
  float radius2(double radius, float size) const { return square(radius * spacing_ * size); }

  /// A sample near a triangle that darts are thrown into.
  struct Neighbor {
    Vec3f position;
    float conflict2;  ///< Square of the distance that a dart must keep.
    float coverage;   ///< Radius.
    bool agrees;      ///< Faces the same way, and so may cover.
  };

  /// The field over a chunk: linear.
  struct Grade {
    float at_corner;  ///< Corner 0.
    Vec3f slope;
    float least;
  };

  /// Chunks that a point reaches over the surface.
  struct Walk {
    std::vector<std::uint32_t> chunks;  ///< Chunks in the order of the walk.
    std::vector<std::uint8_t> near;     ///< Whether each is within the coverage radius.
  };

  /// Dart throwing in one chunk.
  struct Darts {
    std::uint32_t chunk;
    std::uint64_t thrown;
    std::vector<Neighbor> pool;       ///< Samples that the chunk sees.
    std::vector<std::uint32_t> list;  ///< Stack of the pool's parts that nested triangles see.
    Walk walk;
  };

  struct NearestShare {
    std::vector<double> area;  ///< Of the chunk's points nearest to each sample that it sees,
                               ///< in units of the sample's size.
    std::vector<Vec3f> position;
    std::vector<float> per_size2;
  };

  void prepare_chunks(const SizingField& field) {
    const std::size_t n = surface_.chunk.size();
    first_slot_.resize(n + 1);
    normal_.resize(n);
    used_.assign(n, 0);
    full_.assign(n, 0);
    visited_.assign(n, 0);
    reach_.resize(n);
    grade_.resize(n);
    parallel_each(n, kGrain, [&](std::size_t c) {
      const SurfaceChunk& chunk = surface_.chunk[c];
      grade_[c] = grade(chunk, field);
      first_slot_[c + 1] = packing_bound(chunk, kAsideRadius * spacing_ * grade_[c].least);
      normal_[c] = chunk.normal();
    });
    first_slot_[0] = 0;
    for (std::size_t c = 0; c < n; ++c) first_slot_[c + 1] += first_slot_[c];
    slot_.resize(first_slot_[n]);
    size_of_.resize(first_slot_[n]);
  }

  static Grade grade(const SurfaceChunk& chunk, const SizingField& field) {
    const std::array<Vec3f, 3>& corner = chunk.corner;
    std::array<double, 3> size{};
    for (int k = 0; k < 3; ++k) size[k] = field.at(corner[k]);
    Grade out{static_cast<float>(size[0]), Vec3f::Zero(),
              static_cast<float>(std::min({size[0], size[1], size[2]}))};
    const Vec3d a = (corner[1] - corner[0]).cast<double>();
    const Vec3d b = (corner[2] - corner[0]).cast<double>();
    const Vec3d normal = a.cross(b);
    const double length2 = normal.squaredNorm();
    if (length2 > 0) {
      const Vec3d slope =
          ((size[1] - size[0]) * b - (size[2] - size[0]) * a).cross(normal) / length2;
      out.slope = slope.cast<float>();
    }
    return out;
  }

  /// The field at a point of the chunk.
  float size_at(std::uint32_t chunk, const Vec3f& p) const {
    const Grade& g = grade_[chunk];
    const float size = g.at_corner + g.slope.dot(p - surface_.chunk[chunk].corner[0]);
    return std::max(size, g.least);
  }

  void sample_block(std::uint32_t block) {
    const std::uint32_t begin = surface_.block_first[block];
    const std::uint32_t end = surface_.block_first[block + 1];
    // In random order, so that no direction of the mesh shows in the samples.
    std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
    order.reserve(end - begin);
    for (std::uint32_t c = begin; c < end; ++c) order.emplace_back(random_bits(seed_, c, 0), c);
    std::sort(order.begin(), order.end());
    Darts darts;
    for (const auto& [key, chunk] : order) {
      if (full_[chunk] || surface_.chunk[chunk].area() <= 0) continue;
      darts.chunk = chunk;
      darts.thrown = 0;
      darts.pool.clear();
      darts.list.clear();
      for (const std::uint32_t entry : reach_[chunk]) {
        darts.pool.push_back(seen(entry & ~kAsideBit, (entry & kAsideBit) == 0));
      }
      cover(surface_.chunk[chunk].corner, darts, 0, 0, 0);
    }
  }

  Neighbor seen(std::uint32_t slot, bool agrees) const {
    const float size = size_of_[slot];
    return {slot_[slot], radius2(agrees ? kConflictRadius : kAsideRadius, size),
            static_cast<float>(kCoverageRadius * spacing_ * size), agrees};
  }

  /// Throws darts into the triangle until it is covered. The samples that may matter are the ones
  /// in darts.list[list_begin, list_end) and the pool's from `known` on.
  void cover(const Triangle& triangle, Darts& darts, std::size_t list_begin, std::size_t list_end,
             std::size_t known) {
    const Vec3f center = (triangle[0] + triangle[1] + triangle[2]) / 3;
    float radius2 = 0;
    for (const Vec3f& corner : triangle) {
      radius2 = std::max(radius2, (corner - center).squaredNorm());
    }
    const float radius = std::sqrt(radius2);
    const std::size_t begin = darts.list.size();
    bool full = false;     // No dart can be taken here.
    bool covered = false;  // One is welcome, but not needed.
    const auto consider = [&](std::uint32_t i) {
      const Neighbor& sample = darts.pool[i];
      const float center2 = (sample.position - center).squaredNorm();
      if (center2 > square(sample.coverage + radius)) return;
      darts.list.push_back(i);
      // A ball that holds the corners holds the centroid.
      const float coverage2 = sample.coverage * sample.coverage;
      if (center2 > coverage2) return;
      const float corner2 = furthest_corner2(sample.position, triangle);
      full = full || corner2 <= sample.conflict2;
      covered = covered || (sample.agrees && corner2 <= coverage2);
    };
    for (std::size_t k = list_begin; k < list_end && !full; ++k) consider(darts.list[k]);
    const std::size_t pool = darts.pool.size();
    for (std::size_t i = known; i < pool && !full; ++i) consider(static_cast<std::uint32_t>(i));
    if (!full) throw_dart(triangle, darts, begin, pool, covered);
    darts.list.resize(begin);
  }

  /// One dart, then the triangle's halves unless it is covered.
  void throw_dart(const Triangle& triangle, Darts& darts, std::size_t begin, std::size_t known,
                  bool covered) {
    const std::uint64_t bits = random_bits(seed_, darts.chunk, ++darts.thrown);
    const Vec3f dart = point_in(triangle, fraction(bits, 0), fraction(bits, 1));
    const std::size_t end = darts.list.size();
    const float size = size_at(darts.chunk, dart);
    const bool taken = !conflicts(darts, begin, end, dart) && take(darts, dart, size);
    if (covered) return;
    const auto coverage = static_cast<float>(kCoverageRadius * spacing_ * size);
    if (taken && furthest_corner2(dart, triangle) <= coverage * coverage) return;
    int longest = 0;
    float length2 = 0;
    for (int k = 0; k < 3; ++k) {
      const float edge2 = (triangle[(k + 1) % 3] - triangle[k]).squaredNorm();
      if (edge2 > length2) {
        length2 = edge2;
        longest = k;
      }
    }
    if (!taken && length2 <= radius2(gap_, size)) return;
    const Vec3f middle = (triangle[longest] + triangle[(longest + 1) % 3]) / 2;
    std::array<Triangle, 2> half{triangle, triangle};
    half[0][(longest + 1) % 3] = middle;
    half[1][longest] = middle;
    const int first = static_cast<int>(bits >> 63);
    cover(half[first], darts, begin, end, known);
    cover(half[1 - first], darts, begin, end, known);
  }

  static bool conflicts(const Darts& darts, std::size_t begin, std::size_t end, const Vec3f& dart) {
    for (std::size_t k = begin; k < end; ++k) {
      const Neighbor& sample = darts.pool[darts.list[k]];
      if ((sample.position - dart).squaredNorm() < sample.conflict2) return true;
    }
    return false;
  }

  /// Makes the dart a sample, unless one that did not reach the dart's chunk is reached from it: a
  /// connection may lie inside the one's ball and not inside the other's.
  bool take(Darts& darts, const Vec3f& dart, float size) {
    const std::uint32_t blocker =
        find_conflict(darts.walk, darts.chunk, dart, size, kConflictRadius);
    if (blocker == kNoSlot) {
      const std::uint32_t slot = add_sample(darts.walk, darts.chunk, dart, size);
      darts.pool.push_back(seen(slot, true));
      return true;
    }
    // From now on the chunk sees it, so that what it blocks counts as covered by it.
    reach_[darts.chunk].push_back(blocker);
    darts.pool.push_back(seen(blocker & ~kAsideBit, (blocker & kAsideBit) == 0));
    return false;
  }

  /// Walks from the chunk to all that faces connect to it inside the sheet's ball around `p`.
  /// Returns a sample there (with kAsideBit) that is too close, closer than the radius `agree` if
  /// it faces the same way, than kAsideRadius if aside; or kNoSlot.
  std::uint32_t find_conflict(Walk& walk, std::uint32_t start, const Vec3f& p, float size,
                              double agree) {
    const float sheet2 = radius2(kSheetRadius, size);
    const auto coverage = static_cast<float>(kCoverageRadius * spacing_ * size);
    const float coverage2 = coverage * coverage;
    walk.chunks.assign(1, start);
    walk.near.clear();
    visited_[start] = 1;
    std::uint32_t blocker = kNoSlot;
    for (std::size_t i = 0; i < walk.chunks.size() && blocker == kNoSlot; ++i) {
      const std::uint32_t at = walk.chunks[i];
      const SurfaceChunk& c = surface_.chunk[at];
      float closest2 = std::numeric_limits<float>::infinity();
      for (int k = 0; k < 3; ++k) {
        const float edge2 = segment_distance2(p, c.corner[k], c.corner[(k + 1) % 3]);
        closest2 = std::min(closest2, edge2);
        if (edge2 <= sheet2) visit_around(3 * at + k, walk);
      }
      walk.near.push_back(at == start || closest2 <= coverage2 ||
                          hovers_over(p, c.corner, coverage2));
      if (used_[at] > 0) blocker = too_close(at, p, normal_[start], agree);
    }
    for (const std::uint32_t chunk : walk.chunks) visited_[chunk] = 0;
    return blocker;
  }

  std::uint32_t too_close(std::uint32_t chunk, const Vec3f& p, const Vec3f& normal,
                          double agree) const {
    const Facing side = facing(normal, normal_[chunk]);
    if (side == Facing::kOpposed) return kNoSlot;
    const double radius = side == Facing::kAgree ? agree : kAsideRadius;
    for (std::uint32_t k = 0; k < used_[chunk]; ++k) {
      const std::uint32_t slot = first_slot_[chunk] + k;
      if ((slot_[slot] - p).squaredNorm() < radius2(radius, size_of_[slot])) {
        return side == Facing::kAgree ? slot : slot | kAsideBit;
      }
    }
    return kNoSlot;
  }

  /// Adds the chunks around an edge that the walk has not met yet.
  void visit_around(std::uint32_t half_edge, Walk& walk) {
    std::uint32_t next = half_edge;
    for (;;) {
      next = surface_.chunk[next / 3].neighbor[next % 3];
      if (next == SurfaceChunk::kBorder || next == half_edge) return;
      if (visited_[next / 3]) continue;
      visited_[next / 3] = 1;
      walk.chunks.push_back(next / 3);
    }
  }

  /// Takes the sample that `walk` was made for by find_conflict(), and announces it to the chunks
  /// that the walk reached; returns its slot.
  std::uint32_t add_sample(const Walk& walk, std::uint32_t chunk, const Vec3f& p, float size) {
    const std::uint32_t slot = first_slot_[chunk] + used_[chunk]++;
    slot_[slot] = p;
    size_of_[slot] = size;
    const float conflict2 = radius2(kConflictRadius, size);
    const float aside_conflict2 = radius2(kAsideRadius, size);
    for (std::size_t i = 0; i < walk.chunks.size(); ++i) {
      if (!walk.near[i]) continue;
      const std::uint32_t at = walk.chunks[i];
      const Facing side = facing(normal_[chunk], normal_[at]);
      if (side == Facing::kOpposed && at != chunk) continue;
      const bool agrees = side == Facing::kAgree || at == chunk;
      reach_[at].push_back(agrees ? slot : slot | kAsideBit);
      if (furthest_corner2(p, surface_.chunk[at].corner) <=
          (agrees ? conflict2 : aside_conflict2)) {
        full_[at] = 1;
      }
    }
    return slot;
  }

  /// Area of the chunk's points by the sample of reach_[chunk] that is nearest in units of its
  /// size, by quadrature.
  void share_area(std::size_t chunk, NearestShare& nearest) const {
    const SurfaceChunk& c = surface_.chunk[chunk];
    nearest.area.assign(reach_[chunk].size(), 0);
    nearest.position.clear();
    nearest.per_size2.clear();
    for (const std::uint32_t entry : reach_[chunk]) {
      const std::uint32_t slot = entry & ~kAsideBit;
      nearest.position.push_back(slot_[slot]);
      const float finer = largest_ / size_of_[slot];
      nearest.per_size2.push_back(finer * finer);
    }
    if (nearest.position.empty()) return;
    float edge = 0;
    for (int k = 0; k < 3; ++k) {
      edge = std::max(edge, (c.corner[(k + 1) % 3] - c.corner[k]).norm());
    }
    constexpr double kPointsPerSpacing = 1.5;  // Along an edge: denser than samples lie.
    const double spacing = spacing_ * grade_[chunk].least;
    const int n = std::max(1, static_cast<int>(std::ceil(kPointsPerSpacing * edge / spacing)));
    const double part = c.area() / (n * n);
    const Vec3f u = (c.corner[1] - c.corner[0]) / static_cast<float>(n);
    const Vec3f v = (c.corner[2] - c.corner[0]) / static_cast<float>(n);
    const auto add = [&](float i, float j) {
      const Vec3f p = c.corner[0] + i * u + j * v;
      std::size_t best = 0;
      float best2 = std::numeric_limits<float>::infinity();
      for (std::size_t k = 0; k < nearest.position.size(); ++k) {
        const float d2 = (nearest.position[k] - p).squaredNorm() * nearest.per_size2[k];
        if (d2 < best2) {
          best2 = d2;
          best = k;
        }
      }
      nearest.area[best] += part;
    };
    // Centroids of the n^2 equal triangles, upright and upside down.
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        add(static_cast<float>(i) + 1 / 3.0f, static_cast<float>(j) + 1 / 3.0f);
        if (i + j + 1 < n) add(static_cast<float>(i) + 2 / 3.0f, static_cast<float>(j) + 2 / 3.0f);
      }
    }
  }

  float nearest_distance(std::size_t chunk, std::uint32_t slot) const {
    float best2 = std::numeric_limits<float>::infinity();
    for (const std::uint32_t entry : reach_[chunk]) {
      const std::uint32_t other = entry & ~kAsideBit;
      if (other != slot) best2 = std::min(best2, (slot_[other] - slot_[slot]).squaredNorm());
    }
    return std::sqrt(best2);
  }

  std::uint64_t seed_;
  double spacing_;
  float largest_;  ///< Largest value of the field.
  double gap_;  ///< Between the radii of coverage and conflict of a sample that rejects a dart, in
                ///< spacings where the dart fell.
  SurfaceChunks surface_;
  std::size_t size_ = 0;
  Array<Vec3f> normal_;              ///< Normals of the chunks; zero where degenerate.
  Array<std::uint32_t> first_slot_;  ///< Each chunk has room for as many samples as fit.
  Array<Vec3f> slot_;                ///< Positions.
  Array<float> size_of_;             ///< The field at the slots' samples.
  Array<Grade> grade_;               ///< Grades of the chunks.
  Array<std::uint16_t> used_;        ///< Slots taken, per chunk.
  Array<std::uint8_t> full_;         ///< One sample leaves no room in the chunk.
  Array<std::uint8_t> visited_;      ///< The walk that is under way has been here.
  std::vector<std::vector<std::uint32_t>> reach_;  ///< Samples that a chunk sees: slots, with
                                                   ///< kAsideBit where they face aside.
};

std::unique_ptr<PoissonDisk> PoissonDisk::make(const TriangleMesh& mesh,
                                               const Array<std::uint32_t>& neighbor,
                                               const SizingField& field, double spacing,
                                               std::uint64_t seed, std::size_t most_chunks) {
  std::optional<SurfaceChunks> surface = make_surface_chunks(
      mesh, neighbor, field, (field.gradient() > 0 ? kGradedChunkEdge : kChunkEdge) * spacing,
      kBlockSide * field.largest() * spacing, most_chunks);
  if (!surface) return nullptr;
  return std::unique_ptr<PoissonDisk>(
      new PoissonDisk(std::make_unique<Impl>(std::move(*surface), field, spacing, seed)));
}

PoissonDisk::PoissonDisk(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PoissonDisk::~PoissonDisk() = default;
std::size_t PoissonDisk::size() const { return impl_->size(); }
void PoissonDisk::fill(std::size_t count) { impl_->fill(count); }
Array<PoissonSample> PoissonDisk::samples() const { return impl_->samples(); }

}  // namespace surfel
