// Solvers of R W = C beside Eigen's and CHOLMOD, on Gram matrices of Gaussians on jittered grids.
// Usage: solver_bench SIDE SIGMA RIDGE [peers]: SIDE x SIDE Gaussians of deviation SIGMA spacings,
// RIDGE added to the unit diagonal; `peers`: the other libraries' solvers too.

#include <Eigen/Sparse>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#ifdef SURFEL_HAVE_CHOLMOD
#include <Eigen/CholmodSupport>
#endif

#include <fmt/format.h>
#include <surfel/base/parallel.h>
#include <surfel/base/timing.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/solve/spectrum.h>

#include "solve/test_systems.h"

namespace {

using namespace surfel;
using namespace surfel::test;

constexpr double kTolerance = 1e-8;

double megabytes(const char* field) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(field)) return std::atof(line.c_str() + std::string(field).size()) / 1024;
  }
  return 0;
}

void print(const std::string& name, double setup, double solve, const std::string& rest) {
  fmt::print("{:<24} set-up {:7.3f} s  solve {:7.3f} s  {}\n", name, setup / 1000, solve / 1000,
             rest);
  std::fflush(stdout);
}

void ours(const System& system, const std::string& name) {
  const double before = megabytes("VmRSS:");
  Timer timer;
  const InverseFactor factor(system.matrix);
  const double setup = timer.milliseconds();
  timer.restart();
  Array<Channels> x(system.b.size(), Channels(0, 0, 0, 0));
  SolveOptions options;
  options.tolerance = kTolerance;
  options.max_iterations = 5000;
  const SolveReport report = conjugate_gradients(system.matrix, system.b, factor, x, options);
  print(name, setup, timer.milliseconds(),
        fmt::format("{} iterations, residual {:.1e}, {:.0f} entries a row, at most {:.0f} MB more",
                    report.iterations, report.residual,
                    static_cast<double>(factor.entries()) / static_cast<double>(factor.rows()),
                    megabytes("VmHWM:") - before));
}

void spectrum(const SymmetricMatrix& matrix) {
  Timer timer;
  const InverseFactor factor(matrix);
  const double setup = timer.milliseconds();
  timer.restart();
  const Spectrum found = estimate_spectrum(matrix, factor);
  print("spectrum", setup, timer.milliseconds(),
        fmt::format("{:.3g} to {:.4g}, condition {:.3g}", found.min, found.max, found.condition()));
}

template <class Solver>
void peer(const Eigen::SparseMatrix<double, Eigen::RowMajor>& matrix, const Eigen::MatrixXd& b,
          const std::string& name, Solver&& solver) {
  const typename std::decay_t<Solver>::MatrixType copy = matrix;
  Timer timer;
  solver.compute(copy);
  const double setup = timer.milliseconds();
  timer.restart();
  const Eigen::MatrixXd x = solver.solve(b);
  const double solve = timer.milliseconds();
  const double residual =
      ((b - matrix * x).colwise().norm().array() / b.colwise().norm().array()).maxCoeff();
  print(name, setup, solve, fmt::format("residual {:.1e}", residual));
}

void peers(const System& system) {
  using Rows = Eigen::SparseMatrix<double, Eigen::RowMajor>;
  using Columns = Eigen::SparseMatrix<double, Eigen::ColMajor>;
  using IncompleteCholesky =
      Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::AMDOrdering<int>>;
  const auto n = static_cast<Eigen::Index>(system.matrix.rows());
  const SparseMatrix both = both_triangles(system.matrix);
  Rows matrix(n, n);
  matrix.reserve(static_cast<Eigen::Index>(system.matrix.entries()));
  for (Eigen::Index i = 0; i < n; ++i) {
    matrix.startVec(i);
    for (std::uint64_t e = both.row_begin[i]; e < both.row_begin[i + 1]; ++e) {
      matrix.insertBack(i, both.column[e]) = both.value[e];
    }
  }
  matrix.finalize();
  const Eigen::MatrixXd b = dense(system.b).leftCols(3);
  constexpr int kBoth = Eigen::Lower | Eigen::Upper;
  Eigen::ConjugateGradient<Rows, kBoth> jacobi;
  jacobi.setTolerance(kTolerance);
  peer(matrix, b, "Eigen CG, Jacobi", jacobi);
  Eigen::ConjugateGradient<Rows, kBoth, IncompleteCholesky> incomplete;
  incomplete.setTolerance(kTolerance);
  peer(matrix, b, "Eigen CG, IC(0)", incomplete);
#ifdef SURFEL_HAVE_CHOLMOD
  peer(matrix, b, "CHOLMOD supernodal LLT", Eigen::CholmodSupernodalLLT<Columns, Eigen::Lower>());
#endif
  peer(matrix, b, "Eigen SimplicialLDLT", Eigen::SimplicialLDLT<Columns, Eigen::Lower>());
}

}  // namespace

int main(int argc, char** argv) {
  const int side = argc > 1 ? std::atoi(argv[1]) : 316;
  const double sigma = argc > 2 ? std::atof(argv[2]) : 0.7;
  const double ridge = argc > 3 ? std::atof(argv[3]) : 0;
  const System system = gaussian_gram(side, sigma, ridge);
  const double rows = static_cast<double>(system.matrix.rows());
  fmt::print(
      "{} unknowns in Morton's order, sigma / h = {}, ridge {}, {:.1f} entries a row, {:.0f} "
      "MB, {} threads, to {}\n",
      rows, sigma, ridge, static_cast<double>(system.matrix.entries()) / rows,
      static_cast<double>(system.matrix.column.size()) * 12e-6, thread_count(), kTolerance);
  ours(system, "CG, sparse inverse");
  ours(system, "again");
  spectrum(system.matrix);
  if (argc > 4 && std::string(argv[4]) == "peers") {
    peers(system);
  }
}
