#pragma once

#include <cstddef>
#include <cstdint>

namespace surfel {

// The library and the plug-in libsurfel_ceres.so hand raw numbers to one another.

/// weight sum_q rho(|A_q w - f_q|^2) over rows q of A that have entries; rho is Huber's function,
/// or the identity.
struct CeresTerm {
  std::size_t rows = 0;
  const std::uint64_t* row_begin = nullptr;
  const std::uint32_t* column = nullptr;
  const double* value = nullptr;
  const double* f = nullptr;
  double weight = 1;
  double huber = 0;  ///< Where rho goes over from a parabola to a line; 0: rho is the identity.
};

/// Minimise the sum of terms. Numbers of unknowns and rows are `stride` apart, of which the first
/// `channels` count.
struct CeresLeastSquares {
  const CeresTerm* term = nullptr;
  std::size_t terms = 0;
  std::size_t columns = 0;
  int channels = 1;
  int stride = 1;
  double tolerance = 1e-6;  ///< Ends where steps are smaller, relative to |w|.
  int max_iterations = 0;
  double* w = nullptr;  ///< In: where to start, out: the minimum.
};

/// Minimise a smooth function by limited-memory BFGS.
struct CeresMinimization {
  std::size_t size = 0;
  double* x = nullptr;  ///< In: where to start, out: the best found.
  /// \return false where the function has no finite value at x. `gradient` may be null.
  bool (*evaluate)(void* self, const double* x, double* cost, double* gradient) = nullptr;
  void* self = nullptr;
  double tolerance = 1e-6;  ///< Ends where a step gains less of the cost.
  int max_iterations = 50;
};

/// A point of one rigid body that lies near a plane of another; the residual is its distance.
struct PlaneMatch {
  std::uint32_t moving = 0;  ///< Body of the point.
  std::uint32_t fixed = 0;   ///< Body of the plane, another one.
  double point[3] = {};
  double on_plane[3] = {};
  double normal[3] = {};  ///< Unit.
};

/// How a rigid body moves: x goes to exp(r) x + t.
struct BodyMotion {
  double value[6] = {};  ///< The rotation r, axis times angle, then the translation t.
};

/// Minimise sum rho(distance^2) over the motions of all bodies but the first, which rests; rho is
/// Cauchy's function.
struct CeresBodies {
  const PlaneMatch* match = nullptr;
  std::size_t matches = 0;
  BodyMotion* motion = nullptr;  ///< In: where to start, out: the minimum.
  std::size_t bodies = 0;
  double scale = 1;  ///< Distance from which on matches count less, > 0.
  int max_iterations = 10;
};

struct CeresReport {
  int iterations = 0;
  double cost = 0;
  bool converged = true;
};

/// All throw Error: kNumeric where Ceres fails, kInterrupted if asked to stop.
using CeresSolveLeastSquares = void(const CeresLeastSquares& problem, CeresReport& report);
inline constexpr char kCeresSolveLeastSquaresSymbol[] = "surfel_ceres_least_squares";
using CeresMinimize = void(const CeresMinimization& problem, CeresReport& report);
inline constexpr char kCeresMinimizeSymbol[] = "surfel_ceres_minimize";
using CeresMoveBodies = void(const CeresBodies& problem, CeresReport& report);
inline constexpr char kCeresMoveBodiesSymbol[] = "surfel_ceres_move_bodies";

}  // namespace surfel
