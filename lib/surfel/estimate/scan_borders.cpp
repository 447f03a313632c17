// Borders of sampled surfaces as lines through the points whose cells are open.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/scan_borders.h>
#include <surfel/surface/sheet.h>
#include <surfel/surface/tangent_frame.h>

namespace surfel {
namespace {

constexpr std::size_t kBorderGrain = 64;
/// How far around a point its border is looked at, in spacings.
constexpr double kWindow = 4;
constexpr std::size_t kMostOfWindow = 256;
/// Points of a border are no further from its line, in spacings.
constexpr double kNearLine = 0.45;
/// Points of the surface are no further beyond the line, in spacings.
constexpr double kBeyondBorder = 0.6;
constexpr std::size_t kLeastPoints = 4;
/// Least length along the line from the first to the last point of the border, in spacings.
constexpr double kLeastLength = 2.5;
/// Distance of the mean of a surface's points from its border, in units of kWindow: of a half disc
/// it is 0.42.
constexpr double kLeastDepth = 0.2;
/// How far beyond the line of the outermost points the surface ends, in spacings.
constexpr double kOvershoot = 0.4;
/// Cosine of 25 degrees: lines of one border.
constexpr double kSameLine = 0.9;
/// Lines around a point count by exp(-(distance / this)^2), in spacings.
constexpr double kBlend = 1.5;
/// Deviations of a splat's kernel that lines have to be within to cut it.
constexpr double kSplatReach = 3;
/// How far points may lie beyond a splat's line, and the splat's own point, in spacings.
constexpr double kBeyondSplat = 0.25;
/// Normals of one sheet beside a border differ by less than the angle of this cosine.
constexpr float kSheetCosine = 0.5F;
/// Points that are no further from the tangent plane may be of the surface, in spacings, as noise
/// takes them there.
constexpr double kNoise = 2;

/// The border next to a point of it.
struct Border {
  Vec3d outward{0, 0, 0};  ///< Unit, in the point's tangent plane. Zero: no line is known.
  double distance = 0;     ///< Of the line from the point.

  bool known() const { return !outward.isZero(0); }
};

class BorderFinder {
 public:
  BorderFinder(const Array<Vec3f>& position, const Array<Vec3f>& normal, bool oriented,
               const NeighborSearch& search, const SplatSizes& sizes)
      : position_(position),
        normal_(normal),
        oriented_(oriented),
        search_(search),
        sizes_(sizes),
        border_(position.size()) {}

  BorderReport run(Array<EdgeLines>& lines) {
    std::vector<std::uint32_t> points;
    for (std::uint32_t i = 0; i < position_.size(); ++i) {
      if (at_border(i)) points.push_back(i);
    }
    PerWorker<Sheet> sheets;
    parallel_for(points.size(), kBorderGrain, [&](std::size_t begin, std::size_t end, int worker) {
      for (std::size_t k = begin; k < end; ++k) {
        border_[points[k]] = fit(points[k], sheets[worker]);
      }
    });
    const std::vector<std::uint32_t> near = near_borders(points);
    std::vector<EdgeLines> found(near.size());
    parallel_for(near.size(), kBorderGrain, [&](std::size_t begin, std::size_t end, int worker) {
      for (std::size_t k = begin; k < end; ++k) {
        found[k] = lines_of(near[k], lines[near[k]], sheets[worker]);
      }
    });
    BorderReport report;
    for (std::size_t k = 0; k < near.size(); ++k) {
      EdgeLines& of = lines[near[k]];
      if (found[k].count > of.count) ++report.points;
      of = found[k];
    }
    report.unsure = static_cast<std::size_t>(std::count_if(
        points.begin(), points.end(), [&](std::uint32_t i) { return lines[i].count == 0; }));
    return report;
  }

 private:
  /// The surface around a point, in its tangent plane, in spacings.
  struct Sheet {
    std::vector<Neighbor> near;
    std::vector<Vec2d> around;         ///< All points around, whatever their normals are.
    std::vector<std::uint32_t> index;  ///< Points of the sheet.
    std::vector<Vec2d> border;         ///< Of these the points at borders, the point itself first.
    TangentFrame frame;
    double spacing = 0;
  };

  bool at_border(std::size_t i) const {
    return sizes_.kind[i] == CellKind::kBorder && !normal_[i].isZero(0) && sizes_.of[i].spacing > 0;
  }

  /// Fills `sheet` with the points within `reach` spacings.
  void look_around(std::size_t i, double reach, Sheet& sheet) const {
    sheet.spacing = static_cast<double>(sizes_.of[i].spacing);
    sheet.frame = tangent_frame(normal_[i].cast<double>());
    sheet.index.clear();
    sheet.around.clear();
    sheet.border.assign(1, Vec2d(0, 0));
    search_.within(position_[i], static_cast<float>(reach * sheet.spacing), kMostOfWindow,
                   sheet.near);
    for (const Neighbor& n : sheet.near) {
      const Vec3d offset = (position_[n.index] - position_[i]).cast<double>() / sheet.spacing;
      const Vec2d flat = sheet.frame.flat(offset);
      const double height = sheet.frame.height(offset);
      if (!along_sheet(height * height, flat.squaredNorm()) && std::abs(height) > kNoise) continue;
      sheet.around.push_back(flat);
      const float product = normal_[i].dot(normal_[n.index]);
      if ((oriented_ ? product : std::abs(product)) < kSheetCosine) continue;
      sheet.index.push_back(n.index);
      if (n.index != i && at_border(n.index)) sheet.border.push_back(flat);
    }
  }

  /// A line in a tangent plane: normal . x = offset.
  struct FlatLine {
    Vec2d outward;
    double offset;
    double beyond(const Vec2d& x) const { return outward.dot(x) - offset; }
  };

  Border fit(std::size_t i, Sheet& sheet) const {
    look_around(i, kWindow, sheet);
    if (sheet.around.empty()) return {};
    Vec2d mean(0, 0);
    for (const Vec2d& x : sheet.around) mean += x / static_cast<double>(sheet.around.size());
    std::optional<FlatLine> best;
    std::size_t most = 0;
    double least = 0;
    for (const Vec2d& other : sheet.border) {
      if (other.squaredNorm() < 1) continue;
      FlatLine line{Vec2d(-other.y(), other.x()).normalized(), 0};
      if (line.outward.dot(mean) > 0) line.outward = -line.outward;
      if (is_crossed(line, sheet)) continue;
      std::size_t points = 0;
      double squares = 0;
      for (const Vec2d& x : sheet.border) {
        const double d = line.beyond(x);
        if (std::abs(d) > kNearLine) continue;
        ++points;
        squares += d * d;
      }
      if (points > most || (points == most && squares < least)) {
        best = line;
        most = points;
        least = squares;
      }
    }
    if (!best) return {};
    const std::optional<FlatLine> line = refined(*best, sheet);
    if (!line || line->outward.dot(mean) > line->offset - kLeastDepth * kWindow) return {};
    return {sheet.frame.lifted(line->outward), (line->offset + kOvershoot) * sheet.spacing};
  }

  static bool is_crossed(const FlatLine& line, const Sheet& sheet) {
    return std::any_of(sheet.around.begin(), sheet.around.end(),
                       [&](const Vec2d& x) { return line.beyond(x) > kBeyondBorder; });
  }

  /// The line of least squares of the points of the border near a line, twice.
  static std::optional<FlatLine> refined(FlatLine line, const Sheet& sheet) {
    for (int round = 0; round < 2; ++round) {
      Vec2d sum(0, 0);
      double xx = 0;
      double xy = 0;
      double yy = 0;
      double first = std::numeric_limits<double>::infinity();
      double last = -first;
      std::size_t points = 0;
      const Vec2d along(-line.outward.y(), line.outward.x());
      for (const Vec2d& x : sheet.border) {
        if (std::abs(line.beyond(x)) > kNearLine) continue;
        ++points;
        sum += x;
        xx += x.x() * x.x();
        xy += x.x() * x.y();
        yy += x.y() * x.y();
        first = std::min(first, along.dot(x));
        last = std::max(last, along.dot(x));
      }
      if (points < kLeastPoints || last - first < kLeastLength) return std::nullopt;
      const auto n = static_cast<double>(points);
      const Vec2d mean = sum / n;
      const PrincipalAxes axes = principal_axes(
          xx / n - mean.x() * mean.x(), xy / n - mean.x() * mean.y(), yy / n - mean.y() * mean.y());
      Vec2d outward(-axes.along.y(), axes.along.x());
      if (outward.dot(line.outward) < 0) outward = -outward;
      line = {outward, outward.dot(mean)};
    }
    if (is_crossed(line, sheet)) return std::nullopt;
    return line;
  }

  /// Points that may be within reach of a known border, ascending.
  std::vector<std::uint32_t> near_borders(const std::vector<std::uint32_t>& points) const {
    std::vector<unsigned char> is_near(position_.size());
    std::vector<Neighbor> near;
    for (const std::uint32_t i : points) {
      if (!border_[i].known()) continue;
      search_.within(position_[i], static_cast<float>(reach_of(i)), kMostOfWindow, near);
      for (const Neighbor& n : near) is_near[n.index] = normal_[n.index].isZero(0) ? 0 : 1;
    }
    std::vector<std::uint32_t> out;
    for (std::uint32_t i = 0; i < position_.size(); ++i) {
      if (is_near[i] != 0) out.push_back(i);
    }
    return out;
  }

  double deviation_of(std::size_t i) const {
    const SplatSize& size = sizes_.of[i];
    return std::sqrt(static_cast<double>(sizes_.ellipses ? size.variance_u : size.variance));
  }
  double reach_of(std::size_t i) const {
    return kSplatReach * deviation_of(i) + static_cast<double>(sizes_.of[i].spacing);
  }

  /// Mean of the lines around a point.
  struct Blend {
    Vec3d outward{0, 0, 0};
    double distance = 0;
    double weight = 0;
  };

  EdgeLines lines_of(std::size_t i, EdgeLines lines, Sheet& sheet) const {
    const double spacing = static_cast<double>(sizes_.of[i].spacing);
    look_around(i, std::min(kWindow, reach_of(i) / spacing), sheet);
    const Vec3d normal = normal_[i].cast<double>();
    std::array<Blend, 2> blend;
    // Neighbours come by ascending distance: the first line is the nearest one.
    for (std::size_t k = 0; k < sheet.index.size(); ++k) {
      const Border& border = border_[sheet.index[k]];
      if (!border.known()) continue;
      const Vec3d offset = (position_[sheet.index[k]] - position_[i]).cast<double>();
      const Vec3d outward = (border.outward - normal * normal.dot(border.outward)).normalized();
      const double ratio = offset.norm() / (kBlend * spacing);
      const double weight = portable::exp(-ratio * ratio);
      for (Blend& b : blend) {
        if (b.weight > 0 && b.outward.dot(outward) < kSameLine * b.outward.norm()) continue;
        b.outward += weight * outward;
        b.distance += weight * (outward.dot(offset) + border.distance);
        b.weight += weight;
        break;
      }
    }
    const double most = kSplatReach * deviation_of(i);
    const double reach2 = most * most / (spacing * spacing);
    for (const Blend& b : blend) {
      if (!(b.weight > 0)) continue;
      const Vec3d outward = b.outward.normalized();
      const double distance = b.distance / b.weight;
      if (distance > most || distance < -kBeyondSplat * spacing) continue;
      const FlatLine line{sheet.frame.flat(outward), std::max(0.0, distance) / spacing};
      const bool crossed =
          std::any_of(sheet.around.begin(), sheet.around.end(), [&](const Vec2d& x) {
            return x.squaredNorm() <= reach2 && line.beyond(x) > kBeyondSplat;
          });
      if (crossed) continue;
      lines.add({outward.cast<float>(), static_cast<float>(std::max(0.0, distance))});
    }
    return lines;
  }

  const Array<Vec3f>& position_;
  const Array<Vec3f>& normal_;
  bool oriented_;
  const NeighborSearch& search_;
  const SplatSizes& sizes_;
  std::vector<Border> border_;  ///< By point.
};

}  // namespace

BorderReport find_borders(const Array<Vec3f>& position, const Array<Vec3f>& normal, bool oriented,
                          const NeighborSearch& search, const SplatSizes& sizes,
                          Array<EdgeLines>& lines) {
  return BorderFinder(position, normal, oriented, search, sizes).run(lines);
}

}  // namespace surfel
