#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <surfel/align/align_scans.h>
#include <surfel/align/pairwise_icp.h>
#include <surfel/align/scan.h>
#include <surfel/align/scan_matches.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/rotation.h>
#include <surfel/base/stage_timer.h>
#include <surfel/solve/ceres_solver.h>

namespace surfel {
namespace {

/// Points of a scan that look for the scans beside it at the start, and that PCL moves.
constexpr std::size_t kStartPoints = 5000;
/// Points of a placed scan that others are moved onto.
constexpr std::size_t kTargetPoints = 50000;
/// Matches of a bundle, some 300 bytes each in Ceres.
constexpr std::size_t kMostMatches = 200000;
/// Matches in the end, in spacings of the scan that is looked at: a neighbour is there within one.
constexpr double kLastReach = 2.5;
/// A scan with fewer matches, or a smaller share of its points, does not overlap another.
constexpr std::size_t kLeastMatches = 50;
constexpr double kLeastShare = 0.02;

/// Scans and where they are: poses lead from each scan's centre to a frame about the first's.
struct Placement {
  std::vector<Scan> scans;
  std::vector<RigidPose> poses;
  std::span<const std::string> names;

  RigidPose relative(std::size_t from, std::size_t to) const {
    return poses[to].inverse() * poses[from];
  }
};

/// The matches of one scan with another.
struct PairMatches {
  std::size_t from;
  std::size_t to;
  std::vector<ScanMatch> matches;
};

bool enough(std::size_t matches, std::size_t looked) {
  return matches >= kLeastMatches &&
         static_cast<double>(matches) >= kLeastShare * static_cast<double>(looked);
}

Placement make_placement(std::span<const SurfelCloud> clouds, std::span<const std::string> names) {
  Placement p{{}, {}, names};
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    p.scans.push_back(make_scan(clouds[k], names[k]));
    p.poses.push_back({.translation = p.scans[k].center - p.scans[0].center});
  }
  return p;
}

[[noreturn]] void throw_apart(const Placement& p, std::size_t scan, double reach) {
  throw_input(
      p.names[scan],
      fmt::format("does not overlap the scans that it should lie on: fewer than {} % of its "
                  "points, or {}, have a counterpart within {:.4g}; leave it out, move it "
                  "nearer first, or raise `reach`",
                  100 * kLeastShare, kLeastMatches, reach));
}

/// Moves scan after scan onto those placed before, that with the most matches first.
void place_one_by_one(Placement& p, double reach) {
  const std::size_t count = p.scans.size();
  IcpTarget target;
  add_to_target(p.scans[0], p.poses[0], kTargetPoints, target);
  std::vector<bool> placed(count, false);
  placed[0] = true;
  std::size_t latest = 0;
  std::vector<std::size_t> best(count, 0);  // Matches with a placed scan.
  for (std::size_t step = 1; step < count; ++step) {
    std::size_t next = 0;
    for (std::size_t k = 1; k < count; ++k) {
      if (placed[k]) continue;
      const std::size_t found =
          match_scans(p.scans[k], p.scans[latest], p.relative(k, latest), reach, kStartPoints)
              .size();
      best[k] = std::max(best[k], found);
      if (next == 0 || best[k] > best[next]) next = k;
    }
    if (!enough(best[next], matched_points(p.scans[next], kStartPoints))) {
      throw_apart(p, next, reach);
    }
    p.poses[next] = icp_pose(p.scans[next], p.poses[next], target, reach, kStartPoints);
    add_to_target(p.scans[next], p.poses[next], kTargetPoints, target);
    placed[next] = true;
    latest = next;
  }
}

/// Points of each scan that are matched with each other one.
std::size_t points_to_match(const Placement& p) {
  constexpr std::size_t kFewest = 500;
  constexpr std::size_t kMost = 5000;
  return std::clamp(kMostMatches / (p.scans.size() * (p.scans.size() - 1)), kFewest, kMost);
}

/// Matches of all pairs. \param reach  Of none less than kLastReach spacings.
std::vector<PairMatches> match_all(const Placement& p, double reach) {
  std::vector<PairMatches> all;
  for (std::size_t i = 0; i < p.scans.size(); ++i) {
    for (std::size_t j = 0; j < p.scans.size(); ++j) {
      if (i == j) continue;
      const double near = std::max(reach, kLastReach * p.scans[j].spacing);
      all.push_back(
          {i, j, match_scans(p.scans[i], p.scans[j], p.relative(i, j), near, points_to_match(p))});
    }
  }
  return all;
}

void put(const Vec3d& v, double* out) { std::copy_n(v.data(), 3, out); }

/// Matches as Ceres wants them, with points in the common frame, where they are about the middle of
/// the scan that they belong to.
std::vector<PlaneMatch> plane_matches(const Placement& p, const std::vector<PairMatches>& pairs) {
  std::vector<PlaneMatch> all;
  for (const PairMatches& pair : pairs) {
    const Scan& from = p.scans[pair.from];
    const Scan& to = p.scans[pair.to];
    for (const ScanMatch& m : pair.matches) {
      PlaneMatch& match = all.emplace_back();
      match.moving = static_cast<std::uint32_t>(pair.from);
      match.fixed = static_cast<std::uint32_t>(pair.to);
      put(p.poses[pair.from].rotation * from.position[m.from].cast<double>(), match.point);
      put(p.poses[pair.to].rotation * to.position[m.to].cast<double>(), match.on_plane);
      put(p.poses[pair.to].rotation * to.normal[m.to].cast<double>(), match.normal);
    }
  }
  return all;
}

/// Distance of a match's point to the plane.
double plane_distance(const Placement& p, const PlaneMatch& match) {
  const Vec3d apart = p.poses[match.moving].translation - p.poses[match.fixed].translation +
                      Vec3d(match.point) - Vec3d(match.on_plane);
  return apart.dot(Vec3d(match.normal));
}

/// Standard deviation of distances, of which some are of no true matches, by their median.
double robust_deviation(const Placement& p, const std::vector<PlaneMatch>& matches) {
  constexpr double kPerMedian = 1.4826;  // Of a normal distribution.
  std::vector<double> distance;
  for (const PlaneMatch& match : matches) distance.push_back(std::abs(plane_distance(p, match)));
  const auto middle = distance.begin() + static_cast<std::ptrdiff_t>(distance.size() / 2);
  std::nth_element(distance.begin(), middle, distance.end());
  return kPerMedian * *middle;
}

/// One bundle. \return the largest move of a point.
double solve_bundle(Placement& p, double reach) {
  constexpr double kCauchy = 2.385;  // 95 % efficient where errors are normal [Rey 1983].
  const std::vector<PlaneMatch> matches = plane_matches(p, match_all(p, reach));
  if (matches.empty()) return 0;
  // Scans that fit exactly still need a scale.
  const double least = 1e-6 * p.scans[0].spacing;
  std::vector<BodyMotion> motion(p.scans.size());
  for (std::size_t k = 0; k < motion.size(); ++k) put(p.poses[k].translation, motion[k].value + 3);
  ceres_move_bodies(matches, std::max(kCauchy * robust_deviation(p, matches), least), motion);
  double largest = 0;
  for (std::size_t k = 1; k < motion.size(); ++k) {
    const Vec3d turn(motion[k].value);
    const Vec3d translation(motion[k].value + 3);
    const double angle = turn.norm();
    largest = std::max(largest,
                       (translation - p.poses[k].translation).norm() + angle * p.scans[k].radius);
    if (angle > 0) {
      const Quaternion rotation = rotation_about(turn / angle, angle);
      p.poses[k].rotation = (rotation * p.poses[k].rotation).normalized();
    }
    p.poses[k].translation = translation;
  }
  return largest;
}

/// Bundles with matches ever nearer, until nothing moves.
void solve_bundles(Placement& p, AlignReport& report) {
  constexpr int kMostRounds = 60;
  constexpr double kShrink = 0.6;
  constexpr double kStill = 1e-3;  // Spacings.
  double spacing = p.scans[0].spacing;
  for (const Scan& scan : p.scans) spacing = std::min(spacing, scan.spacing);
  double reach = report.reach / 2;
  while (report.rounds < kMostRounds && !report.converged) {
    const double moved = solve_bundle(p, reach);
    ++report.rounds;
    const bool still = moved <= kStill * spacing;
    report.converged = reach <= spacing && still;
    // Nearer matches are for scans that move; where none does the nearest are tried at once.
    reach = still ? 0.5 * spacing : std::max(kShrink * reach, 0.5 * spacing);
  }
}

/// Refuses scans that no chain of overlapping scans joins to the first.
void require_joined(const Placement& p, const std::vector<PairMatches>& pairs) {
  std::vector<bool> joined(p.scans.size(), false);
  joined[0] = true;
  const std::size_t most = points_to_match(p);
  for (bool more = true; more;) {
    more = false;
    for (const PairMatches& pair : pairs) {
      if (joined[pair.from] == joined[pair.to]) continue;
      if (!enough(pair.matches.size(), matched_points(p.scans[pair.from], most))) continue;
      joined[pair.from] = joined[pair.to] = true;
      more = true;
    }
  }
  for (std::size_t k = 0; k < joined.size(); ++k) {
    if (!joined[k]) throw_apart(p, k, kLastReach * p.scans[k].spacing);
  }
}

/// What the poses are worth, and the poses in world coordinates.
void measure(const Placement& p, AlignReport& report) {
  const std::vector<PairMatches> pairs = match_all(p, 0);
  require_joined(p, pairs);
  const std::vector<PlaneMatch> matches = plane_matches(p, pairs);
  std::vector<std::vector<std::uint32_t>> matched(p.scans.size());
  for (const PairMatches& pair : pairs) {
    for (const ScanMatch& m : pair.matches) matched[pair.from].push_back(m.from);
  }
  std::vector<double> squares(p.scans.size(), 0);
  std::vector<std::size_t> count(p.scans.size(), 0);
  for (const PlaneMatch& match : matches) {
    const double square = portable::squared(plane_distance(p, match));
    squares[match.moving] += square;
    ++count[match.moving];
    report.rms += square;
  }
  report.matches = matches.size();
  report.rms = std::sqrt(report.rms / static_cast<double>(matches.size()));
  for (std::size_t k = 0; k < p.scans.size(); ++k) {
    ScanFit& fit = report.scans.emplace_back();
    const Scan& scan = p.scans[k];
    std::sort(matched[k].begin(), matched[k].end());
    fit.matched = static_cast<std::size_t>(std::unique(matched[k].begin(), matched[k].end()) -
                                           matched[k].begin());
    fit.points = matched_points(scan, points_to_match(p));
    fit.rms = count[k] > 0 ? std::sqrt(squares[k] / static_cast<double>(count[k])) : 0;
    if (k == 0) continue;  // It stays, to the bit.
    fit.pose.rotation = p.poses[k].rotation;
    const Vec3d place = p.scans[0].center + p.poses[k].translation;
    fit.pose.translation = place - p.poses[k].rotation * scan.center;
    const double angle = rotation_angle(fit.pose.rotation);
    fit.moved = (place - scan.center).norm() + 2 * portable::sin(angle / 2) * scan.radius;
  }
}

}  // namespace

std::vector<std::string> AlignOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, reach == 0 || (reach >= 1e-9 && reach <= 1e9), "reach", reach,
               "in 1e-9..1e9, or 0 for the default");
  return found;
}

AlignReport align_scans(std::span<const SurfelCloud> clouds, const AlignOptions& options,
                        std::span<const std::string> names) {
  require_usable(options);
  if (clouds.size() < 2) throw_usage("one scan alone has nothing to be aligned with");
  constexpr double kReachShare = 0.05;
  AlignReport report;
  StageTimer stage(report.times);
  Placement p = make_placement(clouds, names);
  report.reach = options.reach;
  if (report.reach == 0) {
    for (const Scan& scan : p.scans) {
      report.reach = std::max(report.reach, 2 * kReachShare * scan.radius);
    }
  }
  stage.end("normals");
  place_one_by_one(p, report.reach);
  stage.end("pairs");
  solve_bundles(p, report);
  stage.end("bundle");
  measure(p, report);
  stage.end("measure");
  return report;
}

}  // namespace surfel
