#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <surfel/base/types.h>

namespace surfel {

/// Edges between neighbouring points with unit normals (zero = unknown) of either side: how well
/// they follow the surface, and which sides they carry over. Both are the same from either end.
class SurfaceEdges {
 public:
  /// Weight of a pair of points without an edge, above all weights of edges.
  static constexpr float kNoEdge = 2;

  /// Both arrays outlive this object; normals may be turned while it lives.
  SurfaceEdges(const Array<Vec3f>& position, const Array<Vec3f>& normal)
      : position_(position), normal_(normal) {}

  bool known(std::size_t i) const { return !normal_[i].isZero(0); }

  /// Weight of an edge in 0..1, see orient_normals(), or kNoEdge. Both normals are known.
  float weight(std::size_t i, std::size_t j) const {
    const Vec3f edge = position_[j] - position_[i];
    const float length2 = edge.squaredNorm();
    float sine2 = 0;
    if (length2 > 0) {
      const float a = edge.dot(normal_[i]);
      const float b = edge.dot(normal_[j]);
      sine2 = std::min(1.0F, std::max(a * a, b * b) / length2);
    }
    if (sine2 > kSteepestSine2) return kNoEdge;
    return 1 - std::min(1.0F, std::abs(agreement(i, j))) * (1 - sine2);
  }

  /// Above zero where the normals are on the same side of the surface: their product, or in sharp
  /// bends the product of n_j and n_i mirrored at the plane half-way between the points.
  float agreement(std::size_t i, std::size_t j) const {
    const float product = normal_[i].dot(normal_[j]);
    const Vec3f edge = position_[j] - position_[i];
    const float length2 = edge.squaredNorm();
    if (std::abs(product) >= kBend || !(length2 > 0)) return product;
    const float mirrored = product - 2 * edge.dot(normal_[i]) * edge.dot(normal_[j]) / length2;
    return std::abs(mirrored) > std::abs(product) ? mirrored : product;
  }

  bool opposed(std::size_t i, std::size_t j) const { return agreement(i, j) < 0; }

 private:
  /// Squared sine of 51 degrees: steeper edges to a tangent plane lead to another sheet. 45 degrees
  /// (along_sheet() in surface/sheet.h) would be too strict here, as all edges across a
  /// right-angled bend may have them, and the bend's sides would fall apart.
  static constexpr float kSteepestSine2 = 0.6F;
  /// Cosine of 45 degrees: bends by more need the edge to tell the side, as the normals' own
  /// product is near zero, and its sign chance.
  static constexpr float kBend = 0.7F;

  const Array<Vec3f>& position_;
  const Array<Vec3f>& normal_;
};

}  // namespace surfel
