// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", equation (9) and section 5.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/group_by_key.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/solve/column_map.h>
#include <surfel/solve/range_sums.h>
#include <surfel/surface/voronoi_cell.h>
#include <surfel/texture/reach_tree.h>
#include <surfel/texture/render_system.h>

namespace surfel {
namespace {

constexpr std::size_t kPointGrain = 1 << 11;
/// Least cosine between the normals of a point and of a function that takes part there.
constexpr double kActiveCosine = 0.5;
/// Functions whose distance is less than this share of a cell's largest extent share their cell.
constexpr double kCoincident = 1e-6;
/// Variance of the points' filter, as a share of the area of their cell: a smaller one lets in
/// detail that functions cannot hold, a larger one costs sharpness.
constexpr double kCellVariance = 0.0625;
/// The least, by the area that each point stands for: no detail may fall between them.
constexpr double kPointVariance = 0.25;

/// The cell of a function that has no neighbours: an octagon, drawn out as V is.
/// \return the distance of its furthest corner.
double reset_cell(const SurfelBasis::Function& f, VoronoiCell& cell) {
  const double half = kBorderReach * std::sqrt(f.area);
  const double stretch = portable::pow(f.variance_u / f.variance_v, 0.25);
  const Vec2d half_axes(half * stretch, half / stretch);
  cell.reset(half_axes.maxCoeff());
  cell.cut({2 * half_axes.x(), 0});
  cell.cut({-2 * half_axes.x(), 0});
  cell.cut({0, 2 * half_axes.y()});
  cell.cut({0, -2 * half_axes.y()});
  // Tangents to the ellipse half-way between its axes.
  const Vec2d normal = Vec2d(1 / half_axes.x(), 1 / half_axes.y()).normalized();
  const double distance = half_axes.cwiseProduct(normal).norm();
  for (const Vec2d& sign : {Vec2d(1, 1), Vec2d(-1, 1), Vec2d(-1, -1), Vec2d(1, -1)}) {
    cell.cut(2 * distance * normal.cwiseProduct(sign));
  }
  return cell.radius();
}

/// Places this far beyond a line, in standard deviations, lie on it: what is on an edge belongs to
/// either side, however coordinates were rounded.
constexpr double kOnLine = 1e-3;

/// Cuts the function's cell out of its tangent plane.
void cut_cell(const SurfelBasis& basis, const ReachTree& tree, std::size_t i, VoronoiCell& cell) {
  const SurfelBasis::Function& f = basis.function[i];
  const double radius = reset_cell(f, cell);
  const double least2 = kCoincident * kCoincident * radius * radius;
  tree.meeting(f.position, 2 * radius, [&](std::size_t k) {
    const SurfelBasis::Function& other = basis.function[k];
    const Vec3d d = other.position - f.position;
    const Vec2d flat(d.dot(f.tangent), d.dot(f.bitangent));
    const double height = d.dot(f.normal);
    const double flat2 = flat.squaredNorm();
    if (f.normal.dot(other.normal) < 0 || height * height > flat2) return;
    if (flat2 > least2 && flat2 <= 4 * cell.radius2()) cell.cut(flat);
  });
  if (basis.cut.empty()) return;
  for (const SurfelBasis::Cut& line : basis.cut[i]) {
    // The bisector of the function and its mirror image.
    if (line.distance > 0) cell.cut(2 * line.distance * line.direction);
  }
}

/// A function as the points of one owner see it: all terms of it are affine in their offsets (x,
/// y), value = c . (1, x, y).
struct SeenFunction {
  std::uint32_t index;
  Vec3d u, v;   ///< Plane coordinates of a place, in the function's standard deviations.
  Vec3d depth;  ///< Depth of that place along the owner's normal.
  double max_depth;
  double peak;  ///< r_k at its centre.
};

/// \return whether the two may lie on one sheet by their normals.
bool see(const SurfelBasis::Function& owner, const SurfelBasis::Function& f, double cutoff,
         SeenFunction& seen) {
  const double cosine = owner.normal.dot(f.normal);
  if (cosine < kActiveCosine) return false;
  // The line (position + x tangent + y bitangent) + depth normal meets the function's plane.
  const Vec3d d = owner.position - f.position;
  seen.depth =
      -Vec3d(d.dot(f.normal), owner.tangent.dot(f.normal), owner.bitangent.dot(f.normal)) / cosine;
  const auto along = [&](const Vec3d& axis, double variance) {
    const Vec3d on_plane(d.dot(axis), owner.tangent.dot(axis), owner.bitangent.dot(axis));
    return Vec3d((on_plane + seen.depth * owner.normal.dot(axis)) / std::sqrt(variance));
  };
  seen.u = along(f.tangent, f.variance_u);
  seen.v = along(f.bitangent, f.variance_v);
  seen.max_depth = reach_of(f, cutoff);
  seen.peak = f.peak();
  return true;
}

/// The half-planes of a function as the points of one owner see them: a point is cut off where
/// c . (1, x, y) > 0.
using SeenCuts = std::array<Vec3d, 2>;

SeenCuts see_cuts(const SurfelBasis::Function& f, const std::array<SurfelBasis::Cut, 2>& cuts,
                  const Vec3d& u, const Vec3d& v) {
  SeenCuts seen;
  const double deviation_u = std::sqrt(f.variance_u);
  const double deviation_v = std::sqrt(f.variance_v);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    const Vec2d& direction = cuts[k].direction;
    seen[k] = direction.x() * deviation_u * u + direction.y() * deviation_v * v;
    seen[k][0] -= cuts[k].distance + kOnLine * std::max(deviation_u, deviation_v);
  }
  return seen;
}

bool cut_off(const SeenCuts& cuts, const Vec3d& at) {
  return cuts[0].dot(at) > 0 || cuts[1].dot(at) > 0;
}

/// The kernel at a point as the assembler writes it.
enum class Entry { kNormalised, kExponent };

/// Rows that one range of a loop has made, one after the other.
struct RowChunk {
  Array<std::uint64_t> row_end;  ///< Counted from the chunk's first entry.
  Array<std::uint32_t> column;
  Array<double> value;
  Array<float> coverage;  ///< Coverage of every row, if it was asked for.

  void add(std::uint32_t c, double v) {
    column.push_back(c);
    value.push_back(v);
  }
  void end_row() { row_end.push_back(column.size()); }
  /// The rows added so far, no larger than they must be; the memory is kept for the next range.
  RowChunk take() {
    RowChunk taken = *this;
    row_end.clear();
    column.clear();
    value.clear();
    coverage.clear();
    return taken;
  }
};

/// Puts chunks together, and frees them on the way.
SparseMatrix join(std::vector<RowChunk> chunks, std::size_t columns) {
  std::vector<std::uint64_t> first_row{0};
  std::vector<std::uint64_t> first_entry{0};
  for (const RowChunk& chunk : chunks) {
    first_row.push_back(first_row.back() + chunk.row_end.size());
    first_entry.push_back(first_entry.back() + chunk.column.size());
  }
  SparseMatrix matrix;
  matrix.columns = columns;
  matrix.row_begin.resize(first_row.back() + 1);
  matrix.row_begin[0] = 0;
  matrix.column.resize(first_entry.back());
  matrix.value.resize(first_entry.back());
  parallel_for(chunks.size(), 1, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t c = begin; c < end; ++c) {
      const RowChunk chunk = std::move(chunks[c]);
      for (std::size_t row = 0; row < chunk.row_end.size(); ++row) {
        matrix.row_begin[first_row[c] + row + 1] = first_entry[c] + chunk.row_end[row];
      }
      std::copy(chunk.column.begin(), chunk.column.end(), matrix.column.begin() + first_entry[c]);
      std::copy(chunk.value.begin(), chunk.value.end(), matrix.value.begin() + first_entry[c]);
    }
  });
  return matrix;
}

std::size_t chunk_count(std::size_t count) { return (count + kPointGrain - 1) / kPointGrain; }

/// Evaluates a basis at points.
class Assembler {
 public:
  Assembler(const SurfelBasis& basis, const Quadrature& quadrature, double cutoff,
            Entry entry = Entry::kNormalised)
      : basis_(basis),
        quadrature_(quadrature),
        cutoff_(cutoff),
        entry_(entry),
        tree_(basis, kPlanarReach2 * cutoff) {}

  EvaluatedBasis run() {
    EvaluatedBasis result;
    result.point_begin = quadrature_.begin;
    const std::size_t count = basis_.size();
    std::vector<RowChunk> rows(chunk_count(count));
    std::vector<RowChunk> reaching(rows.size());
    std::vector<std::size_t> uncovered(rows.size());
    PerWorker<Worker> workers;
    parallel_for(count, kPointGrain, [&](std::size_t begin, std::size_t end, int w) {
      Worker& worker = workers[w];
      const std::size_t chunk = begin / kPointGrain;
      for (std::size_t i = begin; i < end; ++i) {
        if ((i - begin) % kOwners == 0) find_candidates(i, std::min(end, i + kOwners), worker);
        uncovered[chunk] += add_rows(i, worker);
      }
      rows[chunk] = worker.rows.take();
      reaching[chunk] = worker.reaching.take();
    });
    for (const std::size_t n : uncovered) result.uncovered += n;
    result.coverage.reserve(quadrature_.size());
    for (const RowChunk& chunk : rows) {
      result.coverage.insert(result.coverage.end(), chunk.coverage.begin(), chunk.coverage.end());
    }
    result.A = join(std::move(rows), count);
    transpose(reaching, result);
    return result;
  }

 private:
  static constexpr std::size_t kOwners = 4;  ///< Owners that share a search; divides kPointGrain.

  struct Candidate {
    Vec3d position;
    double reach;
    std::uint32_t index;
  };
  struct Worker {
    std::vector<Candidate> candidates;
    std::vector<SeenFunction> seen;
    std::vector<SeenCuts> cuts;  ///< Of every function seen, where some function is cut.
    std::vector<char> reaches;
    RowChunk rows;
    RowChunk reaching;
  };

  /// Adds the rows of one owner's points, and a row of the functions that reach any of them.
  /// \return the number of uncovered points.
  std::size_t add_rows(std::size_t i, Worker& worker) const {
    auto& [candidates, seen, cuts, reaches, rows, reaching] = worker;
    const SurfelBasis::Function& owner = basis_.function[i];
    const std::size_t begin = quadrature_.begin[i];
    const std::size_t end = quadrature_.begin[i + 1];
    find_seen(owner, std::sqrt(radius2_of(i)), worker);
    const bool is_cut = !basis_.cut.empty();
    const SeenCuts own = is_cut ? own_cuts(i) : SeenCuts{};
    std::size_t uncovered = 0;
    for (std::size_t q = begin; q < end; ++q) {
      const Vec3d at(1, quadrature_.offset[q].x(), quadrature_.offset[q].y());
      const std::size_t first = rows.value.size();
      double sum = 0;
      const bool off = is_cut && cut_off(own, at);
      for (std::size_t s = 0; s < seen.size() && !off; ++s) {
        const SeenFunction& f = seen[s];
        const double u = f.u.dot(at);
        const double v = f.v.dot(at);
        const double beta = 0.5 * (u * u + v * v);
        if (!(beta < cutoff_) || std::abs(f.depth.dot(at)) > f.max_depth) continue;
        if (is_cut && cut_off(cuts[s], at)) continue;
        const double r = f.peak * portable::exp(-beta);
        rows.add(f.index, entry_ == Entry::kNormalised ? r : beta);
        reaches[s] = 1;
        sum += r;
      }
      if (entry_ == Entry::kNormalised) {
        for (std::size_t e = first; e < rows.value.size(); ++e) rows.value[e] /= sum;
      }
      rows.coverage.push_back(static_cast<float>(sum));
      if (rows.value.size() == first) ++uncovered;
      rows.end_row();
    }
    for (std::size_t s = 0; s < seen.size(); ++s) {
      if (reaches[s]) reaching.column.push_back(seen[s].index);
    }
    reaching.end_row();
    return uncovered;
  }

  /// The half-planes of an owner as its own points see them.
  SeenCuts own_cuts(std::size_t i) const {
    const SurfelBasis::Function& f = basis_.function[i];
    return see_cuts(f, basis_.cut[i], Vec3d(0, 1 / std::sqrt(f.variance_u), 0),
                    Vec3d(0, 0, 1 / std::sqrt(f.variance_v)));
  }

  /// The functions that may reach a point within `radius` of the owner.
  void find_seen(const SurfelBasis::Function& owner, double radius, Worker& worker) const {
    worker.seen.clear();
    worker.cuts.clear();
    for (const Candidate& candidate : worker.candidates) {
      const double limit = radius + candidate.reach;
      if ((candidate.position - owner.position).squaredNorm() > limit * limit) continue;
      SeenFunction seen;
      if (!see(owner, basis_.function[candidate.index], cutoff_, seen)) continue;
      // By how much at most (u, v) changes from the owner's position to a point.
      const double change =
          radius * std::sqrt(seen.u.tail<2>().squaredNorm() + seen.v.tail<2>().squaredNorm());
      const double nearest = std::sqrt(seen.u[0] * seen.u[0] + seen.v[0] * seen.v[0]) - change;
      if (nearest > 0 && nearest * nearest > 2 * cutoff_) continue;
      seen.index = candidate.index;
      worker.seen.push_back(seen);
      if (basis_.cut.empty()) continue;
      worker.cuts.push_back(
          see_cuts(basis_.function[candidate.index], basis_.cut[candidate.index], seen.u, seen.v));
    }
    worker.reaches.assign(worker.seen.size(), 0);
  }

  /// The furthest of a function's points, squared.
  double radius2_of(std::size_t i) const {
    double radius2 = 0;
    for (std::size_t q = quadrature_.begin[i]; q < quadrature_.begin[i + 1]; ++q) {
      radius2 = std::max(radius2, quadrature_.offset[q].cast<double>().squaredNorm());
    }
    return radius2;
  }

  /// The functions that may reach any point of the owners [begin, end), in ascending order:
  /// neighbours in the order share one descent of the tree.
  void find_candidates(std::size_t begin, std::size_t end, Worker& worker) const {
    Vec3d min = basis_.function[begin].position;
    Vec3d max = min;
    for (std::size_t i = begin; i < end; ++i) {
      min = min.cwiseMin(basis_.function[i].position);
      max = max.cwiseMax(basis_.function[i].position);
    }
    const Vec3d center = (min + max) / 2;
    double radius = 0;
    for (std::size_t i = begin; i < end; ++i) {
      radius = std::max(radius,
                        (basis_.function[i].position - center).norm() + std::sqrt(radius2_of(i)));
    }
    worker.candidates.clear();
    tree_.meeting(center, radius * (1 + 1e-9), [&](std::size_t k) {
      const SurfelBasis::Function& f = basis_.function[k];
      worker.candidates.push_back(
          {f.position, reach_of(f, kPlanarReach2 * cutoff_), static_cast<std::uint32_t>(k)});
    });
  }

  void transpose(const std::vector<RowChunk>& reaching, EvaluatedBasis& result) const {
    Grouped<std::uint32_t> owners =
        group_by_key<std::uint32_t>(basis_.size(), [&](const auto& add) {
          std::uint32_t i = 0;
          for (const RowChunk& chunk : reaching) {
            std::size_t e = 0;
            for (const std::uint64_t end : chunk.row_end) {
              for (; e < end; ++e) add(chunk.column[e], i);
              ++i;
            }
          }
        });
    result.owner_begin = std::move(owners.begin);
    result.owner = std::move(owners.item);
  }

  const SurfelBasis& basis_;
  const Quadrature& quadrature_;
  double cutoff_;
  Entry entry_;
  ReachTree tree_;
};

/// Calls body(q, e) for every entry e of A in column k, q being its row, in ascending order.
template <class Body>
void for_column(const EvaluatedBasis& basis, std::size_t k, const Body& body) {
  const SparseMatrix& A = basis.A;
  for (std::size_t o = basis.owner_begin[k]; o < basis.owner_begin[k + 1]; ++o) {
    const std::size_t i = basis.owner[o];
    for (std::size_t q = basis.point_begin[i]; q < basis.point_begin[i + 1]; ++q) {
      for (std::size_t e = A.row_begin[q]; e < A.row_begin[q + 1]; ++e) {
        if (A.column[e] < k) continue;
        if (A.column[e] == k) body(q, e);
        break;
      }
    }
  }
}

/// A sparse row that is summed up.
class RowSum {
 public:
  double& operator[](std::uint32_t column) {
    const std::uint32_t place = map_.number(column);
    if (place == value_.size()) value_.push_back(0.0);
    return value_[place];
  }

  /// Ends the row: adds its entries to `rows` by ascending column, and starts the next one.
  void move_to(RowChunk& rows) {
    order_.resize(map_.size());
    std::iota(order_.begin(), order_.end(), 0U);
    const std::vector<std::uint32_t>& column = map_.columns();
    std::sort(order_.begin(), order_.end(),
              [&](std::uint32_t a, std::uint32_t b) { return column[a] < column[b]; });
    for (const std::uint32_t place : order_) rows.add(column[place], value_[place]);
    rows.end_row();
    map_.clear();
    value_.clear();
  }

 private:
  ColumnMap map_;
  std::vector<double> value_;  ///< Values by the column's number.
  std::vector<std::uint32_t> order_;
};

/// A^T A, or A^T D A with the diagonal D of `weight` if that is not null, + mu B^T B.
SymmetricMatrix normal_product(const RenderSystem& system, const Array<double>* weight = nullptr) {
  const std::size_t columns = system.near.A.columns;
  struct Worker {
    RowSum row;
    RowChunk rows;
  };
  PerWorker<Worker> workers;
  std::vector<RowChunk> chunks(chunk_count(columns));
  parallel_for(columns, kPointGrain, [&](std::size_t begin, std::size_t end, int w) {
    auto& [row, rows] = workers[w];
    for (std::size_t k = begin; k < end; ++k) {
      // The diagonal is there even where it is zero: lambda is added to it.
      row[static_cast<std::uint32_t>(k)] = 0;
      const auto add = [&, &row = row](const EvaluatedBasis& basis, const auto& weight_of) {
        const SparseMatrix& A = basis.A;
        for_column(basis, k, [&](std::size_t q, std::size_t entry) {
          const double d = weight_of(q);
          for (std::size_t e = A.row_begin[q]; e <= entry; ++e) {
            row[A.column[e]] += d * (A.value[entry] * A.value[e]);
          }
        });
      };
      add(system.near, [&](std::size_t q) { return weight ? (*weight)[q] : 1; });
      if (system.mu > 0) add(system.far, [&](std::size_t) { return system.mu; });
      row.move_to(rows);
    }
    chunks[begin / kPointGrain] = rows.take();
  });
  SparseMatrix lower = join(std::move(chunks), columns);
  return {std::move(lower.row_begin), std::move(lower.column), std::move(lower.value)};
}

/// Share of its variance that a Gaussian keeps where it is cut off at beta = cutoff.
double kept_variance(double cutoff) { return 1 - cutoff / portable::expm1(cutoff); }

/// The functions on screen where the pixel filter, truncated, is as wide as they.
SurfelBasis minified(const SurfelBasis& basis, double cutoff) {
  const double widening = 1 + 1 / kept_variance(cutoff);
  SurfelBasis wide;
  wide.function = basis.function;
  wide.cut = basis.cut;
  for (SurfelBasis::Function& f : wide.function) {
    f.variance_u *= widening;
    f.variance_v *= widening;
  }
  return wide;
}

/// The bases from near and from far, and the weight of the latter.
RenderSystem evaluate_bases(const SurfelBasis& basis, const Quadrature& quadrature,
                            const RenderSystemOptions& options) {
  RenderSystem system;
  system.near = Assembler(basis, quadrature, options.cutoff).run();
  if (options.minified > 0 && basis.size() > 0) {
    system.mu = options.minified * static_cast<double>(quadrature.size()) /
                static_cast<double>(basis.size());
    const SurfelBasis wide = minified(basis, options.cutoff);
    const Quadrature centers = at_functions(wide);
    system.far = Assembler(wide, centers, options.cutoff).run();
  }
  return system;
}

}  // namespace

Quadrature cover_surface(const SurfelBasis& basis, int points) {
  if (points < 1 || points > 256) {
    throw_usage(fmt::format("`points` is {}; it must be in 1..256", points));
  }
  const auto m = static_cast<std::size_t>(points);
  Quadrature quadrature;
  quadrature.begin.resize(basis.size() + 1);
  quadrature.offset.resize(basis.size() * m);
  quadrature.variance.resize(basis.size());
  for (std::size_t i = 0; i <= basis.size(); ++i) quadrature.begin[i] = i * m;

  const ReachTree tree(basis, 0);
  PerWorker<VoronoiCell> cells;
  parallel_for(basis.size(), kPointGrain, [&](std::size_t begin, std::size_t end, int worker) {
    VoronoiCell& cell = cells[worker];
    for (std::size_t i = begin; i < end; ++i) {
      cut_cell(basis, tree, i, cell);
      quadrature.variance[i] =
          static_cast<float>(std::max(kCellVariance, kPointVariance / points) * cell.area());
      // Kronecker sequence of the golden ratio.
      for (std::size_t q = 0; q < m; ++q) {
        const auto n = static_cast<double>(q);
        const double s = (n + 0.5) / points;
        const double t = std::fmod(0.5 + n / std::numbers::phi, 1.0);
        quadrature.offset[i * m + q] = cell.point(s, t).cast<float>();
      }
    }
  });
  return quadrature;
}

Quadrature at_functions(const SurfelBasis& basis) {
  Quadrature quadrature;
  quadrature.begin.resize(basis.size() + 1);
  for (std::size_t i = 0; i <= basis.size(); ++i) quadrature.begin[i] = i;
  quadrature.offset.assign(basis.size(), Vec2f::Zero());
  quadrature.variance.assign(basis.size(), 0.0F);
  return quadrature;
}

std::vector<std::string> RenderSystemOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, cutoff >= 0.1 && cutoff <= 16, "cutoff", cutoff, "in 0.1..16");
  check_option(found, minified >= 0 && minified <= 1e6, "minified", minified, "in 0..1e6");
  check_option(found, regularization > 0 && regularization <= 1e6, "regularization", regularization,
               "in (0, 1e6]");
  if (lambda) check_positive(found, "lambda", *lambda);
  return found;
}

EvaluatedBasis evaluate_basis(const SurfelBasis& basis, const Quadrature& quadrature,
                              double cutoff) {
  return Assembler(basis, quadrature, cutoff).run();
}

RenderMeasure measure_render_system(const SurfelBasis& basis, const Quadrature& quadrature,
                                    const RenderSystemOptions& options,
                                    FunctionRef<bool(std::size_t i)> owns) {
  const RenderSystem system = evaluate_bases(basis, quadrature, options);
  Array<std::uint8_t> own(basis.size());
  RenderMeasure measure;
  for (std::size_t i = 0; i < basis.size(); ++i) {
    own[i] = owns(i) ? 1 : 0;
    if (own[i] == 0) continue;
    ++measure.functions;
    measure.points += quadrature.begin[i + 1] - quadrature.begin[i];
  }
  const auto squares = [&](const SparseMatrix& A) {
    double sum = 0;
    for (std::size_t e = 0; e < A.value.size(); ++e) {
      if (own[A.column[e]] != 0) sum += A.value[e] * A.value[e];
    }
    return sum;
  };
  measure.near = squares(system.near.A);
  measure.far = squares(system.far.A);
  return measure;
}

RenderSystem assemble_render_system(const SurfelBasis& basis, const Quadrature& quadrature,
                                    const RenderSystemOptions& options) {
  require_usable(options);
  RenderSystem system = evaluate_bases(basis, quadrature, options);
  const RenderMeasure& whole = options.whole;
  if (whole.functions > 0) {
    const auto functions = static_cast<double>(whole.functions);
    if (options.minified > 0) {
      system.mu = options.minified * static_cast<double>(whole.points) / functions;
    }
    system.normal_matrix = normal_product(system);
    system.mean_diagonal = (whole.near + system.mu * whole.far) / functions;
  } else {
    system.normal_matrix = normal_product(system);
    if (basis.size() > 0) {
      system.mean_diagonal = system.normal_matrix.trace() / static_cast<double>(basis.size());
    }
  }
  const double mean = system.mean_diagonal;
  system.lambda = options.lambda.value_or(options.regularization * (mean > 0 ? mean : 1));
  for (std::size_t k = 0; k < basis.size(); ++k) system.normal_matrix.diagonal(k) += system.lambda;
  return system;
}

Channels EvaluatedBasis::residual(std::size_t q, const Array<Channels>& w,
                                  const Array<Channels>& f) const {
  if (A.row_begin[q] == A.row_begin[q + 1]) return Channels::Zero();
  Channels r = -f[q];
  for (std::size_t e = A.row_begin[q]; e < A.row_begin[q + 1]; ++e) {
    r += A.value[e] * w[A.column[e]];
  }
  return r;
}

Array<Channels> EvaluatedBasis::residuals(const Array<Channels>& w,
                                          const Array<Channels>& f) const {
  Array<Channels> residual(A.rows());
  parallel_for(A.rows(), kPointGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t q = begin; q < end; ++q) residual[q] = this->residual(q, w, f);
  });
  return residual;
}

Channels EvaluatedBasis::residual2(const Array<Channels>& w, const Array<Channels>& f) const {
  return sum_of(A.rows(), kPointGrain,
                [&](std::size_t q) -> Channels { return this->residual(q, w, f).square(); });
}

Array<Channels> EvaluatedBasis::multiply_transposed(const Array<Channels>& f) const {
  Array<Channels> product(A.columns);
  parallel_for(A.columns, kPointGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t k = begin; k < end; ++k) {
      Channels sum = Channels::Zero();
      for_column(*this, k, [&](std::size_t q, std::size_t e) { sum += A.value[e] * f[q]; });
      product[k] = sum;
    }
  });
  return product;
}

Array<Channels> RenderSystem::right_side(const Array<Channels>& f,
                                         const Array<Channels>& w_0) const {
  Array<Channels> b = near.multiply_transposed(f);
  for (std::size_t k = 0; k < b.size(); ++k) b[k] += pull(k) * w_0[k];
  if (mu == 0) return b;
  const Array<Channels> minified = far.multiply_transposed(w_0);
  for (std::size_t k = 0; k < b.size(); ++k) b[k] += mu * minified[k];
  return b;
}

Channels RenderSystem::pull2(const Array<Channels>& w, const Array<Channels>& w_0) const {
  return mu * far.residual2(w, w_0) + sum_of(w.size(), kPointGrain, [&](std::size_t k) -> Channels {
           return pull(k) * (w[k] - w_0[k]).square();
         });
}

SymmetricMatrix RenderSystem::weighted_normal_matrix(const Array<double>& weight) const {
  SymmetricMatrix matrix = normal_product(*this, &weight);
  for (std::size_t k = 0; k < matrix.rows(); ++k) matrix.diagonal(k) += pull(k);
  return matrix;
}

SparseMatrix kernel_exponents(const SurfelBasis& basis, const Quadrature& quadrature,
                              double cutoff) {
  return Assembler(basis, quadrature, cutoff, Entry::kExponent).run().A;
}

}  // namespace surfel
