#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/measure/upright_guess.h>

namespace surfel {
namespace {

using Point = SurfaceSample::Point;

/// Height, by the larger extent across, of what would rather lie.
constexpr double kSlender = 4;
/// Best score of support that is chance: the root of the product of the hull's share and the
/// surface's.
constexpr double kChanceSupport = 0.05;
/// Share of the surface in a base beyond which it counts no more.
constexpr double kBase = 0.03;
/// Most that an axis other than the file's loses against one: a plane must be clear to be followed.
constexpr double kTiltPenalty = 0.4;

/// z-component of (a - o) x (b - o).
double turn(const Vec2d& o, const Vec2d& a, const Vec2d& b) {
  return (a - o).x() * (b - o).y() - (a - o).y() * (b - o).x();
}

/// Corners of the convex hull, counter-clockwise (Andrew's monotone chain).
std::vector<Vec2d> convex_hull(std::vector<Vec2d> points) {
  std::sort(points.begin(), points.end(), [](const Vec2d& a, const Vec2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  std::vector<Vec2d> hull;
  const auto add = [&](const Vec2d& p, std::size_t least) {
    while (hull.size() >= least + 2 && turn(hull[hull.size() - 2], hull.back(), p) <= 0) {
      hull.pop_back();
    }
    hull.push_back(p);
  };
  for (const Vec2d& p : points) add(p, 0);
  const std::size_t lower = hull.empty() ? 0 : hull.size() - 1;
  for (auto p = points.rbegin(); p != points.rend(); ++p) add(*p, lower);
  if (!hull.empty()) hull.pop_back();
  return hull;
}

double polygon_area(const std::vector<Vec2d>& corners) {
  double twice = 0;
  for (std::size_t i = 2; i < corners.size(); ++i) {
    twice += turn(corners[0], corners[i - 1], corners[i]);
  }
  return twice / 2;
}

bool inside(const std::vector<Vec2d>& hull, const Vec2d& p) {
  if (hull.size() < 3) return false;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    if (turn(hull[i], hull[(i + 1) % hull.size()], p) < 0) return false;
  }
  return true;
}

/// A direction that may be up: an axis of a frame, and its sign.
struct Candidate {
  std::size_t axis;
  double sign;
};

struct Score {
  Vec3d up;
  double total = 0;
  const char* reason = "";
};

/// Why a direction may be up, and how much that weighs.
class Reasons {
 public:
  void add(double score, const char* words) {
    total_ += score;
    if (score <= largest_) return;
    largest_ = score;
    words_ = words;
  }
  double total() const { return total_; }
  const char* words() const { return words_; }

 private:
  double total_ = 0;
  /// What weighs less is noise, and explains nothing.
  double largest_ = 0.2;
  const char* words_ = "";
};

/// What speaks for a direction by convention alone. Files of meshes mostly have y up, maps and CAD
/// z, cameras -y.
double convention(std::size_t axis, double sign) {
  constexpr std::array<double, 3> kPlus{-0.6, 0, -0.1};
  constexpr std::array<double, 3> kMinus{-0.6, -0.45, -0.6};
  return (sign > 0 ? kPlus : kMinus)[axis];
}

/// What the lowest points tell of a scene that stands on them.
void add_support(const JudgedSurface& s, const ReferenceFrame& frame, const Candidate& c,
                 Reasons& reasons) {
  const Range& range = frame.range[c.axis];
  const std::size_t a = (c.axis + 1) % 3;
  const std::size_t b = (c.axis + 2) % 3;
  const double floor = c.sign > 0 ? range.min : -range.max;
  std::vector<Vec2d> lowest;
  std::vector<Vec2d> all;
  double lowest_weight = 0;
  for (const Point& p : s.points) {
    const Vec2d place(JudgedSurface::along(p, frame.axis[a]),
                      JudgedSurface::along(p, frame.axis[b]));
    const bool low =
        c.sign * JudgedSurface::along(p, frame.axis[c.axis]) - floor <= kSlab * range.size();
    if (low) lowest_weight += JudgedSurface::weight_of(p);
    if (!frame.range[a].holds(place.x()) || !frame.range[b].holds(place.y())) continue;
    all.push_back(place);
    if (low) lowest.push_back(place);
  }
  const double whole = polygon_area(convex_hull(all));
  if (!(whole > 0)) return;
  const std::vector<Vec2d> hull = convex_hull(lowest);
  // More surface than a base of some size has does not make it a better one: a roof is no base.
  const double contact = std::min(lowest_weight / s.weight, kBase);
  const double share = polygon_area(hull) / whole * contact;
  const Vec2d center(s.center.dot(frame.axis[a]), s.center.dot(frame.axis[b]));
  double score = std::max(0.0, 0.5 * portable::log(share / (kChanceSupport * kChanceSupport)));
  // Where a scan of one side ends, there is no support, though it may look so.
  if (s.normal.norm() > kOneSided) score *= 0.5;
  // What would topple stands on something else.
  if (!inside(hull, center)) score *= 0.3;
  reasons.add(score, "largest flat support");
}

/// Mean height, 0..1, of what is inside of the walls of a room; nullopt where there is no room.
std::optional<double> height_of_inner(const JudgedSurface& s, const ReferenceFrame& frame,
                                      const Candidate& c) {
  double inner = 0;
  double height = 0;
  double inward = 0;
  double outer = 0;
  for (const Point& p : s.points) {
    bool wall = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const Range& range = frame.range[k];
      const double at = (JudgedSurface::along(p, frame.axis[k]) - range.min) / range.size();
      if (at >= kSlab && at <= 1 - kSlab) continue;
      const double facing = p.normal.cast<double>().dot(frame.axis[k]) * (at < 0.5 ? 1 : -1);
      if (std::abs(facing) < 0.9) continue;
      wall = true;
      outer += JudgedSurface::weight_of(p);
      inward += facing > 0 ? JudgedSurface::weight_of(p) : 0;
      break;
    }
    if (wall) continue;
    const Range& range = frame.range[c.axis];
    const double at = (JudgedSurface::along(p, frame.axis[c.axis]) - range.min) / range.size();
    inner += JudgedSurface::weight_of(p);
    height += JudgedSurface::weight_of(p) * (c.sign > 0 ? at : 1 - at);
  }
  const bool room = outer > 0.4 * s.weight && inward > 0.8 * outer && inner > 0.02 * s.weight;
  if (!room) return std::nullopt;
  return height / inner;
}

Score judge(const JudgedSurface& s, const ReferenceFrame& frame, const Candidate& c,
            const std::array<double, 3>& symmetry) {
  const Vec3d up = c.sign * frame.axis[c.axis];
  const double thinness = frame.thinness(c.axis);
  const bool thin = thinness < kThin;
  const double facing = s.normal.dot(up);
  Reasons reasons;
  add_support(s, frame, c, reasons);
  if (thin && facing > -kOneSided) {
    const bool seen_from_above = facing > kOneSided;
    reasons.add(std::min(2.0, portable::log(kThin / std::max(thinness, 1e-3))) +
                    (seen_from_above ? 0.5 : 0),
                seen_from_above ? "ground seen from above" : "lies flat");
  } else if (!thin && std::abs(facing) > kOneSided) {
    // A scan of a side: who scanned it did not look from above or from below.
    reasons.add(-1.5, "");
  }
  // Few things stand on their narrow end.
  const double larger =
      std::max(frame.range[(c.axis + 1) % 3].size(), frame.range[(c.axis + 2) % 3].size());
  if (frame.range[c.axis].size() > kSlender * larger) reasons.add(-0.5, "");
  const std::optional<double> inner = height_of_inner(s, frame, c);
  if (inner) reasons.add(3 * (0.5 - *inner), "what stands on the floor of a room");
  const double least = *std::min_element(symmetry.begin(), symmetry.end());
  if (symmetry[c.axis] > kSymmetric && !thin && !inner) {
    reasons.add(-1.2 * std::clamp((symmetry[c.axis] - least) / 0.3, 0.0, 1.0), "");
  }
  return {up, reasons.total(), reasons.words()};
}

/// Axes along the largest plane of the scene, where that is under everything (or above) and is none
/// of the file's.
std::optional<ReferenceFrame> tilted_frame(const JudgedSurface& s) {
  constexpr std::size_t kTried = 256;  // Normals whose neighbourhoods are tried.
  const double near = portable::cos(radians(8));
  const std::size_t stride = std::max<std::size_t>(1, s.points.size() / kTried);
  const auto mean_about = [&](const Vec3d& direction, double& found) {
    Vec3d mean(0, 0, 0);
    found = 0;
    for (const Point& p : s.points) {
      const Vec3d n = p.normal.cast<double>();
      const double cosine = n.dot(direction);
      if (std::abs(cosine) < near) continue;
      mean += JudgedSurface::weight_of(p) * (cosine < 0 ? Vec3d(-n) : n);
      found += JudgedSurface::weight_of(p);
    }
    return Vec3d(mean.normalized());
  };
  // The strongest directions first; each takes the normals near it out of the list.
  std::vector<std::pair<double, Vec3d>> peaks;
  for (std::size_t i = 0; i < s.points.size(); i += stride) {
    const Vec3d n = s.points[i].normal.cast<double>();
    if (!(n.squaredNorm() > 0.5)) continue;
    double found = 0;
    mean_about(n, found);
    peaks.emplace_back(found, n);
  }
  std::sort(peaks.begin(), peaks.end(), [](const auto& a, const auto& b) {
    if (a.first != b.first) return a.first > b.first;
    return std::lexicographical_compare(a.second.begin(), a.second.end(), b.second.begin(),
                                        b.second.end());
  });
  std::vector<Vec3d> tried;
  for (const auto& [share, seed] : peaks) {
    constexpr double kLeastShare = 0.15;
    if (share < kLeastShare * s.weight || tried.size() == 4) break;
    const Vec3d& peak = seed;
    if (std::any_of(tried.begin(), tried.end(), [&](const Vec3d& other) {
          return std::abs(other.dot(peak)) > portable::cos(radians(16));
        })) {
      continue;
    }
    tried.push_back(peak);
    double found = 0;
    Vec3d normal = mean_about(peak, found);
    normal = mean_about(normal, found);
    if (normal.cwiseAbs().maxCoeff() > portable::cos(radians(1))) continue;
    // Nearly all points must be on one side of the plane, and many in it.
    std::vector<double> height;
    for (const Point& p : s.points) height.push_back(JudgedSurface::along(p, normal));
    const Range range = range_of(height, 0.01);
    for (const double sign : {1.0, -1.0}) {
      const double floor = sign > 0 ? range.min : -range.max;
      double in_plane = 0;
      for (const Point& p : s.points) {
        const bool low = sign * JudgedSurface::along(p, normal) - floor < 2 * kSlab * range.size();
        if (low && std::abs(p.normal.cast<double>().dot(normal)) > near) {
          in_plane += JudgedSurface::weight_of(p);
        }
      }
      if (in_plane < kLeastShare * s.weight) continue;
      // Walls across the plane give the other axes, where there are some.
      Vec3d side = normal.unitOrthogonal();
      for (const auto& [wall_share, wall] : peaks) {
        if (wall_share < 0.05 * s.weight) break;
        if (std::abs(wall.dot(normal)) > portable::sin(radians(8))) continue;
        side = (wall - wall.dot(normal) * normal).normalized();
        break;
      }
      return s.make_frame({normal, side, normal.cross(side)});
    }
  }
  return std::nullopt;
}

}  // namespace

UprightGuess guess_upright(const JudgedSurface& s, const std::array<double, 3>& symmetry) {
  std::vector<Score> scores;
  const bool map = s.of_map();
  const bool camera = s.of_camera();
  const bool faces_back = s.normal.z() < -kOneSided && s.frame.thinness(2) >= kThin;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      Score score = judge(s, s.frame, {axis, sign}, symmetry);
      score.total += convention(axis, sign);
      if (axis == 2 && sign > 0 && map) {
        score.total += 4;
        score.reason = "coordinates of a map";
      }
      if (axis == 1 && sign < 0 && (camera || faces_back)) {
        score.total += camera ? 3 : 1.2;
        score.reason = camera ? "what a camera in the origin sees" : "coordinates of a camera";
      }
      scores.push_back(score);
    }
  }
  if (const auto tilted = tilted_frame(s)) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (const double sign : {1.0, -1.0}) {
        Score score = judge(s, *tilted, {axis, sign}, {0, 0, 0});
        Eigen::Index nearest = 0;
        score.up.cwiseAbs().maxCoeff(&nearest);
        score.total +=
            convention(static_cast<std::size_t>(nearest), score.up[nearest]) - kTiltPenalty;
        scores.push_back(score);
      }
    }
  }
  std::stable_sort(scores.begin(), scores.end(),
                   [](const Score& a, const Score& b) { return a.total > b.total; });
  // What leans by less is taken for a scan that was not set quite upright, or a slope.
  constexpr double kLeaning = 8;
  const Score& best = scores[0];
  const char* unsaid = best.up == Vec3d::UnitY() ? "by convention" : "weak evidence";
  return {snapped(best.up, kLeaning), best.total - scores[1].total,
          *best.reason ? best.reason : unsaid};
}

}  // namespace surfel
