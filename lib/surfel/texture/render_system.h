#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/solve/sparse_matrix.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {

/// Points u_q on the surface, each of which belongs to the function in whose tangent plane it lies,
/// and counts for as much as any other.
struct Quadrature {
  Array<std::uint64_t> begin;  ///< Of every function its first point, and the number of points.
  Array<Vec2f> offset;  ///< From its function's position along (tangent, bitangent), scene units.
  /// Of every function: the texture must be filtered with this isotropic Gaussian, unit^2 in its
  /// tangent plane, so as not to alias between its points.
  Array<float> variance;

  std::size_t functions() const { return variance.size(); }
  std::size_t size() const { return offset.size(); }
};

/// As many points for every function, spread evenly over its Voronoi cell among the functions of
/// the same sheet. The cell ends at 0.95 spacings (the square root of the area; drawn out as V is)
/// where there are no neighbours. What faces the other way, or lies further from the tangent plane
/// than along it, is another sheet. Duplicates share their cell, and each has points in it.
/// \param points  per function, 1..256. The picture loses 0.15 dB against 64 points with 12, 0.3 dB
///                with 8, 0.8 dB with 4; time and memory grow with them.
SURFEL_API Quadrature cover_surface(const SurfelBasis& basis, int points = 12);

/// The functions' own positions: colour samples are known nowhere else.
SURFEL_API Quadrature at_functions(const SurfelBasis& basis);

/// Regularisation for colour samples: one equation a surfel says nothing of what lies between, and
/// noise must not be fitted. (Measured on jittered grids, noise of 0 and 10 % of the range: up to 3
/// dB better than the samples as coefficients, at most 0.03 dB worse; 0.1 loses up to 0.8 dB.)
inline constexpr double kColorRegularization = 0.5;

struct SURFEL_API RenderSystemOptions {
  double cutoff = 1;  ///< c of the renderer: kernels end where beta >= c; 0.1..16.
  /// lambda by the mean of the diagonal of A^T A, (0, 1e6]. Measured on jittered grids without
  /// noise, 1e-4 gains up to 1 dB where kernels overlap much (sigma = h, c = 4) and doubles the
  /// solver's steps; nothing changes where they do not.
  double regularization = 1e-3;
  std::optional<double> lambda{};             ///< > 0; where set, lambda itself instead.
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Least squares in the basis that the renderer evaluates [SS01 (9)]: the w that minimise
/// |A w - f|^2 + lambda |w - w_0|^2, with A_qk = r_k(u_q) / sum_j r_j(u_q), the r_k truncated at c.
///
/// A point is seen along its owner's normal, as by a viewer straight above. A function takes part
/// where the line of sight meets its plane within the truncated kernel, if the place is no further
/// from the point than the kernel's reach (sqrt(2 c V) of its longer axis: the depth up to which
/// the renderer, too, adds to a surface), the normals are within 60 degrees of each other, and the
/// centre is within sqrt 2 reaches of the disc that holds its owner's points. So sheets back to
/// back never mix, however thin; sheets that face the same way do where the renderer mixes them.
///
/// The normal matrix is symmetric positive definite whatever the surfels, and |w - w_0|^2 is at
/// most |A w_0 - f|^2 / lambda. Duplicates get equal coefficients if their w_0 are; functions that
/// reach no point keep w_0.
struct SURFEL_API RenderSystem {
  SparseMatrix A;  ///< Rows sum to 1; those of points that no function reaches are empty.
  SparseMatrix normal_matrix;  ///< A^T A + lambda I.
  double lambda = 0;
  std::size_t uncovered = 0;  ///< Points that no function reaches.
  /// Of every function, the owners of the points it reaches: what leads from columns to rows of A.
  Array<std::uint64_t> owner_begin;
  Array<std::uint32_t> owner;
  Array<std::uint64_t> point_begin;  ///< Quadrature::begin.
  Array<float> coverage;  ///< Of every point sum_j r_j(u_q), what the renderer compares with tau.

  /// A^T f + lambda w_0. \param f  per point; ignored at uncovered ones. \param w_0  per function.
  Array<Channels> right_side(const Array<Channels>& f, const Array<Channels>& w_0) const;
  /// |A w - f|^2 over the covered points.
  Channels residual2(const Array<Channels>& w, const Array<Channels>& f) const;
  /// A w - f, zero at uncovered points.
  Array<Channels> residuals(const Array<Channels>& w, const Array<Channels>& f) const;
  /// A^T D A + lambda P with the diagonal matrices D and P: the normal matrix where points and
  /// pulls count by weights. \param point  per point. \param pull  per function.
  SparseMatrix weighted_normal_matrix(const Array<double>& point, const Array<double>& pull) const;
};

/// Throws Error(kUsage) where the options are not usable. The same for any number of threads.
SURFEL_API RenderSystem assemble_render_system(const SurfelBasis& basis,
                                               const Quadrature& quadrature,
                                               const RenderSystemOptions& options = {});

/// The same rows with beta in the place of A_qk, and kernels that end at `cutoff`.
SURFEL_API SparseMatrix kernel_exponents(const SurfelBasis& basis, const Quadrature& quadrature,
                                         double cutoff);

}  // namespace surfel
