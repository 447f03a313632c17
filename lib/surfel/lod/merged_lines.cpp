#include <algorithm>
#include <cmath>
#include <vector>

#include <surfel/lod/merged_lines.h>
#include <surfel/scene/clips.h>

namespace surfel {
namespace {

/// Least cosine between the directions of lines of one edge, 10 degrees: as MeshClips takes the
/// edges of a polygon for a curve.
constexpr float kSameDirection = 0.985F;
/// How far lines of one edge are apart at most, by the root of a surfel's area.
constexpr float kApart = 0.2F;
/// How far within a line the centre of a surfel lies at least that the line does not touch, by the
/// root of its area.
constexpr float kClear = 0.5F;

/// The place on a surfel's line that is nearest to its centre.
Vec3f foot(const LinedSurfel& s, const CutLine& line) {
  return s.position + line.inside(s.position) * line.direction;
}

/// Lines of one edge.
struct Edge {
  CutLine first;
  Vec3f base;  ///< A place on the line that the others are counted from.
  Vec3d direction;
  Vec3d place;
  double weight = 0;
};

std::vector<Edge> find_edges(std::span<const LinedSurfel* const> members,
                             std::span<const LinedSurfel* const> beside) {
  std::vector<Edge> edges;
  const auto add = [&](const LinedSurfel& s) {
    for (const CutLine& line : s.lines) {
      if (!line.cuts()) continue;
      auto edge = std::find_if(edges.begin(), edges.end(),
                               [&](const Edge& e) { return is_on_line(s, line, e.first); });
      const Vec3f place = foot(s, line);
      if (edge == edges.end()) {
        edge = edges.insert(edge, {line, place, Vec3d::Zero(), Vec3d::Zero()});
      }
      // Areas of zero must not leave a line without a direction.
      const double weight = s.area > 0 ? s.area : 1e-30;
      edge->direction += weight * line.direction.cast<double>();
      edge->place += weight * (place - edge->base).cast<double>();
      edge->weight += weight;
    }
  };
  for (const LinedSurfel* s : members) add(*s);
  for (const LinedSurfel* s : beside) add(*s);
  return edges;
}

/// The mean line of an edge in the plane across a normal.
CutLine mean_line(const Edge& edge, const Vec3f& normal) {
  const Vec3d n = normal.cast<double>();
  const Vec3d across = edge.direction - n * n.dot(edge.direction);
  const double length = across.norm();
  if (!(length > 0)) return {{0, 0, 0}, 0};
  const Vec3d direction = across / length;
  const Vec3d place = edge.base.cast<double>() + edge.place / edge.weight;
  return {direction.cast<float>(), static_cast<float>(direction.dot(place))};
}

float deviation_along(const std::array<float, 6>& c, const Vec3f& d) {
  const float variance = d.x() * d.x() * c[0] + d.y() * d.y() * c[3] + d.z() * d.z() * c[5] +
                         2 * (d.x() * d.y() * c[1] + d.x() * d.z() * c[2] + d.y() * d.z() * c[4]);
  return std::sqrt(std::max(0.0F, variance));
}

}  // namespace

bool is_on_line(const LinedSurfel& surfel, const CutLine& own, const CutLine& line) {
  return own.cuts() && own.direction.dot(line.direction) > kSameDirection &&
         std::abs(line.inside(foot(surfel, own))) <= kApart * std::sqrt(surfel.area);
}

bool goes_on_beyond(const LinedSurfel& surfel, const CutLine& line) {
  return line.inside(surfel.position) < kClear * std::sqrt(surfel.area) &&
         !is_on_line(surfel, surfel.lines[0], line) && !is_on_line(surfel, surfel.lines[1], line);
}

std::array<CutLine, 2> merged_lines(const MergedPlace& merged,
                                    std::span<const LinedSurfel* const> members,
                                    std::span<const LinedSurfel* const> beside) {
  std::vector<CutLine> lines;
  for (const Edge& edge : find_edges(members, beside)) {
    const CutLine line = mean_line(edge, merged.normal);
    if (!line.cuts()) continue;
    const float reach =
        static_cast<float>(kClipReach) * deviation_along(merged.covariance, line.direction);
    if (line.inside(merged.position) > reach) continue;
    const bool cuts_off = std::any_of(members.begin(), members.end(), [&](const LinedSurfel* s) {
      return goes_on_beyond(*s, line);
    });
    if (!cuts_off) lines.push_back(line);
  }
  std::stable_sort(lines.begin(), lines.end(), [&](const CutLine& a, const CutLine& b) {
    return a.inside(merged.position) < b.inside(merged.position);
  });
  std::array<CutLine, 2> kept{CutLine{{0, 0, 0}, 0}, CutLine{{0, 0, 0}, 0}};
  std::size_t count = 0;
  for (const CutLine& line : lines) {
    if (count == kept.size()) break;
    if (count > 0 && line.direction.dot(kept[0].direction) > kSameDirection) continue;
    kept[count++] = line;
  }
  return kept;
}

}  // namespace surfel
