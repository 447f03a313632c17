#include <algorithm>
#include <limits>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/plugin.h>
#include <surfel/solve/ceres_solver.h>

namespace surfel {

CeresReport ceres_least_squares(std::initializer_list<LeastSquaresTerm> terms, int channels,
                                double tolerance, Array<Channels>& w) {
  CeresReport report;
  if (w.empty()) return report;
  static const auto solve = reinterpret_cast<CeresSolveLeastSquares*>(
      plugin_symbol("ceres", kCeresSolveLeastSquaresSymbol));
  CeresLeastSquares raw;
  std::vector<CeresTerm> raw_terms;
  for (const LeastSquaresTerm& term : terms) {
    raw_terms.push_back({.rows = term.A.rows(),
                         .row_begin = term.A.row_begin.data(),
                         .column = term.A.column.data(),
                         .value = term.A.value.data(),
                         .f = reinterpret_cast<const double*>(term.f.data()),
                         .weight = term.weight,
                         .huber = term.huber});
    raw.max_iterations = std::max(raw.max_iterations, term.huber > 0 ? 200 : 20);
  }
  raw.term = raw_terms.data();
  raw.terms = raw_terms.size();
  raw.columns = w.size();
  raw.channels = channels;
  raw.stride = 4;
  raw.tolerance = tolerance;
  raw.w = reinterpret_cast<double*>(w.data());
  solve(raw, report);
  return report;
}

CeresReport ceres_solve(const SymmetricMatrix& matrix, const Array<Channels>& b, int channels,
                        double tolerance, Array<Channels>& x) {
  const SparseMatrix rows = both_triangles(matrix);
  return ceres_least_squares({{.A = rows, .f = b}}, channels, tolerance, x);
}

CeresReport ceres_minimize(
    Array<double>& x, FunctionRef<bool(const double* x, double* cost, double* gradient)> evaluate,
    double tolerance, int max_iterations) {
  using Evaluate = FunctionRef<bool(const double*, double*, double*)>;
  CeresReport report;
  if (x.empty()) return report;
  if (x.size() > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    throw Error(
        ErrorKind::kNumeric,
        fmt::format("{} unknowns are more than Ceres can count; take fewer surfels", x.size()));
  }
  static const auto minimize =
      reinterpret_cast<CeresMinimize*>(plugin_symbol("ceres", kCeresMinimizeSymbol));
  CeresMinimization raw;
  raw.size = x.size();
  raw.x = x.data();
  raw.evaluate = [](void* self, const double* at, double* cost, double* gradient) {
    return (*static_cast<Evaluate*>(self))(at, cost, gradient);
  };
  raw.self = &evaluate;
  raw.tolerance = tolerance;
  raw.max_iterations = max_iterations;
  minimize(raw, report);
  return report;
}

CeresReport ceres_move_bodies(std::span<const PlaneMatch> matches, double scale,
                              std::span<BodyMotion> motion) {
  CeresReport report;
  if (matches.empty() || motion.size() < 2) return report;
  static const auto move =
      reinterpret_cast<CeresMoveBodies*>(plugin_symbol("ceres", kCeresMoveBodiesSymbol));
  CeresBodies raw;
  raw.match = matches.data();
  raw.matches = matches.size();
  raw.motion = motion.data();
  raw.bodies = motion.size();
  raw.scale = scale;
  move(raw, report);
  return report;
}

}  // namespace surfel
