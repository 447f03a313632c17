#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/radix_sort.h>
#include <surfel/sample/detail_tree.h>
#include <surfel/sample/poisson_disk.h>

namespace surfel {
namespace {

/// Normals are told apart by the axis that they are nearest to, and its sign.
constexpr std::size_t kSides = 6;
/// Parts of a cell, kTrimmedLevels down, that have less than kIdleShare of the mean density of
/// error do not ask for the cell's spacing: most of a cell that an edge crosses.
constexpr int kTrimmedLevels = 2;
constexpr double kIdleShare = 0.1;
/// Spacing where all surfels are kept, in units of the finest spacing: so small that no two surfels
/// are near each other.
constexpr double kKeptSpacing = 1e-3;

std::size_t side_of(const Vec3f& normal) {
  int axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  return 2 * static_cast<std::size_t>(axis) + (normal[axis] < 0 ? 1 : 0);
}

/// Channels of a surfel's look at a place: colour, opacity, and shading by the normal.
constexpr int kChannels = 7;
using ChannelVector = Eigen::Matrix<double, kChannels, 1>;

/// Sums over probes, about a point that all share.
struct Moments {
  double n = 0;
  double weight = 0;
  Vec3d normal = Vec3d::Zero();
  Vec3d x = Vec3d::Zero();
  Eigen::Matrix3d xx = Eigen::Matrix3d::Zero();
  ChannelVector c = ChannelVector::Zero();
  Eigen::Matrix<double, 3, kChannels> xc = Eigen::Matrix<double, 3, kChannels>::Zero();
  double cc = 0;

  void add(const SurfaceProbe& probe) {
    const Vec3d p = probe.position.cast<double>();
    ChannelVector color;
    color << probe.color.cast<double>(), probe.alpha, probe.shading.cast<double>();
    n += 1;
    weight += probe.weight;
    normal += probe.normal.cast<double>();
    x += p;
    xx += p * p.transpose();
    c += color;
    xc += p * color.transpose();
    cc += color.squaredNorm();
  }

  void add(const Moments& other) {
    n += other.n;
    weight += other.weight;
    normal += other.normal;
    x += other.x;
    xx += other.xx;
    c += other.c;
    xc += other.xc;
    cc += other.cc;
  }

  Eigen::Matrix3d covariance() const { return xx / n - (x / n) * (x / n).transpose(); }

  /// A third of the mean square, summed over the channels, of the difference between the channels
  /// and their best affine function of the place; a constant is taken where probes are few.
  double color_residual() const {
    if (n < 2) return 0;
    const double about_mean = std::max(0.0, cc / n - (c / n).squaredNorm()) / 3;
    if (n < 6) return about_mean * n / (n - 1);
    Eigen::Matrix3d M = covariance();
    // Probes in a plane have no extent along its normal, and M would have no inverse.
    M += (1e-9 * M.trace() + 1e-300) * Eigen::Matrix3d::Identity();
    const Eigen::Matrix<double, 3, kChannels> C = xc / n - (x / n) * (c / n).transpose();
    const double explained = (C.transpose() * M.inverse() * C).trace() / 3;
    return std::max(0.0, about_mean - explained) * n / (n - 3);
  }

  /// Mean squared distance from the best plane.
  double plane_residual() const {
    if (n < 4) return 0;
    // computeDirect() calls functions of the C library that differ between processors.
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance(),
                                                                Eigen::EigenvaluesOnly);
    return std::max(0.0, solver.eigenvalues()[0]) * n / (n - 3);
  }
};

struct CellMoments {
  std::array<Moments, kSides> side;
  double border = 0;  ///< Length.

  void add(const CellMoments& other) {
    for (std::size_t s = 0; s < kSides; ++s) side[s].add(other.side[s]);
    border += other.border;
  }
  double probes() const {
    double n = 0;
    for (const Moments& m : side) n += m.n;
    return n;
  }
  double weight() const {
    double sum = 0;
    for (const Moments& m : side) sum += m.weight;
    return sum;
  }
  /// Sums over the probes, by their weights.
  double color_residuals() const {
    double sum = 0;
    for (const Moments& m : side) sum += m.weight * m.color_residual();
    return sum;
  }
  double plane_residuals() const {
    double sum = 0;
    for (const Moments& m : side) {
      if (m.n == 0) continue;
      Moments sheet;
      for (const Moments& other : side) {
        const double cosine = m.normal.normalized().dot(other.normal.normalized());
        if (other.n > 0 && cosine >= PoissonDisk::kOpposedCosine) sheet.add(other);
      }
      sum += m.weight * sheet.plane_residual();
    }
    return sum;
  }
};

/// A probe or piece of border by the leaf that it is in.
struct Sorted {
  Array<std::uint64_t> code;
  Array<std::uint32_t> order;
};

template <class T, class Place>
Sorted sort_into_leaves(const std::vector<T>& things, const Vec3f& low, double leaf_side,
                        const Place& place) {
  Array<std::uint64_t> code(things.size());
  for (std::size_t i = 0; i < things.size(); ++i) {
    const Vec3d cell = ((place(things[i]) - low).template cast<double>() / leaf_side).cwiseMax(0);
    code[i] =
        morton_code(static_cast<std::uint32_t>(cell.x()), static_cast<std::uint32_t>(cell.y()),
                    static_cast<std::uint32_t>(cell.z()));
  }
  Array<std::uint32_t> order = sort_keys(code);
  return {std::move(code), std::move(order)};
}

double total_weight(const std::vector<SurfaceProbe>& probes) {
  double sum = 0;
  for (const SurfaceProbe& probe : probes) sum += probe.weight;
  return sum;
}

}  // namespace

/// Makes the nodes, children before their parents.
class DetailTree::Builder {
 public:
  Builder(const std::vector<SurfaceProbe>& probes, const std::vector<BorderPiece>& border,
          const Vec3f& low, DetailTree& tree)
      : probes_(probes),
        border_(border),
        low_(low),
        tree_(tree),
        probe_(sort_into_leaves(probes, low, tree.leaf_side_,
                                [](const SurfaceProbe& p) { return p.position; })),
        piece_(sort_into_leaves(border, low, tree.leaf_side_,
                                [](const BorderPiece& b) { return b.middle; })),
        area_per_weight_(tree.options_.area / total_weight(probes)) {}

  void build(int levels) { node(0, levels, 0, probes_.size()); }

 private:
  /// The cell of `level` from the Morton code `code` on, which holds the probes [begin, end).
  CellMoments node(std::uint64_t code, int level, std::size_t begin, std::size_t end) {
    const auto first = static_cast<std::uint32_t>(tree_.node_.size());
    CellMoments moments;
    Errors children;
    if (level == 0) {
      for (std::size_t i = begin; i < end; ++i) {
        const SurfaceProbe& probe = probes_[probe_.order[i]];
        moments.side[side_of(probe.normal)].add(about_low(probe));
      }
      moments.border = border_length(code);
    } else {
      const std::uint64_t step = std::uint64_t{1} << (3 * (level - 1));
      for (std::uint64_t k = 0; k < 8; ++k) {
        const std::size_t stop = upper(begin, end, code + (k + 1) * step);
        if (stop == begin) continue;
        moments.add(node(code + k * step, level - 1, begin, stop));
        children.color += tree_.node_.back().own.color;
        children.shape += tree_.node_.back().own.shape;
        begin = stop;
      }
    }
    add_node(code, level, first, moments, children);
    return moments;
  }

  void add_node(std::uint64_t code, int level, std::uint32_t first, const CellMoments& moments,
                const Errors& children) {
    Node node{corner(code),     level, first, area_per_weight_ * moments.weight(),
              moments.probes(), {},    {}};
    const double sigma = tree_.side(level) / kCellSigmas;
    node.own.color = area_per_weight_ * moments.color_residuals();
    const double unit2 = tree_.options_.unit_deviation * tree_.options_.unit_deviation;
    const double strip = moments.border * sigma / 2;
    node.own.shape = (area_per_weight_ * moments.plane_residuals() + strip * sigma * sigma) / unit2;
    node.halved = {std::sqrt(node.own.color * children.color),
                   std::sqrt(node.own.shape * children.shape)};
    tree_.node_.push_back(node);
  }

  SurfaceProbe about_low(const SurfaceProbe& probe) const {
    SurfaceProbe moved = probe;
    moved.position -= low_;
    return moved;
  }

  std::size_t upper(std::size_t begin, std::size_t end, std::uint64_t code) const {
    const auto from = probe_.code.begin();
    return static_cast<std::size_t>(std::lower_bound(from + static_cast<std::ptrdiff_t>(begin),
                                                     from + static_cast<std::ptrdiff_t>(end),
                                                     code) -
                                    from);
  }

  double border_length(std::uint64_t leaf) const {
    const auto [from, to] = std::equal_range(piece_.code.begin(), piece_.code.end(), leaf);
    double sum = 0;
    for (auto i = from; i != to; ++i) {
      sum += border_[piece_.order[static_cast<std::size_t>(i - piece_.code.begin())]].length;
    }
    return sum;
  }

  Vec3f corner(std::uint64_t code) const {
    Vec3d cell = Vec3d::Zero();
    for (int bit = 0; bit < 21; ++bit) {
      for (int axis = 0; axis < 3; ++axis) {
        cell[axis] += static_cast<double>((code >> (3 * bit + axis) & 1) << bit);
      }
    }
    return low_ + (cell * tree_.leaf_side_).cast<float>();
  }

  const std::vector<SurfaceProbe>& probes_;
  const std::vector<BorderPiece>& border_;
  Vec3f low_;
  DetailTree& tree_;
  Sorted probe_;
  Sorted piece_;
  double area_per_weight_;
};

std::vector<std::string> DetailTree::Options::problems() const {
  std::vector<std::string> found;
  check_positive(found, "area", area);
  check_positive(found, "probe_spacing", probe_spacing);
  check_positive(found, "unit_deviation", unit_deviation);
  check_positive(found, "variance_scale", variance_scale);
  return found;
}

DetailTree::DetailTree(const std::vector<SurfaceProbe>& probes,
                       const std::vector<BorderPiece>& border, const Options& options)
    : options_(options), leaf_side_(kCellSigmas * options.probe_spacing) {
  require_usable(options);
  if (probes.empty()) throw_usage("a detail tree needs one probe at least");
  Vec3f low = probes.front().position;
  Vec3f high = low;
  for (const SurfaceProbe& probe : probes) {
    low = low.cwiseMin(probe.position);
    high = high.cwiseMax(probe.position);
  }
  // Both octrees hold everything, one of them from a third of its side on.
  const double extent = 1.5 * (high - low).cast<double>().maxCoeff();
  leaf_side_ = std::max(leaf_side_, extent * 0x1p-20);  // Codes have 21 bits an axis.
  const auto cells = static_cast<std::uint64_t>(extent / leaf_side_) + 1;
  const auto levels = static_cast<int>(std::bit_width(cells - 1));
  const auto shift = static_cast<float>(side(levels) / 3);
  Builder(probes, border, low, *this).build(levels);
  Builder(probes, border, low - Vec3f::Constant(shift), *this).build(levels);
}

double DetailTree::Cut::error() const {
  return std::sqrt(color_error * color_error + shape_error * shape_error);
}

double DetailTree::measured_area() const { return kOctrees * options_.area; }

double DetailTree::side(int level) const { return std::ldexp(leaf_side_, level); }

double DetailTree::spacing(const Node& node) const {
  return side(node.level) / (kCellSigmas * options_.variance_scale);
}

double DetailTree::largest_spacing() const { return spacing(node_.back()); }

void DetailTree::add_cells(std::size_t index, float spacing, int levels,
                           std::vector<SizingCell>& cells) const {
  const Node& node = node_[index];
  double below = 0;
  for (std::size_t child = index; child > node.first; child = node_[child - 1].first) {
    below += node_[child - 1].own.sum();
  }
  if (levels == 0 || below <= 0) {
    const auto extent = static_cast<float>(side(node.level));
    cells.push_back({node.min, node.min + Vec3f::Constant(extent), spacing});
    return;
  }
  for (std::size_t child = index; child > node.first; child = node_[child - 1].first) {
    const Node& part = node_[child - 1];
    if (part.own.sum() * node.area >= kIdleShare * below * part.area) {
      add_cells(child - 1, spacing, levels - 1, cells);
    }
  }
}

DetailTree::Cut DetailTree::cut(double price) const {
  std::vector<Choice> choice(node_.size());
  std::vector<double> cost(node_.size());
  for (std::size_t i = 0; i < node_.size(); ++i) {
    const Node& node = node_[i];
    const double h = spacing(node);
    const double samples = node.area / (h * h);
    choice[i] = Choice::kOwn;
    cost[i] = node.own.sum() / measured_area() + price * samples;
    if (node.level == 0) {
      if (options_.keep && price * node.probes < cost[i]) {
        choice[i] = Choice::kKeep;
        cost[i] = price * node.probes;
      }
      continue;
    }
    const double halved = node.halved.sum() / measured_area() + price * 2 * samples;
    if (halved < cost[i]) {
      choice[i] = Choice::kHalved;
      cost[i] = halved;
    }
    double divided = 0;
    for (std::size_t child = i; child > node.first; child = node_[child - 1].first) {
      divided += cost[child - 1];
    }
    if (divided < cost[i]) {
      choice[i] = Choice::kDivide;
      cost[i] = divided;
    }
  }
  Cut out;
  // From the last root on; whole subtrees are passed over.
  for (std::size_t i = node_.size(); i > 0;) {
    const Node& node = node_[i - 1];
    if (choice[i - 1] == Choice::kDivide) {
      --i;
      continue;
    }
    if (choice[i - 1] == Choice::kKeep) {
      add_cells(i - 1, static_cast<float>(kKeptSpacing * spacing(node)), 0, out.cells);
      out.samples += node.probes / kOctrees;
      out.finest_samples += node.probes / kOctrees;
      i = node.first;
      continue;
    }
    const bool halved = choice[i - 1] == Choice::kHalved;
    const double h = spacing(node) * (halved ? std::numbers::sqrt2 / 2 : 1);
    const Errors& errors = halved ? node.halved : node.own;
    add_cells(i - 1, static_cast<float>(h), kTrimmedLevels, out.cells);
    const double samples = node.area / (h * h) / kOctrees;
    out.samples += samples;
    if (node.level == 0) out.finest_samples += samples;
    out.color_error += errors.color;
    out.shape_error += errors.shape;
    i = node.first;
  }
  out.color_error = std::sqrt(out.color_error / measured_area());
  out.shape_error = std::sqrt(out.shape_error / measured_area());
  return out;
}

double DetailTree::highest_price() const {
  // The roots alone are the cheapest even if dividing removed their error.
  const double h = largest_spacing();
  const Node& one = node_[node_.back().first - 1];
  const double error = std::max(one.own.sum(), node_.back().own.sum());
  return (error / measured_area() + 1e-300) / (one.area / (h * h));
}

double DetailTree::lowest_price() const {
  const double finest = options_.probe_spacing / options_.variance_scale;
  return 1e-12 * highest_price() * (finest * finest) / (largest_spacing() * largest_spacing());
}

}  // namespace surfel
