// Up by support, stability and symmetry: Fu, Cohen-Or, Dror, Sheffer, "Upright orientation of
// man-made objects", SIGGRAPH 2008, without its learning.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/measure/view_guess.h>

namespace surfel {
namespace {

using Point = SurfaceSample::Point;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Fewer points than these tell nothing.
constexpr std::size_t kLeastPoints = 8;
/// Part of the points at either end of an axis that may be strays.
constexpr double kStrays = 0.002;
/// Height of what counts as the lowest or outermost part, as a share of the scene's.
constexpr double kSlab = 0.03;
/// Mean normal of a surface of which one side is seen.
constexpr double kOneSided = 0.4;
/// Share of the surface that finds itself in the mirror where the scene is symmetric: others reach
/// half by chance.
constexpr double kSymmetric = 0.6;
/// Extent across, by the smaller one along, of what lies rather than stands.
constexpr double kThin = 0.4;
/// Height, by the larger extent across, of what would rather lie.
constexpr double kSlender = 4;
/// Best score of support that is chance: the root of the product of the hull's share and the
/// surface's.
constexpr double kChanceSupport = 0.05;
/// Share of the surface in a base beyond which it counts no more.
constexpr double kBase = 0.03;
/// Most that an axis other than the file's loses against one: a plane must be clear to be followed.
constexpr double kTiltPenalty = 0.4;

constexpr const char* kSensorReason = "as the sensor stood";

double radians(double degrees) { return degrees * std::numbers::pi / 180; }

/// The axis within so many degrees of a unit vector, or the vector itself.
Vec3d snapped(const Vec3d& direction, double degrees) {
  for (int k = 0; k < 3; ++k) {
    const double sign = direction[k] < 0 ? -1 : 1;
    if (std::abs(direction[k]) > std::cos(radians(degrees))) return sign * Vec3d::Unit(k);
  }
  return direction;
}

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

/// Range of values without strays.
struct Range {
  double min = 0;
  double max = 0;
  double size() const { return max - min; }
  bool holds(double v) const { return v >= min && v <= max; }
};

Range range_of(std::vector<double> values, double strays = kStrays) {
  const auto skip = static_cast<std::ptrdiff_t>(strays * static_cast<double>(values.size()));
  std::nth_element(values.begin(), values.begin() + skip, values.end());
  const double min = values[static_cast<std::size_t>(skip)];
  std::nth_element(values.begin(), values.end() - 1 - skip, values.end());
  return {min, *(values.end() - 1 - skip)};
}

/// Axes of coordinates in which the scene is judged, and its ranges along them.
struct Frame {
  std::array<Vec3d, 3> axis;
  std::array<Range, 3> range;
  double thinness(std::size_t k) const {
    const double other = std::min(range[(k + 1) % 3].size(), range[(k + 2) % 3].size());
    return other > 0 ? range[k].size() / other : kInfinity;
  }
};

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

/// Horizontal direction from which a scene is looked at by convention: +z where y is up, -y where z
/// is, and what the least turn between them makes of these elsewhere.
Vec3d conventional_front(const Vec3d& up) {
  Vec3d front(0, 0, 1);
  if (std::abs(up.z()) > 0.7) front = Vec3d(0, up.z() > 0 ? -1 : 1, 0);
  if (up.y() < -0.7) front = Vec3d(0, 0, -1);
  return (front - front.dot(up) * up).normalized();
}

class ViewJudge {
 public:
  explicit ViewJudge(const SurfaceSample& sample) : points_(sample.points), origin_(sample.origin) {
    Vec3d sum(0, 0, 0);
    for (const Point& p : points_) {
      weight_ += weight(p);
      sum += weight(p) * p.position.cast<double>();
      normal_ += weight(p) * p.normal.cast<double>();
    }
    if (!(weight_ > 0)) return;
    center_ = sum / weight_;
    normal_ /= weight_;
    frame_ = make_frame({Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()});
  }

  /// False where there is too little to judge.
  bool usable() const { return points_.size() >= kLeastPoints && weight_ > 0 && size(frame_) > 0; }

  ViewGuess guess(const ViewHints& hints) const;

 private:
  static double weight(const Point& p) { return static_cast<double>(p.area); }
  static double along(const Point& p, const Vec3d& axis) {
    return p.position.cast<double>().dot(axis);
  }
  static double size(const Frame& frame) {
    return std::max({frame.range[0].size(), frame.range[1].size(), frame.range[2].size()});
  }

  Frame make_frame(const std::array<Vec3d, 3>& axes) const;
  std::optional<Frame> tilted_frame() const;
  double mirrored(std::size_t axis) const;
  bool of_map() const;
  bool of_camera() const;
  void add_support(const Frame& frame, const Candidate& c, Reasons& reasons) const;
  std::optional<double> height_of_inner(const Frame& frame, const Candidate& c) const;
  Score judge(const Frame& frame, const Candidate& c, const std::array<double, 3>& symmetry) const;
  void guess_up(ViewGuess& guess, const std::array<double, 3>& symmetry) const;
  void guess_front(ViewGuess& guess, const std::array<double, 3>& symmetry) const;
  double detail(const Vec3d& front, const Vec3d& up) const;
  double head(const Vec3d& front, const Vec3d& up) const;
  double silhouette(const Vec3d& front, const Vec3d& up) const;
  std::optional<SensorView> sensor_view(const Viewpoint& viewpoint, Vec3d& up) const;

  const std::vector<Point>& points_;
  Vec3d origin_;
  double weight_ = 0;
  Vec3d center_{0, 0, 0};  ///< Centre of mass, relative to the origin.
  Vec3d normal_{0, 0, 0};  ///< Mean normal: about zero for closed surfaces.
  Frame frame_;            ///< The file's axes.
};

Frame ViewJudge::make_frame(const std::array<Vec3d, 3>& axes) const {
  Frame frame{axes, {}};
  std::vector<double> values(points_.size());
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < points_.size(); ++i) values[i] = along(points_[i], axes[k]);
    frame.range[k] = range_of(values);
  }
  return frame;
}

/// Share of the surface that lies on the surface again, to a cell, when mirrored in the middle of
/// its range.
double ViewJudge::mirrored(std::size_t axis) const {
  // Cells lie symmetrically, so that a mirrored point falls into the mirrored cell.
  constexpr int kCells = 24;
  constexpr int kSide = kCells + 4;  // Two cells around for strays.
  std::vector<char> taken(std::size_t{kSide} * kSide * kSide, 0);
  const double cell = size(frame_) / kCells;
  const auto place = [&](const Vec3d& p, std::array<int, 3>& index) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Range& range = frame_.range[k];
      const double middle = (range.min + range.max) / 2;
      const double at = std::floor((p[static_cast<int>(k)] - middle) / cell + kSide / 2.0);
      if (!(at >= 1 && at < kSide - 1)) return false;
      index[k] = static_cast<int>(at);
    }
    return true;
  };
  const auto cell_of = [&](const std::array<int, 3>& i) {
    return (static_cast<std::size_t>(i[0]) * kSide + static_cast<std::size_t>(i[1])) * kSide +
           static_cast<std::size_t>(i[2]);
  };
  std::array<int, 3> index{};
  for (const Point& p : points_) {
    if (place(p.position.cast<double>(), index)) taken[cell_of(index)] = 1;
  }
  const double twice_middle = frame_.range[axis].min + frame_.range[axis].max;
  double found = 0;
  for (const Point& p : points_) {
    Vec3d image = p.position.cast<double>();
    image[static_cast<int>(axis)] = twice_middle - image[static_cast<int>(axis)];
    if (!place(image, index)) continue;
    if (taken[cell_of(index)] != 0) found += weight(p);
  }
  return found / weight_;
}

/// Are these coordinates of a map: far from the origin, a surface seen from one side, which is
/// lower than it is wide? Then z is the height.
bool ViewJudge::of_map() const {
  const Vec3d center = origin_ + center_;
  const double extent = size(frame_);
  const bool far = std::abs(center.x()) > 20 * extent && std::abs(center.y()) > 20 * extent;
  const double height = frame_.range[2].size();
  return far && height <= frame_.range[0].size() && height <= frame_.range[1].size() &&
         (normal_.isZero(0) || std::abs(normal_.z()) > kOneSided);
}

/// Are these points what a camera in the origin sees, which looks along z: all in front of it, and
/// none behind another?
bool ViewJudge::of_camera() const {
  // Some points in a cell, so that those behind others are found.
  const int cells_a_side =
      std::clamp(static_cast<int>(std::sqrt(static_cast<double>(points_.size()) / 4)), 8, 48);
  constexpr double kWidest = 0.9;  // Tangent of half the field of view of wide depth cameras.
  constexpr double kNear = 0.5;    // The surface does not reach up to the camera.
  std::vector<double> depth;
  std::vector<double> x;
  std::vector<double> y;
  for (const Point& p : points_) {
    const Vec3d q = origin_ + p.position.cast<double>();
    if (!(q.z() > 0)) return false;
    depth.push_back(q.z());
    x.push_back(q.x() / q.z());
    y.push_back(q.y() / q.z());
  }
  const Range z = range_of(depth);
  const Range u = range_of(x);
  const Range v = range_of(y);
  const auto within = [&](const Range& r) { return r.min > -kWidest && r.max < kWidest; };
  // A camera that sees a thing has it near the middle of its picture.
  const auto middle = [&](const Range& r) { return std::abs(r.min + r.max) / 2 < kWidest / 2; };
  if (z.min < kNear * z.size() || !within(u) || !within(v) || !middle(u) || !middle(v))
    return false;
  if (!(u.size() > 0) || !(v.size() > 0)) return false;
  std::vector<Range> cells(static_cast<std::size_t>(cells_a_side * cells_a_side),
                           Range{kInfinity, -kInfinity});
  std::vector<int> count(cells.size());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!u.holds(x[i]) || !v.holds(y[i]) || !z.holds(depth[i])) continue;
    const auto index = [&](double value, const Range& range) {
      const double at = (value - range.min) / range.size() * cells_a_side;
      return std::min(cells_a_side - 1, static_cast<int>(at));
    };
    const auto at = static_cast<std::size_t>(index(y[i], v) * cells_a_side + index(x[i], u));
    cells[at].min = std::min(cells[at].min, depth[i]);
    cells[at].max = std::max(cells[at].max, depth[i]);
    ++count[at];
  }
  int single = 0;
  int several = 0;
  const double step = 0.15 * std::max(z.size(), u.size() * z.min);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (count[i] < 2) continue;
    ++several;
    if (cells[i].size() < step) ++single;
  }
  return several > 10 && single > 0.9 * several;
}

/// What the lowest points tell of a scene that stands on them.
void ViewJudge::add_support(const Frame& frame, const Candidate& c, Reasons& reasons) const {
  const Range& range = frame.range[c.axis];
  const std::size_t a = (c.axis + 1) % 3;
  const std::size_t b = (c.axis + 2) % 3;
  const double floor = c.sign > 0 ? range.min : -range.max;
  std::vector<Vec2d> lowest;
  std::vector<Vec2d> all;
  double lowest_weight = 0;
  for (const Point& p : points_) {
    const Vec2d place(along(p, frame.axis[a]), along(p, frame.axis[b]));
    const bool low = c.sign * along(p, frame.axis[c.axis]) - floor <= kSlab * range.size();
    if (low) lowest_weight += weight(p);
    if (!frame.range[a].holds(place.x()) || !frame.range[b].holds(place.y())) continue;
    all.push_back(place);
    if (low) lowest.push_back(place);
  }
  const double whole = polygon_area(convex_hull(all));
  if (!(whole > 0)) return;
  const std::vector<Vec2d> hull = convex_hull(lowest);
  // More surface than a base of some size has does not make it a better one: a roof is no base.
  const double contact = std::min(lowest_weight / weight_, kBase);
  const double share = polygon_area(hull) / whole * contact;
  const Vec2d center(center_.dot(frame.axis[a]), center_.dot(frame.axis[b]));
  double score = std::max(0.0, 0.5 * std::log(share / (kChanceSupport * kChanceSupport)));
  // Where a scan of one side ends, there is no support, though it may look so.
  if (normal_.norm() > kOneSided) score *= 0.5;
  // What would topple stands on something else.
  if (!inside(hull, center)) score *= 0.3;
  reasons.add(score, "largest flat support");
}

/// Mean height, 0..1, of what is inside of the walls of a room; nullopt where there is no room.
std::optional<double> ViewJudge::height_of_inner(const Frame& frame, const Candidate& c) const {
  double inner = 0;
  double height = 0;
  double inward = 0;
  double outer = 0;
  for (const Point& p : points_) {
    bool wall = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const Range& range = frame.range[k];
      const double at = (along(p, frame.axis[k]) - range.min) / range.size();
      if (at >= kSlab && at <= 1 - kSlab) continue;
      const double facing = p.normal.cast<double>().dot(frame.axis[k]) * (at < 0.5 ? 1 : -1);
      if (std::abs(facing) < 0.9) continue;
      wall = true;
      outer += weight(p);
      inward += facing > 0 ? weight(p) : 0;
      break;
    }
    if (wall) continue;
    const Range& range = frame.range[c.axis];
    const double at = (along(p, frame.axis[c.axis]) - range.min) / range.size();
    inner += weight(p);
    height += weight(p) * (c.sign > 0 ? at : 1 - at);
  }
  const bool room = outer > 0.4 * weight_ && inward > 0.8 * outer && inner > 0.02 * weight_;
  if (!room) return std::nullopt;
  return height / inner;
}

Score ViewJudge::judge(const Frame& frame, const Candidate& c,
                       const std::array<double, 3>& symmetry) const {
  const Vec3d up = c.sign * frame.axis[c.axis];
  const double thinness = frame.thinness(c.axis);
  const bool thin = thinness < kThin;
  const double facing = normal_.dot(up);
  Reasons reasons;
  add_support(frame, c, reasons);
  if (thin && facing > -kOneSided) {
    const bool seen_from_above = facing > kOneSided;
    reasons.add(
        std::min(2.0, std::log(kThin / std::max(thinness, 1e-3))) + (seen_from_above ? 0.5 : 0),
        seen_from_above ? "ground seen from above" : "lies flat");
  } else if (!thin && std::abs(facing) > kOneSided) {
    // A scan of a side: who scanned it did not look from above or from below.
    reasons.add(-1.5, "");
  }
  // Few things stand on their narrow end.
  const double larger =
      std::max(frame.range[(c.axis + 1) % 3].size(), frame.range[(c.axis + 2) % 3].size());
  if (frame.range[c.axis].size() > kSlender * larger) reasons.add(-0.5, "");
  const std::optional<double> inner = height_of_inner(frame, c);
  if (inner) reasons.add(3 * (0.5 - *inner), "what stands on the floor of a room");
  const double least = *std::min_element(symmetry.begin(), symmetry.end());
  if (symmetry[c.axis] > kSymmetric && !thin && !inner) {
    reasons.add(-1.2 * std::clamp((symmetry[c.axis] - least) / 0.3, 0.0, 1.0), "");
  }
  return {up, reasons.total(), reasons.words()};
}

/// Axes along the largest plane of the scene, where that is under everything (or above) and is none
/// of the file's.
std::optional<Frame> ViewJudge::tilted_frame() const {
  constexpr std::size_t kTried = 256;  // Normals whose neighbourhoods are tried.
  const double near = std::cos(radians(8));
  const std::size_t stride = std::max<std::size_t>(1, points_.size() / kTried);
  const auto mean_about = [&](const Vec3d& direction, double& found) {
    Vec3d mean(0, 0, 0);
    found = 0;
    for (const Point& p : points_) {
      const Vec3d n = p.normal.cast<double>();
      const double cosine = n.dot(direction);
      if (std::abs(cosine) < near) continue;
      mean += weight(p) * (cosine < 0 ? Vec3d(-n) : n);
      found += weight(p);
    }
    return Vec3d(mean.normalized());
  };
  // The strongest directions first; each takes the normals near it out of the list.
  std::vector<std::pair<double, Vec3d>> peaks;
  for (std::size_t i = 0; i < points_.size(); i += stride) {
    const Vec3d n = points_[i].normal.cast<double>();
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
    if (share < kLeastShare * weight_ || tried.size() == 4) break;
    const Vec3d& peak = seed;
    if (std::any_of(tried.begin(), tried.end(), [&](const Vec3d& other) {
          return std::abs(other.dot(peak)) > std::cos(radians(16));
        })) {
      continue;
    }
    tried.push_back(peak);
    double found = 0;
    Vec3d normal = mean_about(peak, found);
    normal = mean_about(normal, found);
    if (normal.cwiseAbs().maxCoeff() > std::cos(radians(1))) continue;
    // Nearly all points must be on one side of the plane, and many in it.
    std::vector<double> height;
    for (const Point& p : points_) height.push_back(along(p, normal));
    const Range range = range_of(height, 0.01);
    for (const double sign : {1.0, -1.0}) {
      const double floor = sign > 0 ? range.min : -range.max;
      double in_plane = 0;
      for (const Point& p : points_) {
        const bool low = sign * along(p, normal) - floor < 2 * kSlab * range.size();
        if (low && std::abs(p.normal.cast<double>().dot(normal)) > near) in_plane += weight(p);
      }
      if (in_plane < kLeastShare * weight_) continue;
      // Walls across the plane give the other axes, where there are some.
      Vec3d side = normal.unitOrthogonal();
      for (const auto& [wall_share, wall] : peaks) {
        if (wall_share < 0.05 * weight_) break;
        if (std::abs(wall.dot(normal)) > std::sin(radians(8))) continue;
        side = (wall - wall.dot(normal) * normal).normalized();
        break;
      }
      return make_frame({normal, side, normal.cross(side)});
    }
  }
  return std::nullopt;
}

void ViewJudge::guess_up(ViewGuess& guess, const std::array<double, 3>& symmetry) const {
  std::vector<Score> scores;
  const bool map = of_map();
  const bool camera = of_camera();
  const bool faces_back = normal_.z() < -kOneSided && frame_.thinness(2) >= kThin;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      Score score = judge(frame_, {axis, sign}, symmetry);
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
  if (const auto tilted = tilted_frame()) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (const double sign : {1.0, -1.0}) {
        Score score = judge(*tilted, {axis, sign}, {0, 0, 0});
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
  guess.up = scores[0].up;
  // What leans by less is taken for a scan that was not set quite upright, or a slope.
  guess.up = snapped(guess.up, 8);
  guess.margin = scores[0].total - scores[1].total;
  guess.reason = *scores[0].reason ? scores[0].reason : "no evidence";
}

/// Places in a picture of the scene, and the points seen there.
class Silhouette {
 public:
  Silhouette(const std::vector<Point>& points, const Frame& frame, const Vec3d& front,
             const Vec3d& up)
      : side_(std::clamp(static_cast<int>(std::sqrt(kPerCell * static_cast<double>(points.size()))),
                         8, 64)),
        cells_(static_cast<std::size_t>(side_ * side_)) {
    const Vec3d right = up.cross(front);
    double size = 0;
    for (const Range& r : frame.range) size = std::max(size, r.size());
    Vec3d middle(0, 0, 0);
    for (std::size_t k = 0; k < 3; ++k) {
      middle += frame.axis[k] * ((frame.range[k].min + frame.range[k].max) / 2);
    }
    const double cell = 1.5 * size / side_;  // The diagonal of a picture fits.
    const auto place = [&](const Point& p) {
      const Vec3d at = p.position.cast<double>() - middle;
      const double column = std::floor(at.dot(right) / cell + side_ / 2.0);
      const double row = std::floor(at.dot(up) / cell + side_ / 2.0);
      const bool in = column >= 0 && column < side_ && row >= 0 && row < side_;
      return in ? static_cast<int>(row) * side_ + static_cast<int>(column) : -1;
    };
    for (const Point& p : points) {
      const int at = place(p);
      if (at < 0) continue;
      Cell& c = cells_[static_cast<std::size_t>(at)];
      c.nearest = std::max(c.nearest, p.position.cast<double>().dot(front));
    }
    for (const Point& p : points) {
      const int at = place(p);
      if (at < 0) continue;
      Cell& c = cells_[static_cast<std::size_t>(at)];
      if (p.position.cast<double>().dot(front) < c.nearest - 1.5 * cell) continue;
      if (p.normal.cast<double>().dot(front) < 0) continue;
      c.normal += p.normal.cast<double>() * static_cast<double>(p.area);
    }
  }

  int covered() const {
    return static_cast<int>(std::count_if(cells_.begin(), cells_.end(), &Silhouette::seen));
  }

  /// Sum of the changes of normals from cell to cell.
  double detail() const {
    double sum = 0;
    for (int row = 0; row + 1 < side_; ++row) {
      for (int column = 0; column + 1 < side_; ++column) {
        const Cell& here = cell(row, column);
        sum += change(here, cell(row, column + 1)) + change(here, cell(row + 1, column));
      }
    }
    return sum;
  }

 private:
  struct Cell {
    double nearest = -kInfinity;
    Vec3d normal{0, 0, 0};
  };
  static bool seen(const Cell& c) { return c.nearest > -kInfinity; }
  const Cell& cell(int row, int column) const {
    return cells_[static_cast<std::size_t>(row * side_ + column)];
  }
  static double change(const Cell& a, const Cell& b) {
    if (!(a.normal.squaredNorm() > 0) || !(b.normal.squaredNorm() > 0)) return 0;
    return (a.normal.normalized() - b.normal.normalized()).norm();
  }

  /// Cells for each point, so few that most cells of the scene hold some points.
  static constexpr double kPerCell = 0.3;

  int side_;
  std::vector<Cell> cells_;
};

double ViewJudge::detail(const Vec3d& front, const Vec3d& up) const {
  return Silhouette(points_, frame_, front, up).detail();
}

/// 1 or -1 where the upper part of the scene leans towards the front or back and hangs over what
/// the scene stands on there, as heads do; else 0.
double ViewJudge::head(const Vec3d& front, const Vec3d& up) const {
  std::vector<double> heights;
  std::vector<double> depths;
  for (const Point& p : points_) {
    heights.push_back(along(p, up));
    depths.push_back(along(p, front));
  }
  const Range height = range_of(heights);
  const Range depth = range_of(depths);
  Range feet{kInfinity, -kInfinity};
  double top = 0;
  double lean = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const double at = (heights[i] - height.min) / height.size();
    if (at < kSlab) feet = {std::min(feet.min, depths[i]), std::max(feet.max, depths[i])};
    if (at < 0.7) continue;
    top += weight(points_[i]);
    lean += weight(points_[i]) * (depths[i] - (depth.min + depth.max) / 2);
  }
  constexpr double kClear = 0.1;  // Of the depth.
  lean /= top * depth.size();
  const double over = (depth.max - feet.max) / depth.size();
  const double behind = (feet.min - depth.min) / depth.size();
  if (lean > kClear && over > behind) return 1;
  return lean < -kClear && behind > over ? -1 : 0;
}

double ViewJudge::silhouette(const Vec3d& front, const Vec3d& up) const {
  return Silhouette(points_, frame_, front, up).covered();
}

void ViewJudge::guess_front(ViewGuess& guess, const std::array<double, 3>& symmetry) const {
  const Vec3d& up = guess.up;
  const Vec3d usual = conventional_front(up);
  const Vec3d facing = normal_ - normal_.dot(up) * up;
  const double thinness = [&] {
    Eigen::Index k = 0;
    up.cwiseAbs().maxCoeff(&k);
    return frame_.thinness(static_cast<std::size_t>(k));
  }();
  guess.front = usual;
  guess.azimuth = radians(30);
  guess.elevation = radians(thinness < kThin ? 50 : 20);
  if (facing.norm() > kOneSided) {
    // The side that was scanned, along an axis where that is nearly so.
    guess.front = facing.normalized();
    for (const Vec3d& axis :
         {usual, Vec3d(-usual), Vec3d(up.cross(usual)), Vec3d(usual.cross(up))}) {
      if (axis.dot(guess.front) > std::cos(radians(30))) guess.front = axis;
    }
    guess.azimuth = 0;
    guess.elevation = radians(10);
    return;
  }
  if (std::abs(normal_.dot(up)) > kOneSided) return;  // Ground: no side is the front.
  // The plane of symmetry holds the front; else the wider silhouette is looked at.
  const Vec3d side = up.cross(usual);
  const auto mirrored_across = [&](const Vec3d& axis) {
    Eigen::Index k = 0;
    return axis.cwiseAbs().maxCoeff(&k) > 0.99 ? symmetry[static_cast<std::size_t>(k)] : 0;
  };
  const double across_side = mirrored_across(side);
  const double across_usual = mirrored_across(usual);
  const bool symmetric = std::max(across_side, across_usual) > kSymmetric &&
                         std::abs(across_side - across_usual) > 0.05;
  const bool from_side =
      symmetric ? across_usual > across_side : silhouette(side, up) > 1.1 * silhouette(usual, up);
  guess.front = from_side ? side : usual;
  // Chance makes one side of a rounded body a little more detailed than the other.
  constexpr double kClear = 1.1;
  const double here = detail(guess.front, up);
  const double there = detail(-guess.front, up);
  const bool alike = std::max(here, there) < kClear * std::min(here, there);
  if (alike ? head(guess.front, up) < 0 : there > here) guess.front = -guess.front;
}

/// \param up  becomes what the sensor's axes say is up.
std::optional<SensorView> ViewJudge::sensor_view(const Viewpoint& viewpoint, Vec3d& up) const {
  const Vec3d eye = viewpoint.position - origin_;
  const Vec3d to_center = (center_ - eye).normalized();
  if (!to_center.allFinite()) return std::nullopt;
  const Vec4d& q = viewpoint.orientation;
  const Eigen::Matrix3d turned =
      Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  // Sensors look along z with y down (cameras), along -z with y up (graphics), or along x with z up
  // (robots); files do not say which of them is meant, the points do.
  struct Axes {
    Vec3d forward;
    Vec3d up;
  };
  const std::array<Axes, 3> known{Axes{turned.col(2), -turned.col(1)},
                                  Axes{-turned.col(2), turned.col(1)},
                                  Axes{turned.col(0), turned.col(2)}};
  const Axes* axes = &known[0];
  for (const Axes& other : known) {
    if (other.forward.dot(to_center) > axes->forward.dot(to_center) + 1e-9) axes = &other;
  }
  if (!(axes->forward.dot(to_center) > 0.5)) return std::nullopt;
  // The middle of what it saw, and its extent, in the picture across the direction of the centre.
  up = axes->up;
  SensorView view{viewpoint.position, to_center, up, 0, 0};
  for (int pass = 0; pass < 2; ++pass) {
    const Vec3d right = view.forward.cross(view.up).normalized();
    view.up = right.cross(view.forward);
    std::vector<double> x;
    std::vector<double> y;
    for (const Point& p : points_) {
      const Vec3d ray = p.position.cast<double>() - eye;
      const double z = ray.dot(view.forward);
      if (!(z > 0)) continue;
      x.push_back(ray.dot(right) / z);
      y.push_back(ray.dot(view.up) / z);
    }
    // Too many behind it: it looked around, and has no picture of its own.
    if (static_cast<double>(x.size()) < 0.95 * static_cast<double>(points_.size())) {
      return std::nullopt;
    }
    const Range u = range_of(x);
    const Range v = range_of(y);
    view.tan_x = u.size() / 2;
    view.tan_y = v.size() / 2;
    if (pass == 0) {
      view.forward =
          (view.forward + (u.min + u.max) / 2 * right + (v.min + v.max) / 2 * view.up).normalized();
    }
  }
  constexpr double kWidest = 1.75;  // 120 degrees.
  if (!(view.tan_x > 0 && view.tan_y > 0 && std::max(view.tan_x, view.tan_y) < kWidest)) {
    return std::nullopt;
  }
  return view;
}

ViewGuess ViewJudge::guess(const ViewHints& hints) const {
  ViewGuess guess;
  Vec3d sensor_up(0, 1, 0);
  if (hints.viewpoint) guess.sensor = sensor_view(*hints.viewpoint, sensor_up);
  std::array<double, 3> symmetry{};
  for (std::size_t k = 0; k < 3; ++k) symmetry[k] = mirrored(k);
  if (hints.up) {
    guess.up = hints.up->normalized();
    guess.reason = hints.up_reason;
    guess.margin = kInfinity;
  } else if (guess.sensor) {
    guess.up = snapped(sensor_up, 2);
    guess.reason = kSensorReason;
    guess.margin = kInfinity;
  } else {
    guess_up(guess, symmetry);
  }
  std::optional<SensorView> seen_by = guess.sensor;
  if (!seen_by && of_camera()) seen_by = sensor_view(Viewpoint{}, sensor_up);
  if (seen_by) {
    const Vec3d back = -seen_by->forward;
    const Vec3d level = back - back.dot(guess.up) * guess.up;
    guess.front = level.norm() > 1e-3 ? Vec3d(level.normalized()) : conventional_front(guess.up);
    guess.elevation = std::atan2(back.dot(guess.up), level.norm());
  } else {
    guess_front(guess, symmetry);
  }
  // Zeros without a sign, as people write them.
  guess.up += Vec3d::Zero();
  guess.front += Vec3d::Zero();
  return guess;
}

/// "z", "-y", or the numbers of a direction that is no axis.
std::string direction_name(const Vec3d& d) {
  constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    if (std::abs(d[k]) > 1 - 1e-9) {
      return fmt::format("{}{}", d[k] < 0 ? "-" : "", kNames[static_cast<std::size_t>(k)]);
    }
  }
  return fmt::format("{:.3g},{:.3g},{:.3g}", d.x(), d.y(), d.z());
}

struct ViewDirection {
  Vec3d from;
  Vec3d up;
};

/// Direction from the scene's middle to the eye, and the picture's up.
ViewDirection named_direction(const ViewGuess& guess, NamedView view) {
  switch (view) {
    case NamedView::kBack:
      return {-guess.front, guess.up};
    case NamedView::kLeft:
      return {-guess.right(), guess.up};
    case NamedView::kRight:
      return {guess.right(), guess.up};
    case NamedView::kTop:
      return {guess.up, -guess.front};
    case NamedView::kBottom:
      return {-guess.up, guess.front};
    case NamedView::kIso:
      return {guess.front + guess.right() + guess.up, guess.up};
    case NamedView::kFront:
    case NamedView::kSensor:
      break;
  }
  return {guess.front, guess.up};
}

}  // namespace

Vec3d ViewGuess::from() const {
  return std::cos(elevation) * (std::cos(azimuth) * front + std::sin(azimuth) * right()) +
         std::sin(elevation) * up;
}

std::string ViewGuess::sentence(std::optional<NamedView> view) const {
  if (view) {
    constexpr std::array<const char*, 8> kFrom{"the front",
                                               "the back",
                                               "the left",
                                               "the right",
                                               "above",
                                               "below",
                                               "the front, right and above",
                                               "where the sensor stood"};
    return fmt::format("up {} ({}), seen from {}", direction_name(up), reason,
                       kFrom[static_cast<std::size_t>(*view)]);
  }
  const char* side = azimuth > 0 ? "the front right" : "the front";
  const char* height = elevation > radians(45) ? " and high above" : "";
  const std::string from = sensor ? "where the sensor stood" : std::string(side).append(height);
  // Where the sensor stood it is the reason, too.
  const std::string why = sensor && reason == kSensorReason ? "" : fmt::format(" ({})", reason);
  return fmt::format("up {}, seen from {}{}", direction_name(up), from, why);
}

ViewGuess guess_view(const SurfaceSample& sample, const ViewHints& hints) {
  const ViewJudge judge(sample);
  if (judge.usable()) return judge.guess(hints);
  ViewGuess guess;
  guess.up = hints.up ? hints.up->normalized() : Vec3d(0, 1, 0);
  guess.reason = hints.up ? hints.up_reason : "no evidence";
  guess.front = conventional_front(guess.up);
  guess.elevation = radians(20);
  return guess;
}

std::string aim_camera(CameraOptions& camera, const ViewChoice& choice, const ViewGuess& guess) {
  const std::optional<NamedView>& view = choice.view;
  if (view && (camera.eye || camera.from)) {
    throw_usage("`view` and a direction of the camera exclude each other; leave out one");
  }
  if (view == NamedView::kSensor && !guess.sensor) {
    throw_usage(
        "`view` is sensor, and the file does not say where a sensor stood that looks at the "
        "points; give `eye` and `target`");
  }
  const bool placed = camera.eye || camera.from;
  const std::string sentence =
      placed ? fmt::format("up {} ({})", direction_name(guess.up), guess.reason)
             : guess.sentence(view);
  if (!camera.up) camera.up = guess.up;
  if (placed) return sentence;
  const bool from_sensor = view ? view == NamedView::kSensor : guess.sensor.has_value();
  if (!from_sensor) {
    const ViewDirection direction =
        view ? named_direction(guess, *view) : ViewDirection{guess.from(), *camera.up};
    camera.from = direction.from;
    camera.up = direction.up;
    return sentence;
  }
  const SensorView& sensor = *guess.sensor;
  if (camera.target || camera.ortho) {
    camera.from = -sensor.forward;
    return sentence;
  }
  camera.eye = sensor.eye;
  camera.target = sensor.eye + sensor.forward;
  if (camera.fov == CameraOptions{}.fov) {
    constexpr double kMargin = 1.05;
    const double wanted =
        std::max(sensor.tan_y, sensor.tan_x * camera.height / std::max(1, camera.width));
    camera.fov = 2 * std::atan(kMargin * wanted) * 180 / std::numbers::pi;
  }
  return sentence;
}

}  // namespace surfel
