#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/sample/surface_chunks.h>

namespace surfel {
namespace {

constexpr std::size_t kChunkGrain = 1 << 14;

/// How a triangle is cut when the edges of a mask are halved: corners 0..2 are the triangle's, 3 +
/// k is the middle of edge k.
struct SplitPattern {
  int count = 0;
  std::array<std::array<int, 3>, 4> corner{};
};

/// `pattern` for the mask turned by `turns` edges.
SplitPattern rotated(const SplitPattern& pattern, int turns) {
  SplitPattern out = pattern;
  for (auto& child : out.corner) {
    for (int& id : child) id = id < 3 ? (id + turns) % 3 : 3 + (id - 3 + turns) % 3;
  }
  return out;
}

std::array<SplitPattern, 8> make_split_patterns() {
  const SplitPattern whole{1, {{{0, 1, 2}}}};
  const SplitPattern one{2, {{{0, 3, 2}, {3, 1, 2}}}};             // Edge 0.
  const SplitPattern two{3, {{{3, 1, 4}, {0, 3, 4}, {0, 4, 2}}}};  // Edges 0 and 1.
  const SplitPattern all{4, {{{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}}}};
  return {whole, one, rotated(one, 1), two, rotated(one, 2), rotated(two, 2), rotated(two, 1), all};
}

const std::array<SplitPattern, 8>& split_patterns() {
  static const std::array<SplitPattern, 8> patterns = make_split_patterns();
  return patterns;
}

struct ChildEdge {
  int child;
  int edge;
};

/// The child that has the directed edge from id `a` to id `b`, or child -1.
ChildEdge find_edge(const SplitPattern& pattern, int a, int b) {
  for (int child = 0; child < pattern.count; ++child) {
    for (int k = 0; k < 3; ++k) {
      if (pattern.corner[child][k] == a && pattern.corner[child][(k + 1) % 3] == b) {
        return {child, k};
      }
    }
  }
  return {-1, -1};
}

/// Whether an edge is longer than allowed. Both directions of an edge get one answer, to the last
/// bit.
class EdgeLimit {
 public:
  EdgeLimit(const SizingField& spacing, double edge_spacings)
      : spacing_(spacing), edge_spacings_(edge_spacings) {}

  bool exceeded(const Vec3f& a, const Vec3f& b) const {
    const double length2 = (b - a).squaredNorm();
    const auto longer = [&](double spacing) {
      const double limit = edge_spacings_ * spacing;
      return length2 > limit * limit;
    };
    if (longer(spacing_.largest())) return true;
    if (!longer(spacing_.least())) return false;
    return longer(spacing_.at((a + b) / 2)) || longer(spacing_.at(a)) || longer(spacing_.at(b));
  }

 private:
  const SizingField& spacing_;
  double edge_spacings_;
};

/// One halving of all edges longer than a limit.
class RefinementRound {
 public:
  RefinementRound(const Array<SurfaceChunk>& chunks, const EdgeLimit& limit) : chunks_(chunks) {
    const std::size_t n = chunks.size();
    mask_.resize(n);
    parallel_each(n, kChunkGrain, [&](std::size_t i) {
      mask_[i] = 0;
      for (int k = 0; k < 3; ++k) {
        if (limit.exceeded(chunks[i].corner[k], chunks[i].corner[(k + 1) % 3])) {
          mask_[i] |= static_cast<std::uint8_t>(1 << k);
        }
      }
    });
    first_child_.resize(n + 1);
    std::uint32_t sum = 0;
    for (std::size_t i = 0; i < n; ++i) {
      first_child_[i] = sum;
      sum += pattern(i).count;
    }
    first_child_[n] = sum;
  }

  std::size_t count() const { return first_child_.back(); }
  bool anything_to_do() const { return count() > chunks_.size(); }

  Array<SurfaceChunk> children() const {
    Array<SurfaceChunk> out(first_child_.back());
    parallel_each(chunks_.size(), kChunkGrain, [&](std::size_t i) { split(i, out); });
    return out;
  }

 private:
  const SplitPattern& pattern(std::size_t chunk) const { return split_patterns()[mask_[chunk]]; }

  void split(std::size_t i, Array<SurfaceChunk>& out) const {
    const SurfaceChunk& parent = chunks_[i];
    const SplitPattern& children = pattern(i);
    std::array<Vec3f, 6> point;
    for (int k = 0; k < 3; ++k) {
      point[k] = parent.corner[k];
      point[3 + k] = (parent.corner[k] + parent.corner[(k + 1) % 3]) / 2;
    }
    for (int c = 0; c < children.count; ++c) {
      SurfaceChunk& child = out[first_child_[i] + c];
      child.face = parent.face;
      for (int k = 0; k < 3; ++k) {
        const int a = children.corner[c][k];
        const int b = children.corner[c][(k + 1) % 3];
        child.corner[k] = point[a];
        const ChildEdge sibling = find_edge(children, b, a);
        child.neighbor[k] = sibling.child >= 0
                                ? 3 * (first_child_[i] + sibling.child) + sibling.edge
                                : across(parent, a, b);
      }
    }
  }

  /// Neighbour across the piece of a parent's edge from id `a` to id `b`.
  std::uint32_t across(const SurfaceChunk& parent, int a, int b) const {
    const int edge = a < 3 ? a : a - 3;
    const std::uint32_t twin = parent.neighbor[edge];
    if (twin == SurfaceChunk::kBorder) return twin;
    const std::uint32_t other = twin / 3;
    const int e = static_cast<int>(twin % 3);
    // Ids at the other side: its edge e runs from e to e + 1, the same way or the other.
    const bool same_way = chunks_[other].corner[e] == parent.corner[edge];
    const auto id_there = [&](int id) {
      if (id >= 3) return 3 + e;
      return (id == edge) == same_way ? e : (e + 1) % 3;
    };
    const ChildEdge found = same_way ? find_edge(pattern(other), id_there(a), id_there(b))
                                     : find_edge(pattern(other), id_there(b), id_there(a));
    if (found.child < 0) return SurfaceChunk::kBorder;  // The edges do not coincide.
    return 3 * (first_child_[other] + found.child) + found.edge;
  }

  const Array<SurfaceChunk>& chunks_;
  Array<std::uint8_t> mask_;  ///< Edges to halve.
  std::vector<std::uint32_t> first_child_;
};

Array<SurfaceChunk> whole_faces(const TriangleMesh& mesh, const Array<std::uint32_t>& neighbor) {
  Array<SurfaceChunk> chunks(mesh.face.size());
  parallel_each(chunks.size(), kChunkGrain, [&](std::size_t f) {
    chunks[f].face = static_cast<std::uint32_t>(f);
    for (int k = 0; k < 3; ++k) {
      chunks[f].corner[k] = mesh.position[mesh.face[f][k]];
      chunks[f].neighbor[k] = neighbor[3 * f + k];
    }
  });
  return chunks;
}

Vec3d area_vector(const SurfaceChunk& chunk) {
  const Vec3d a = (chunk.corner[1] - chunk.corner[0]).cast<double>();
  const Vec3d b = (chunk.corner[2] - chunk.corner[0]).cast<double>();
  return a.cross(b) / 2;
}

/// Morton codes of the blocks that hold the chunks' centroids.
Array<std::uint64_t> block_keys(const Array<SurfaceChunk>& chunks, double block_side) {
  Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
  for (const SurfaceChunk& chunk : chunks) {
    for (const Vec3f& corner : chunk.corner) low = low.cwiseMin(corner);
  }
  Array<std::uint64_t> keys(chunks.size());
  parallel_each(chunks.size(), kChunkGrain, [&](std::size_t i) {
    const Vec3f centroid = (chunks[i].corner[0] + chunks[i].corner[1] + chunks[i].corner[2]) / 3;
    const Vec3d cell = ((centroid - low).cast<double>() / block_side).cwiseMax(0);
    keys[i] =
        morton_code(static_cast<std::uint32_t>(cell.x()), static_cast<std::uint32_t>(cell.y()),
                    static_cast<std::uint32_t>(cell.z()));
  });
  return keys;
}

}  // namespace

double SurfaceChunk::area() const { return area_vector(*this).norm(); }

Vec3f SurfaceChunk::normal() const { return area_vector(*this).normalized().cast<float>(); }

std::optional<SurfaceChunks> make_surface_chunks(const TriangleMesh& mesh,
                                                 const Array<std::uint32_t>& neighbor,
                                                 const SizingField& spacing, double edge_spacings,
                                                 double block_side, std::size_t most_chunks) {
  Array<SurfaceChunk> chunks = whole_faces(mesh, neighbor);
  const EdgeLimit limit(spacing, edge_spacings);
  for (;;) {
    const RefinementRound round(chunks, limit);
    if (!round.anything_to_do()) break;
    if (round.count() > most_chunks) return std::nullopt;
    Array<SurfaceChunk> children = round.children();
    chunks = std::move(children);
  }

  Array<std::uint64_t> keys = block_keys(chunks, block_side);
  const Array<std::uint32_t> order = sort_keys(keys);
  Array<std::uint32_t> place(chunks.size());
  SurfaceChunks sorted;
  sorted.chunk.resize(chunks.size());
  for (std::size_t i = 0; i < order.size(); ++i) place[order[i]] = static_cast<std::uint32_t>(i);
  parallel_each(order.size(), kChunkGrain, [&](std::size_t i) {
    SurfaceChunk& chunk = sorted.chunk[i];
    chunk = chunks[order[i]];
    for (std::uint32_t& n : chunk.neighbor) {
      if (n != SurfaceChunk::kBorder) n = 3 * place[n / 3] + n % 3;
    }
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i > 0 && keys[i] == keys[i - 1]) continue;
    // The lowest bits of the three coordinates: blocks of equal parity never touch.
    sorted.phase[keys[i] & 7].push_back(static_cast<std::uint32_t>(sorted.block_first.size()));
    sorted.block_first.push_back(static_cast<std::uint32_t>(i));
  }
  sorted.block_first.push_back(static_cast<std::uint32_t>(order.size()));
  return sorted;
}

}  // namespace surfel
