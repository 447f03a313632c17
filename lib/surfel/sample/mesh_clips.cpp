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

constexpr double kSameLine = 0.985;  // Cosine of 10 degrees: edges of one curve.

/// The part of the segment from a to b within a distance of the origin; both ends at the point that
/// is nearest to the origin where there is none.
std::pair<Vec3d, Vec3d> part_within(const Vec3d& a, const Vec3d& b, double distance) {
  const Vec3d along = b - a;
  const double length2 = along.squaredNorm();
  const double middle = length2 > 0 ? -a.dot(along) / length2 : 0.0;
  const double rest2 = distance * distance - (a + middle * along).squaredNorm();
  const double half = length2 > 0 && rest2 > 0 ? std::sqrt(rest2 / length2) : 0.0;
  const auto at = [&](double t) -> Vec3d { return a + std::clamp(t, 0.0, 1.0) * along; };
  return {at(middle - half), at(middle + half)};
}

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

/// Whether edges lie along a part of a line for nearly half of it at least. Along the whole chord
/// of the disc they do so beside a convex corner as well.
bool MeshClips::follows(const Line& line, const Chord& chord, const Vec3d& normal,
                        const std::vector<FlatEdge>& edges, double reach) {
  constexpr double kLeastShare = 0.45;
  constexpr double kApart = 0.1;  // Of the reach: how far edges of a curve are from a tangent.
  constexpr double kLeastCosine = 0.8;
  const Vec3d along = normal.cross(line.direction);
  std::vector<std::pair<double, double>> parts;
  for (const FlatEdge& edge : edges) {
    if (edge.line.direction.dot(line.direction) < kLeastCosine) continue;
    // The part of the edge, from 0 to 1, that lies beside the chord and near the line.
    double first = 0;
    double last = 1;
    const auto keep_below = [&](double at_from, double at_to, double most) {
      const double slope = at_to - at_from;
      if (slope > 0) last = std::min(last, (most - at_from) / slope);
      if (slope < 0) first = std::max(first, (most - at_from) / slope);
      if (slope == 0 && at_from > most) last = -1;
    };
    const auto keep_within = [&](double at_from, double at_to, double least, double most) {
      keep_below(at_from, at_to, most);
      keep_below(-at_from, -at_to, -least);
    };
    const double a = along.dot(edge.from);
    const double b = along.dot(edge.to);
    keep_within(a, b, chord.from, chord.to);
    keep_within(line.direction.dot(edge.from) - line.distance,
                line.direction.dot(edge.to) - line.distance, -kApart * reach, kApart * reach);
    if (!(first < last)) continue;
    parts.emplace_back(std::minmax({a + first * (b - a), a + last * (b - a)}));
  }
  std::sort(parts.begin(), parts.end());
  double covered = 0;
  double end = chord.from;
  for (const auto& [a, b] : parts) {
    if (b > end) covered += b - std::max(a, end);
    end = std::max(end, b);
  }
  return covered >= kLeastShare * (chord.to - chord.from);
}

/// The edges within reach of a sample, nearest first.
std::vector<MeshClips::FlatEdge> MeshClips::edges_around(std::uint32_t face, const Vec3d& place,
                                                         const Vec3d& normal, double reach) const {
  constexpr double kAgree = 0.5;  // As sheets agree in poisson_disk.h.
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
      const bool beyond = !(distance >= -most_beyond);
      edges.push_back({flat(from),
                       flat(to),
                       {direction, beyond ? distance : std::max(0.0, distance)},
                       away,
                       i,
                       beyond});
    });
  });
  // At a corner both edges may be equally near: the one whose line cuts less comes first.
  std::sort(edges.begin(), edges.end(), [](const FlatEdge& a, const FlatEdge& b) {
    if (a.away != b.away) return a.away < b.away;
    return a.line.distance != b.line.distance ? a.line.distance > b.line.distance : a.edge < b.edge;
  });
  return edges;
}

/// Whether all edges within the disc lie within a line, and none ends there without another one
/// that goes on: what the line cuts off is then no surface, however short the edge.
bool MeshClips::bounds_all(const Line& line, const std::vector<FlatEdge>& edges, double reach) {
  const double tolerance = 1e-3 * reach;
  return std::all_of(edges.begin(), edges.end(), [&](const FlatEdge& edge) {
    const auto [from, to] = part_within(edge.from, edge.to, reach);
    if (line.direction.dot(from) > line.distance + tolerance) return false;
    if (line.direction.dot(to) > line.distance + tolerance) return false;
    return (edge.from.norm() >= reach || neighbor(edge, false, edges, reach)) &&
           (edge.to.norm() >= reach || neighbor(edge, true, edges, reach));
  });
}

/// The edge that goes on where an edge ends or, not `forward`, begins. The edges of a face run
/// around it, so that one ends where the next begins.
const MeshClips::FlatEdge* MeshClips::neighbor(const FlatEdge& edge, bool forward,
                                               const std::vector<FlatEdge>& edges, double reach) {
  const Vec3d& corner = forward ? edge.to : edge.from;
  for (const FlatEdge& other : edges) {
    const Vec3d& end = forward ? other.from : other.to;
    if (&other != &edge && (end - corner).norm() <= 1e-6 * reach) return &other;
  }
  return nullptr;
}

/// The lines that leave what lies within all of them, and the edge of the first one.
MeshClips::Lines MeshClips::convex_lines(const Vec3d& normal, const std::vector<FlatEdge>& edges,
                                         double reach, const FlatEdge*& first) {
  Lines lines;
  first = nullptr;
  for (const FlatEdge& edge : edges) {
    if (lines.count == 2) break;
    if (edge.beyond || !(edge.line.distance < reach)) continue;
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
    const double half =
        std::sqrt(std::max(0.0, reach * reach - edge.line.distance * edge.line.distance));
    if (!follows(edge.line, {-half, half}, normal, edges, reach) &&
        !bounds_all(edge.line, edges, reach)) {
      continue;
    }
    if (!first) first = &edge;
    lines.line[static_cast<std::size_t>(lines.count++)] = edge.line;
  }
  return lines;
}

/// The line of an edge and the line that turns most from it among the edges that follow it, on one
/// side, around reflex corners within the disc.
/// \param lead_on  edges must follow both lines from where these meet to the disc's end.
MeshClips::Lines MeshClips::reflex_corner(const FlatEdge& edge, bool lead_on, const Vec3d& normal,
                                          const std::vector<FlatEdge>& edges, double reach) {
  constexpr double kMostTurn = -0.2;  // Cosine of 100 degrees.
  // A corner nearer to the disc's end than this is of no concern to the disc.
  constexpr double kLeastRay = 0.1;
  const FlatEdge* other = nullptr;
  double least_cosine = kSameLine;
  for (const bool forward : {false, true}) {
    const FlatEdge* last = &edge;
    while (true) {
      const Vec3d& corner = forward ? last->to : last->from;
      if (!(corner.norm() < (1 - kLeastRay) * reach)) break;
      const FlatEdge* next = neighbor(*last, forward, edges, reach);
      if (!next) break;
      const Vec3d& end = forward ? next->to : next->from;
      const double cosine = edge.line.direction.dot(next->line.direction);
      if (!(last->line.direction.dot(end - corner) > 0) || cosine < kMostTurn) break;
      // An edge that turns on and on comes to turn less again.
      if (last != &edge && cosine > edge.line.direction.dot(last->line.direction)) break;
      last = next;
      if (cosine < least_cosine) {
        least_cosine = cosine;
        other = last;
      }
    }
  }
  if (!other) return {};
  // Whether edges follow a line from a corner on to the disc's end.
  const auto leads_on = [&](const FlatEdge& from, const FlatEdge& partner) {
    const Vec3d along = normal.cross(from.line.direction);
    const double cosine = from.line.direction.dot(partner.line.direction);
    const double at =
        (partner.line.distance - cosine * from.line.distance) / along.dot(partner.line.direction);
    const double half =
        std::sqrt(std::max(0.0, reach * reach - from.line.distance * from.line.distance));
    const Chord chord =
        along.dot(from.from + from.to) / 2 > at ? Chord{at, half} : Chord{-half, at};
    return chord.to - chord.from > kLeastRay * reach &&
           follows(from.line, chord, normal, edges, reach);
  };
  if (lead_on && !(leads_on(edge, *other) && leads_on(*other, edge))) return {};
  const bool in_order = edge.edge < other->edge;
  return {{in_order ? edge.line : other->line, in_order ? other->line : edge.line}, 2, true};
}

MeshClips::Lines MeshClips::around(std::uint32_t face, const Vec3d& place, const Vec3d& normal,
                                   double reach) const {
  const std::vector<FlatEdge> edges = edges_around(face, place, normal, reach);
  const FlatEdge* first = nullptr;
  const Lines within = convex_lines(normal, edges, reach, first);
  if (within.count == 2) return within;
  const bool lead_on = first == nullptr;
  if (!first) {
    const auto own = [](const FlatEdge& edge) { return !edge.beyond; };
    const auto nearest = std::find_if(edges.begin(), edges.end(), own);
    if (nearest == edges.end()) return within;
    first = &*nearest;
  }
  const Lines either = reflex_corner(*first, lead_on, normal, edges, reach);
  return either.either ? either : within;
}

}  // namespace surfel
