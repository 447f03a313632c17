#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/solve/symmetric_matrix.h>
#include <surfel/texture/fit_report.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {

/// Points u_q on the surface, each of which belongs to the function in whose tangent plane it lies,
/// and counts for as much as any other.
struct Quadrature {
  Array<std::uint64_t> begin;  ///< First point of every function, then the number of points.
  Array<Vec2f> offset;  ///< From its function's position along (tangent, bitangent), scene units.
  /// Of every function: the texture must be filtered with this isotropic Gaussian, unit^2 in its
  /// tangent plane, so as not to alias between its points.
  Array<float> variance;

  std::size_t functions() const { return variance.size(); }
  std::size_t size() const { return offset.size(); }
};

/// As many points for every function, spread evenly over its Voronoi cell among the functions of
/// the same sheet. The texture is filtered for the functions' spacing, not for the points' spacing:
/// the functions must not be fitted to detail that they cannot hold, as it comes back as noise
/// where the surface is minified. The cell ends at 0.95 spacings (the square root of the area;
/// drawn out as V is) where there are no neighbours. What faces the other way, or lies further from
/// the tangent plane than along it, is another sheet. Duplicates share their cell, and each has
/// points in it. The cell ends at the function's half-planes. Functions whose centre is cut off
/// have points as well, which lie beyond their line and count for nothing (EvaluatedBasis).
/// \param points  per function, 1..256; time and memory grow with them. Checkers and a textured
///                mesh lose up to 0.15 dB with 6 against 12, and 0.05 dB with 12 against 64.
SURFEL_API Quadrature cover_surface(const SurfelBasis& basis, int points = 6);

/// The functions' own positions: colour samples are known nowhere else.
SURFEL_API Quadrature at_functions(const SurfelBasis& basis);

/// Regularisation for colour samples: one equation a surfel says nothing of the surface between the
/// surfels, and noise must not be fitted. (Measured on jittered grids, noise of 0 and 10 % of the
/// range: up to 3 dB better than the samples as coefficients, at most 0.03 dB worse; 0.1 loses up
/// to 0.8 dB.)
inline constexpr double kColorRegularization = 0.5;

struct SURFEL_API RenderSystemOptions {
  double cutoff = 1;  ///< c of the renderer: kernels end where beta >= c; 0.1..16.
  /// mu by the number of points a function, 0..1e6. 0: w_0 is not the filtered texture.
  double minified = 8;
  /// lambda by the mean of the diagonal of A^T A + mu B^T B, (0, 1e6].
  double regularization = 0.03;
  std::optional<double> lambda{};  ///< > 0; where set, lambda itself instead.
  /// Of the cloud that the basis is a part of, from which mu and lambda are; without functions: of
  /// the basis.
  RenderMeasure whole{};
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// A basis at points, as the renderer evaluates it from near: functions end at their half-planes.
/// Points beyond a half-plane of their own function are not on the surface: no function reaches
/// them.
struct SURFEL_API EvaluatedBasis {
  SparseMatrix A;             ///< Rows sum to 1; rows of points that no function reaches are empty.
  std::size_t uncovered = 0;  ///< Points that no function reaches.
  /// Of every function, the owners of the points it reaches: the way from columns to rows of A.
  Array<std::uint64_t> owner_begin;
  Array<std::uint32_t> owner;
  Array<std::uint64_t> point_begin;  ///< Quadrature::begin.
  Array<float>
      coverage;  ///< The sum_j r_j(u_q) of every point, which the renderer compares with tau.

  /// (A w - f)_q, zero at uncovered points.
  Channels residual(std::size_t q, const Array<Channels>& w, const Array<Channels>& f) const;
  /// A w - f, zero at uncovered points.
  Array<Channels> residuals(const Array<Channels>& w, const Array<Channels>& f) const;
  /// |A w - f|^2 over the covered points.
  Channels residual2(const Array<Channels>& w, const Array<Channels>& f) const;
  /// A^T f.
  /// \param f  per point; ignored at uncovered ones.
  Array<Channels> multiply_transposed(const Array<Channels>& f) const;
};

/// Least squares in the basis that the renderer evaluates [SS01 (9)], magnified and minified at
/// once: the w that minimise |A w - f|^2 + mu |B w - w_0|^2 + sum_k (lambda + held_k) |w_k -
/// w_0k|^2, with A_qk = r_k(u_q) / sum_j r_j(u_q), the r_k truncated at c. B is the same at the
/// functions' own positions, the r_k as wide as they are on screen where the pixel filter is about
/// as wide as they: of variance V (1 + 1 / t), t being the share of its variance that truncation
/// leaves a Gaussian. There the picture ought to be the texture under a Gaussian of variance V,
/// which is what w_0, the coefficients of view-independent EWA, are. Without that term,
/// coefficients that are right from near sum to noise from afar, where the renderer weighs them by
/// their areas, and not by the values that truncation and normalisation make of the areas at each
/// place.
///
/// A point is seen along its owner's normal, as by a viewer straight above. A function takes part
/// where the line of sight meets its plane within the truncated kernel, if the place is no further
/// from the point than the kernel's reach (sqrt(2 c V) of its longer axis: the depth up to which
/// the renderer, too, adds to a surface), the normals are within 60 degrees of each other, and the
/// centre is within sqrt 2 reaches of the disc that holds its owner's points. So sheets back to
/// back never mix, however thin; sheets that face the same way do where the renderer mixes them.
///
/// The normal matrix is symmetric positive definite whatever the surfels, and |w - w_0|^2 is at
/// most (|A w_0 - f|^2 + mu |B w_0 - w_0|^2) / lambda. Duplicates get equal coefficients if their
/// w_0 are; functions that reach no point keep w_0.
struct SURFEL_API RenderSystem {
  EvaluatedBasis near;            ///< A.
  EvaluatedBasis far;             ///< B; empty where mu is 0.
  SymmetricMatrix normal_matrix;  ///< A^T A + mu B^T B + lambda I + diag(held).
  double mu = 0;
  double lambda = 0;
  double mean_diagonal = 0;  ///< Of A^T A + mu B^T B, the mean that lambda is from.
  Array<double> held;        ///< Of every function, >= 0; empty: none is (unresolved_detail.h).

  /// The weight of |w_k - w_0k|^2.
  double pull(std::size_t k) const { return lambda + (held.empty() ? 0 : held[k]); }

  /// A^T f + mu B^T w_0 + (lambda + held) w_0.
  /// \param f    per point; ignored at uncovered ones.
  /// \param w_0  per function.
  Array<Channels> right_side(const Array<Channels>& f, const Array<Channels>& w_0) const;
  /// The terms that hold w back: all terms except the first.
  Channels pull2(const Array<Channels>& w, const Array<Channels>& w_0) const;
  /// A^T D A + mu B^T B + lambda I + diag(held) with the diagonal matrix D: the normal matrix where
  /// points count by weights.
  /// \param weight  per point.
  SymmetricMatrix weighted_normal_matrix(const Array<double>& weight) const;
};

/// The values that the coefficients of a render system are fitted to.
struct FitTarget {
  Array<Channels> f;    ///< Per near point; ignored at uncovered ones.
  Array<Channels> w_0;  ///< Per function.
  int channels = 4;     ///< The first 1..4 channels count; all other channels must be 0.
};

/// The basis at the points alone: kernels end at `cutoff`, > 0. The same for any number of threads.
SURFEL_API EvaluatedBasis evaluate_basis(const SurfelBasis& basis, const Quadrature& quadrature,
                                         double cutoff);

/// The sums of the functions i for which owns(i) holds.
RenderMeasure measure_render_system(const SurfelBasis& basis, const Quadrature& quadrature,
                                    const RenderSystemOptions& options,
                                    FunctionRef<bool(std::size_t i)> owns);

/// Throws Error(kUsage) where the options are not usable. The same for any number of threads.
SURFEL_API RenderSystem assemble_render_system(const SurfelBasis& basis,
                                               const Quadrature& quadrature,
                                               const RenderSystemOptions& options = {});

/// Rows of the values beta in the place of A_qk; kernels end at `cutoff`.
SURFEL_API SparseMatrix kernel_exponents(const SurfelBasis& basis, const Quadrature& quadrature,
                                         double cutoff);

}  // namespace surfel
