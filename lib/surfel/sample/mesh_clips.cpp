#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <surfel/base/elementary.h>
#include <surfel/sample/mesh_clips.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/mesh_face.h>

namespace surfel {
namespace {

/// Distance of the origin from the segment from a to b.
double distance_to_segment(const Vec3d& a, const Vec3d& b) {
  const Vec3d along = b - a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp(-a.dot(along) / length2, 0.0, 1.0) : 0.0;
  return (a + t * along).norm();
}

}  // namespace

MeshClips::MeshClips(const TriangleMesh& mesh, const Array<std::uint32_t>& rings,
                     double crease_angle) {
  const double least_cosine = portable::cos(crease_angle);
  Array<Vec3d> normal(mesh.face.size());
  for (std::size_t f = 0; f < normal.size(); ++f) {
    const Vec3d area = area_vector(face_corners(mesh, f));
    const double length = area.norm();
    normal[f] = length > 0 ? Vec3d(area / length) : Vec3d(0, 0, 0);
  }
  Array<std::uint32_t> smooth = rings;
  for (std::uint32_t e = 0; e < rings.size(); ++e) {
    const std::uint32_t next = rings[e];
    if (next == kBorderEdge) continue;
    const Vec3d& a = normal[e / 3];
    const Vec3d& b = normal[next / 3];
    // A face without area is no side of a crease.
    const bool flat = a.isZero(0) || b.isZero(0) || a.dot(b) >= least_cosine;
    if (rings[next] != e || !flat) smooth[e] = kBorderEdge;
    if (rings[next] == e && !flat) creases_.push_back(e);
  }
  patch_ = face_components(smooth);
  for (std::uint32_t e = 0; e < smooth.size(); ++e) {
    if (smooth[e] != kBorderEdge || normal[e / 3].isZero(0)) continue;
    const FaceCorners corner = face_corners(mesh, e / 3);
    const Vec3d& from = corner[e % 3];
    const Vec3d& to = corner[(e % 3 + 1) % 3];
    const Vec3d outward = (to - from).cross(normal[e / 3]);
    if (!(outward.norm() > 0)) continue;
    edges_.push_back({from, to, outward.normalized(), patch_[e / 3]});
  }
  tree_ = BoxTree<Node, 4, 4>(edges_.size(), [this](std::size_t i) {
    Node node;
    node.min = edges_[i].from.cwiseMin(edges_[i].to);
    node.max = edges_[i].from.cwiseMax(edges_[i].to);
    return node;
  });
}

Array<std::uint32_t> MeshClips::cut_creases(const TriangleMesh& mesh,
                                            const Array<std::uint32_t>& rings,
                                            FunctionRef<double(const Vec3d&)> reach_at) const {
  constexpr std::size_t kGrain = 256;
  std::vector<unsigned char> cuts(creases_.size());
  parallel_each(creases_.size(), kGrain, [&](std::size_t i) {
    const std::uint32_t e = creases_[i];
    const FaceCorners corner = face_corners(mesh, e / 3);
    const Vec3d middle = (corner[e % 3] + corner[(e % 3 + 1) % 3]) / 2;
    const Vec3d normal = area_vector(corner).normalized();
    cuts[i] = around(e / 3, middle, normal, reach_at(middle)).count > 0 ? 1 : 0;
  });
  Array<std::uint32_t> cut = rings;
  for (std::size_t i = 0; i < creases_.size(); ++i) {
    if (cuts[i] == 0) continue;
    cut[creases_[i]] = cut[rings[creases_[i]]] = kBorderEdge;
  }
  return cut;
}

/// Whether edges lie along a line for nearly half of its chord of the disc at least, which they do
/// beside a corner as well.
bool MeshClips::follows(const Line& line, const Vec3d& normal, const std::vector<FlatEdge>& edges,
                        double reach) {
  constexpr double kLeastShare = 0.45;
  constexpr double kApart = 0.1;  // Of the reach: how far edges of a curve are from a tangent.
  constexpr double kLeastCosine = 0.8;
  const double half = std::sqrt(std::max(0.0, reach * reach - line.distance * line.distance));
  const Vec3d along = normal.cross(line.direction);
  std::vector<std::pair<double, double>> parts;
  for (const FlatEdge& edge : edges) {
    if (edge.line.direction.dot(line.direction) < kLeastCosine) continue;
    // The part of the edge, from 0 to 1, that lies within the disc and near the line.
    double first = 0;
    double last = 1;
    const auto keep_below = [&](double at_from, double at_to, double most) {
      const double slope = at_to - at_from;
      if (slope > 0) last = std::min(last, (most - at_from) / slope);
      if (slope < 0) first = std::max(first, (most - at_from) / slope);
      if (slope == 0 && at_from > most) last = -1;
    };
    const auto keep_within = [&](double at_from, double at_to, double most) {
      keep_below(at_from, at_to, most);
      keep_below(-at_from, -at_to, most);
    };
    const double a = along.dot(edge.from);
    const double b = along.dot(edge.to);
    keep_within(a, b, half);
    keep_within(line.direction.dot(edge.from) - line.distance,
                line.direction.dot(edge.to) - line.distance, kApart * reach);
    if (!(first < last)) continue;
    parts.emplace_back(std::minmax({a + first * (b - a), a + last * (b - a)}));
  }
  std::sort(parts.begin(), parts.end());
  double covered = 0;
  double end = -half;
  for (const auto& [a, b] : parts) {
    if (b > end) covered += b - std::max(a, end);
    end = std::max(end, b);
  }
  return covered >= kLeastShare * 2 * half;
}

MeshClips::Lines MeshClips::around(std::uint32_t face, const Vec3d& place, const Vec3d& normal,
                                   double reach) const {
  constexpr double kAgree = 0.5;       // As sheets agree in poisson_disk.h.
  constexpr double kSameLine = 0.985;  // Cosine of 10 degrees: edges of one curve.
  Lines lines;
  std::vector<FlatEdge> edges;
  // Samples at an edge lie beyond it by the rounding of their coordinates.
  const double rounding = std::numeric_limits<float>::epsilon() * place.cwiseAbs().maxCoeff();
  const double most_beyond = 1e-3 * reach + 2 * rounding;
  const auto near = [&](const Node& node) {
    return (node.min - place).cwiseMax(place - node.max).cwiseMax(0.0).squaredNorm() <=
           reach * reach;
  };
  tree_.for_each_leaf(near, [&](std::size_t leaf) {
    tree_.for_each_item(leaf, [&](std::size_t i) {
      const Edge& edge = edges_[i];
      if (edge.patch != patch_[face]) return;
      const Vec3d to = edge.to - place;
      const Vec3d from = edge.from - place;
      const double away = distance_to_segment(from, to);
      if (!(away < reach)) return;
      if ((edge.outward.cross(to - from)).normalized().dot(normal) < kAgree) return;
      const auto flat = [&](const Vec3d& v) -> Vec3d { return v - normal * normal.dot(v); };
      const Vec3d along = flat(to - from);
      Vec3d direction = along.cross(normal);
      if (!(direction.norm() > 0)) return;
      direction.normalize();
      if (direction.dot(edge.outward) < 0) direction = -direction;
      const double distance = direction.dot(from);
      if (!(distance >= -most_beyond)) return;
      edges.push_back({flat(from), flat(to), {direction, std::max(0.0, distance)}, away});
    });
  });
  if (edges.empty()) return lines;
  // At a corner both edges may be equally near: the one whose line cuts less comes first.
  std::sort(edges.begin(), edges.end(), [](const FlatEdge& a, const FlatEdge& b) {
    return a.away != b.away ? a.away < b.away : a.line.distance > b.line.distance;
  });
  const FlatEdge* first = nullptr;
  for (const FlatEdge& edge : edges) {
    if (lines.count == 2 || !(edge.line.distance < reach)) continue;
    if (first) {
      if (edge.line.direction.dot(first->line.direction) > kSameLine) continue;
      // At a reflex corner the first edge lies beyond the line of the second.
      const double tolerance = 1e-3 * reach;
      const auto beyond = [&](const Vec3d& p) {
        // What is far away along the edge is of no concern here.
        const Vec3d foot = first->line.direction * first->line.distance;
        const Vec3d offset = p - foot;
        const Vec3d near_by = foot + offset * std::min(1.0, 1.5 * reach / offset.norm());
        return edge.line.direction.dot(near_by) > edge.line.distance + tolerance;
      };
      if (beyond(first->from) || beyond(first->to)) continue;
    }
    if (!follows(edge.line, normal, edges, reach)) continue;
    if (!first) first = &edge;
    lines.line[static_cast<std::size_t>(lines.count++)] = edge.line;
  }
  return lines;
}

}  // namespace surfel
