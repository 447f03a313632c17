// Creases by two or three planes in a neighbourhood.

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/scan_creases.h>
#include <surfel/surface/tangent_frame.h>

namespace surfel {
namespace {

constexpr std::size_t kCreaseGrain = 256;
/// Points around one in which planes are looked for: beside a crease the nearest 16, whose normals
/// hold both faces, reach 2.3 spacings on an even surface; these reach 3.9, so that each face has
/// points whose normals are its own.
constexpr std::size_t kCreaseNeighbors = 48;
/// Where normals are made from more than 16 points, as in noise, as many times as many; at most so
/// many points.
constexpr std::size_t kNeighborsByNormals = 3;
constexpr std::size_t kMostCreaseNeighbors = 192;
/// Neighbours whose normals tell whether there may be a crease, and whether it goes on.
constexpr std::size_t kNearNeighbors = 16;
/// Share of the crease angle by which a neighbour's normal has to differ for a closer look, and of
/// the surface variation that a crease of that angle has next to it.
constexpr double kLookShare = 0.7;
/// Surface variation next to a crease, by tan^2 of half its angle: the variance of a wedge's height
/// in a disc of radius r, (1/4 - 16 / (9 pi^2)) r^2 tan^2, by the disc's r^2 / 2.
constexpr double kWedgeVariation = 0.14;
constexpr std::size_t kMostFaces = 3;
/// Points that a plane needs.
constexpr double kLeastOfFace = 8;
constexpr int kMostRounds = 6;
/// Deviation after the first round, in spacings, from which no further round leads to planes.
constexpr double kHopeless = 0.5;
/// A smooth surface's variance has to be this many times the planes': of 48 points with the same
/// noise the ratio is beyond 2.1 once in a hundred times (F distribution, 42 degrees of freedom).
constexpr double kLeastRatio = 3;
/// Largest deviation of points from their planes, in spacings.
constexpr double kMostDeviation = 0.25;
/// Largest standard error of the place of a line, in spacings.
constexpr double kMostLineError = 0.2;
/// How far points may lie beyond their face's line, in spacings, beside three deviations.
constexpr double kBeyondCrease = 0.25;
/// A face's points this close to a point tell whether the face ends at a line, in spacings: about
/// as far as a splat reaches, as the line may bend further away.
constexpr double kOwnReach = 2;
/// Lines further away cut no splat, in spacings.
constexpr double kMostDistance = 3;
/// By how much two faces may turn as they approach each other, by the angle at which they meet: a
/// smooth bend that is taken for two planes turns by twice this angle.
constexpr double kMostTurning = 0.4;
/// Cosine of 65 degrees: faces that enclose a smaller angle are both sides of a thin part.
constexpr double kMostEnclosed = 0.42;
/// A quadric that fits better than this is no crease, by the tangent of half the crease angle, in
/// spacings. A crease through the middle of a neighbourhood leaves 0.28, and one through its rim
/// less.
constexpr double kLeastMisfit = 0.1;
/// One in this many of the nearest points has to see a crease, too.
constexpr std::size_t kAgreeingShare = 3;
/// Points of a face are no further from its plane, in spacings.
constexpr float kCoplanar = 0.15F;
/// Where one in this many of the nearest points is beside a crease a point is looked at again.
constexpr std::size_t kSureShare = 2;

/// A plane n . x = offset, x being relative to the point that is looked at, and its points.
struct Face {
  Plane plane{};
  double offset = 0;
  Vec3d mean{0, 0, 0};
  Moments moments;

  double distance(const Vec3d& x) const { return plane.normal.dot(x) - offset; }
  void pass_through(const Vec3d& x) {
    mean = x;
    offset = plane.normal.dot(x);
  }
};

enum class Verdict : std::uint8_t { kUnseen, kSmooth, kUnsure, kCrease };

/// What is found at a point.
struct Crease {
  Verdict verdict = Verdict::kSmooth;
  Plane plane{};
  EdgeLines lines;
};

class CreaseFinder {
 public:
  CreaseFinder(const Array<Vec3f>& position, const NeighborSearch& search,
               const CreaseOptions& options, const NormalEstimate& normals)
      : position_(position), search_(search), normals_(normals) {
    const double angle = options.crease_angle * std::numbers::pi / 180;
    most_cosine_ = portable::cos(angle);
    const double slope = portable::sin(angle / 2) / portable::cos(angle / 2);
    look_variation_ = static_cast<float>(kLookShare * kWedgeVariation * slope * slope);
    least_variance_ = kLeastMisfit * kLeastMisfit * slope * slope;
    look_cosine_ = static_cast<float>(portable::cos(kLookShare * angle));
  }

  /// May a crease be next to a point? The normals of the nearest points differ, and its own
  /// neighbourhood is not flat.
  bool bends(std::size_t i, std::span<const std::uint32_t> nearest) const {
    const Vec3f& n = normals_.normal[i];
    if (n.isZero(0) || normals_.quality[i].curvature < look_variation_) return false;
    return std::any_of(nearest.begin(), nearest.end(), [&](std::uint32_t j) {
      const Vec3f& other = normals_.normal[j];
      return !other.isZero(0) && std::abs(n.dot(other)) < look_cosine_;
    });
  }

  Crease look(std::size_t i) {
    const std::size_t wide =
        std::min(kNeighborsByNormals * normals_.quality[i].neighbors, kMostCreaseNeighbors);
    Crease found;
    if (wide > kCreaseNeighbors) found = look(i, wide);
    return found.verdict == Verdict::kCrease ? found : look(i, kCreaseNeighbors);
  }

 private:
  /// Looks at the `count` nearest points.
  Crease look(std::size_t i, std::size_t count) {
    Crease found;
    search_.nearest(position_[i], count, near_);
    if (near_.size() < count) return found;
    spacing_ = std::sqrt(std::numbers::pi * static_cast<double>(near_.back().distance2) /
                         static_cast<double>(near_.size()));
    if (!(spacing_ > 0)) return found;
    offset_.clear();
    for (const Neighbor& n : near_) {
      offset_.push_back((position_[n.index] - position_[i]).cast<double>() / spacing_);
    }
    if (quadric_variance(normals_.normal[i].cast<double>()) < least_variance_) return found;
    if (!seed_faces() || !fit_faces()) return found;
    found.verdict = Verdict::kUnsure;
    const auto freedom = static_cast<double>(offset_.size() - 3 * faces_);
    const double variance = squares_ / freedom;
    if (!(variance < kMostDeviation * kMostDeviation)) return found;
    if (!(kLeastRatio * variance < quadric_variance(between_faces()))) return found;
    deviation_ = std::sqrt(variance);
    if (!add_lines(found.lines)) return found;
    found.verdict = Verdict::kCrease;
    found.plane = face_[own()].plane;
    return found;
  }

  double cosine(std::size_t a, std::size_t b) const {
    return std::abs(face_[a].plane.normal.dot(face_[b].plane.normal));
  }
  /// Face of the point itself, which is the first of its neighbourhood; kMostFaces: none yet.
  std::size_t own() const { return of_.front(); }

  /// The flattest neighbourhoods of points around whose normals differ by the crease angle.
  bool seed_faces() {
    faces_ = 0;
    while (faces_ < kMostFaces) {
      float flattest = std::numeric_limits<float>::infinity();
      for (std::size_t k = 0; k < near_.size(); ++k) {
        const std::uint32_t j = near_[k].index;
        const Vec3d normal = normals_.normal[j].cast<double>();
        const float curvature = normals_.quality[j].curvature;
        if (normal.isZero(0) || !(curvature < flattest)) continue;
        bool differs = true;
        for (std::size_t f = 0; f < faces_; ++f) {
          differs = differs && std::abs(face_[f].plane.normal.dot(normal)) < most_cosine_;
        }
        if (!differs) continue;
        flattest = curvature;
        face_[faces_].plane.normal = normal;
        face_[faces_].pass_through(offset_[k]);
      }
      if (flattest == std::numeric_limits<float>::infinity()) break;
      ++faces_;
    }
    return faces_ >= 2;
  }

  /// Fits the planes to the points nearest to them. False if two planes do not remain that meet at
  /// the crease angle, one of which is the point's own.
  bool fit_faces() {
    of_.assign(offset_.size(), kMostFaces);
    for (int round = 0; round < kMostRounds; ++round) {
      if (!assign_points()) break;
      if (round == 1 && squares_ > kHopeless * kHopeless * static_cast<double>(of_.size())) {
        return false;
      }
      for (std::size_t f = 0; f < faces_; ++f) {
        face_[f].moments = Moments();
        for (std::size_t k = 0; k < of_.size(); ++k) {
          if (of_[k] == f) face_[f].moments.add(offset_[k]);
        }
      }
      if (faces_ == kMostFaces && drop_small_face()) continue;
      PlaneBatch batch;
      for (std::size_t f = 0; f < faces_; ++f) {
        const Moments& moments = face_[f].moments;
        if (moments.n < kLeastOfFace || !(moments.variance() > 0)) return false;
        moments.store(f, batch);
      }
      fit_planes(faces_, batch);
      for (std::size_t f = 0; f < faces_; ++f) {
        Face& face = face_[f];
        face.plane = plane_of(batch, f, face.moments.n);
        if (!(face.plane.lambda[1] > Plane::kLineShare * face.plane.lambda[2])) return false;
        face.pass_through(face.moments.mean());
      }
    }
    if (own() == kMostFaces) return false;  // Points were left out in the last round.
    for (std::size_t f = 0; f < faces_; ++f) {
      for (std::size_t g = 0; g < f; ++g) {
        if (cosine(f, g) > most_cosine_) return false;
      }
    }
    return true;
  }

  /// Leaves out a face with too few points for a plane, and these points: it is another crease's.
  bool drop_small_face() {
    for (std::size_t f = 0; f < faces_; ++f) {
      if (face_[f].moments.n >= kLeastOfFace || f == own()) continue;
      std::size_t kept = 0;
      for (std::size_t k = 0; k < of_.size(); ++k) {
        if (of_[k] != f) offset_[kept++] = offset_[k];
      }
      offset_.resize(kept);
      of_.assign(kept, kMostFaces);
      --faces_;
      if (f < faces_) std::swap(face_[f], face_[faces_]);
      return true;
    }
    return false;
  }

  /// Gives each point to the nearest plane; returns whether one changed its plane.
  bool assign_points() {
    bool changed = false;
    squares_ = 0;
    for (std::size_t k = 0; k < offset_.size(); ++k) {
      std::size_t best = 0;
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t f = 0; f < faces_; ++f) {
        const double distance = std::abs(face_[f].distance(offset_[k]));
        if (distance < least) {
          least = distance;
          best = f;
        }
      }
      squares_ += least * least;
      changed = changed || of_[k] != best;
      of_[k] = best;
    }
    return changed;
  }

  /// Normal half-way between the faces'.
  Vec3d between_faces() const {
    Vec3d up = face_[0].plane.normal;
    for (std::size_t f = 1; f < faces_; ++f) {
      const Vec3d& n = face_[f].plane.normal;
      up += n.dot(up) < 0 ? Vec3d(-n) : n;
    }
    return up.normalized();
  }

  /// Variance of the distances from the best quadric, a function of height along `up`; distances
  /// are heights by the slope.
  double quadric_variance(const Vec3d& up) const {
    const TangentFrame frame = tangent_frame(up);
    using Vector6 = Eigen::Matrix<double, 6, 1>;
    using Matrix6 = Eigen::Matrix<double, 6, 6>;
    const auto terms = [](const Vec2d& p) {
      Vector6 t;
      t << 1, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y();
      return t;
    };
    Matrix6 sum = Matrix6::Zero();
    Vector6 image = Vector6::Zero();
    for (const Vec3d& x : offset_) {
      const Vector6 t = terms(frame.flat(x));
      sum += t * t.transpose();
      image += t * frame.height(x);
    }
    const Vector6 c = sum.ldlt().solve(image);
    double squares = 0;
    for (const Vec3d& x : offset_) {
      const Vec2d p = frame.flat(x);
      const double error = frame.height(x) - c.dot(terms(p));
      const Vec2d slope(c[1] + 2 * c[3] * p.x() + c[4] * p.y(),
                        c[2] + c[4] * p.x() + 2 * c[5] * p.y());
      squares += error * error / (1 + slope.squaredNorm());
    }
    return squares / static_cast<double>(offset_.size() - 6);
  }

  /// The lines at which other faces cut the point's own. False if none is known well enough.
  bool add_lines(EdgeLines& lines) const {
    const Face& face = face_[own()];
    bool known = false;
    for (std::size_t f = 0; f < faces_; ++f) {
      if (f == own()) continue;
      const Face& other = face_[f];
      const double cosine = face.plane.normal.dot(other.plane.normal);
      const double sine = std::sqrt(1 - cosine * cosine);
      Vec3d outward = (other.plane.normal - cosine * face.plane.normal) / sine;
      // Along `outward` from the point's foot on its plane the line is this far away.
      double distance = (other.offset - cosine * face.offset) / sine;
      if (line_error(outward, distance, sine, face, other) > kMostLineError ||
          bends_smoothly(outward, distance, sine, cosine, f) ||
          encloses_little(outward, distance, sine, cosine, f)) {
        // Next to a line that may not be there the point keeps its normal, as its splat would stand
        // out beyond the face.
        if (std::abs(distance) < kOwnReach) return false;
        continue;
      }
      known = true;
      if (outward.dot(face.mean) > distance) {
        outward = -outward;
        distance = -distance;
      }
      const double most = distance + kBeyondCrease + 3 * deviation_;
      bool ends = distance > -(kBeyondCrease + deviation_) && distance < kMostDistance;
      for (std::size_t k = 0; ends && k < offset_.size(); ++k) {
        ends = of_[k] != own() || offset_[k].squaredNorm() > kOwnReach * kOwnReach ||
               outward.dot(offset_[k]) <= most;
      }
      if (!ends) continue;
      lines.add({outward.cast<float>(), static_cast<float>(std::max(0.0, distance) * spacing_)});
    }
    return known;
  }

  /// Do the faces beside a line enclose a small angle?
  bool encloses_little(const Vec3d& outward, double distance, double sine, double cosine,
                       std::size_t f) const {
    const Face& face = face_[own()];
    const Face& other = face_[f];
    const Vec3d back = (face.plane.normal - cosine * other.plane.normal) / sine;
    const double side = outward.dot(face.mean) > distance ? 1 : -1;
    const double other_side =
        back.dot(other.mean) > (face.offset - cosine * other.offset) / sine ? 1 : -1;
    return side * other_side * outward.dot(back) > kMostEnclosed;
  }

  /// Do the faces beside a line bend so much as they approach it that there may be no crease? Where
  /// a smooth surface was divided, each face turns as much as the two meet at.
  bool bends_smoothly(const Vec3d& outward, double distance, double sine, double cosine,
                      std::size_t f) const {
    const Face& face = face_[own()];
    const Face& other = face_[f];
    const double turning =
        turning_of(own(), other, outward, distance) +
        turning_of(f, face, (face.plane.normal - cosine * other.plane.normal) / sine,
                   (face.offset - cosine * other.offset) / sine);
    return turning > kMostTurning * portable::atan2(sine, std::abs(cosine));
  }

  /// By how much a face turns towards the other one from its furthest point to its nearest point,
  /// across their line, radians: by the parabola that fits the points' distances from its plane.
  double turning_of(std::size_t f, const Face& other, const Vec3d& across, double distance) const {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    Vec3d image(0, 0, 0);
    double nearest = std::numeric_limits<double>::infinity();
    double furthest = 0;
    for (std::size_t k = 0; k < offset_.size(); ++k) {
      if (of_[k] != f) continue;
      const double t = std::abs(across.dot(offset_[k]) - distance);
      nearest = std::min(nearest, t);
      furthest = std::max(furthest, t);
      const Vec3d terms(1, t, t * t);
      sum += terms * terms.transpose();
      image += terms * face_[f].distance(offset_[k]);
    }
    const Vec3d parabola = sum.ldlt().solve(image);
    // The other face's mean is on the side that a bend turns to.
    const double towards = face_[f].distance(other.mean) > 0 ? 1 : -1;
    return 2 * towards * parabola[2] * (furthest - nearest);
  }

  /// Standard error of the place of a line next to the point: of both planes' heights there, by
  /// the sine between the planes.
  double line_error(const Vec3d& outward, double distance, double sine, const Face& face,
                    const Face& other) const {
    const Vec3d place = face.offset * face.plane.normal + distance * outward;
    const auto share = [&](const Face& f) {
      const Vec3d from = place - f.mean;
      const Vec3d along = (from - f.plane.normal * f.plane.normal.dot(from));
      const double length2 = along.squaredNorm();
      if (!(length2 > 0)) return 1 / f.moments.n;
      return (1 + length2 / f.moments.variance_along(along / std::sqrt(length2))) / f.moments.n;
    };
    return deviation_ * std::sqrt(share(face) + share(other)) / sine;
  }

  const Array<Vec3f>& position_;
  const NeighborSearch& search_;
  const NormalEstimate& normals_;
  double most_cosine_;
  float look_cosine_;
  float look_variation_;
  double least_variance_;
  // The neighbourhood that is looked at, in spacings.
  std::vector<Neighbor> near_;
  double spacing_ = 0;
  std::vector<Vec3d> offset_;
  std::vector<std::size_t> of_;  ///< Face of each point.
  std::array<Face, kMostFaces> face_;
  std::size_t faces_ = 0;
  double squares_ = 0;  ///< Sum of the squared distances of points from their planes.
  double deviation_ = 0;
};

/// A point beside a crease, and what was known of it before.
struct FoundCrease {
  std::uint32_t point;
  EdgeLines lines;
  Vec3f normal_before;
  NormalQuality quality_before;
};

/// Lines of a point's neighbours on its face.
struct FaceNeighbors {
  const Array<Vec3f>& position;
  const NormalEstimate& normals;
  const Array<EdgeLines>& lines;
  const std::vector<Verdict>& verdict;
  const NeighborRows& rows;

  /// Takes the lines of the nearest neighbour whose plane a point lies in, if most such neighbours
  /// have lines and none of these points lies beyond a line. Returns the neighbour, or else the
  /// point.
  std::uint32_t take(std::uint32_t i, EdgeLines& out) const {
    const auto near = rows.of(i);
    const auto offset = [&](std::uint32_t j) -> Vec3f { return position[j] - position[i]; };
    const float spacing = std::sqrt(std::numbers::pi_v<float> * offset(near.back()).squaredNorm() /
                                    static_cast<float>(near.size()));
    std::uint32_t nearest = i;
    int with = 0;
    int without = 0;
    for (const std::uint32_t j : near) {
      if (j == i || verdict[j] != Verdict::kCrease) continue;
      if (std::abs(normals.normal[j].dot(offset(j))) > kCoplanar * spacing) continue;
      (lines[j].count > 0 ? with : without) += 1;
      if (nearest == i && lines[j].count > 0) nearest = j;
    }
    if (nearest == i || with < without) return i;
    const Vec3f normal = normals.normal[nearest];
    for (const EdgeLine& line : lines[nearest]) {
      const float distance = line.distance + line.outward.dot(offset(nearest));
      const auto most = distance + static_cast<float>(kBeyondCrease) * spacing;
      if (most < 0) return i;
      for (const std::uint32_t j : near) {
        if (std::abs(normal.dot(offset(j))) <= kCoplanar * spacing &&
            line.outward.dot(offset(j)) > most) {
          return i;
        }
      }
      out.add({line.outward, std::max(0.0F, distance)});
    }
    return nearest;
  }
};

/// Makes a plane the one that a point's normal is of.
void set_plane(const Plane& plane, Vec3f& normal, NormalQuality& quality) {
  normal = with_fixed_side(plane.normal);
  quality.curvature = static_cast<float>(plane.variation());
  quality.confidence = static_cast<float>(std::max(0.0, 1 - plane.error(plane.noise())));
  quality.neighbors = static_cast<std::uint16_t>(plane.n);
}

/// The numbers below `count` that are chosen, ascending.
template <class Chosen>
std::vector<std::uint32_t> selected(std::size_t count, const Chosen& chosen) {
  std::vector<unsigned char> is_chosen(count);
  parallel_each(count, kCreaseGrain, [&](std::size_t i) { is_chosen[i] = chosen(i) ? 1 : 0; });
  std::vector<std::uint32_t> out;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (is_chosen[i] != 0) out.push_back(i);
  }
  return out;
}

}  // namespace

std::vector<std::string> CreaseOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, crease_angle >= 10 && crease_angle <= 90, "crease_angle", crease_angle,
               "in 10..90 degrees");
  return found;
}

CreaseReport sharpen_creases(const Array<Vec3f>& position, const NeighborSearch& search,
                             const CreaseOptions& options, NormalEstimate& normals,
                             Array<EdgeLines>& lines) {
  require_usable(options);
  const std::size_t count = position.size();
  const NeighborRows rows = search.rows(kNearNeighbors);
  std::vector<Verdict> verdict(count, Verdict::kUnseen);
  const auto creases_near = [&](std::size_t i) {
    const auto near = rows.of(i);
    return static_cast<std::size_t>(std::count_if(
        near.begin(), near.end(), [&](std::uint32_t j) { return verdict[j] == Verdict::kCrease; }));
  };
  std::vector<FoundCrease> found;
  // Normals of faces that have been found are what the next points' planes start as.
  const auto look_at = [&](const std::vector<std::uint32_t>& points) {
    std::vector<Crease> creases(points.size());
    parallel_for(points.size(), kCreaseGrain, [&](std::size_t begin, std::size_t end, int) {
      CreaseFinder finder(position, search, options, normals);
      for (std::size_t k = begin; k < end; ++k) creases[k] = finder.look(points[k]);
    });
    for (std::size_t k = 0; k < points.size(); ++k) {
      const std::uint32_t i = points[k];
      verdict[i] = creases[k].verdict;
      if (verdict[i] != Verdict::kCrease) continue;
      found.push_back({i, creases[k].lines, normals.normal[i], normals.quality[i]});
      set_plane(creases[k].plane, normals.normal[i], normals.quality[i]);
    }
  };
  // First where the surface bends most, then around creases, as far as these are seen.
  const CreaseFinder first(position, search, options, normals);
  std::vector<std::uint32_t> next =
      selected(count, [&](std::size_t i) { return first.bends(i, rows.of(i)); });
  while (!next.empty()) {
    look_at(next);
    next = selected(count, [&](std::size_t i) {
      return verdict[i] == Verdict::kUnseen && !normals.normal[i].isZero(0) && creases_near(i) > 0;
    });
  }
  look_at(selected(count, [&](std::size_t i) {
    return (verdict[i] == Verdict::kUnsure || verdict[i] == Verdict::kSmooth) &&
           kSureShare * creases_near(i) >= rows.count;
  }));
  CreaseReport report;
  report.unsure = count_where(count, [&](std::size_t i) { return verdict[i] == Verdict::kUnsure; });
  for (const FoundCrease& crease : found) {
    const std::uint32_t i = crease.point;
    if (kAgreeingShare * creases_near(i) < rows.count) {
      ++report.unsure;
      normals.normal[i] = crease.normal_before;
      normals.quality[i] = crease.quality_before;
      continue;
    }
    ++report.points;
    lines[i] = crease.lines;
  }
  return report;
}

}  // namespace surfel
