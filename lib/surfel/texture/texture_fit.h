#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/solve/solve_report.h>
#include <surfel/texture/fit_report.h>
#include <surfel/texture/solid_texture.h>
#include <surfel/texture/texture_map.h>
#include <surfel/texture/uv_charts.h>

namespace surfel {

/// Ways to choose the coefficients w_k of the texture function sum_k w_k r_k [SS01 (1)].
enum class TextureFitKind {
  kEwa,     ///< View-independent EWA (ewa_fit.h).
  kGram,    ///< R w = c [SS01 (11)]: least squares for sum_k w_k r_k (gram_system.h).
  kRender,  ///< Least squares for the picture that the renderer makes of the w_k (render_system.h).
};

/// Right sides c of R w = c.
enum class GramRightSide {
  /// c_k = sum_i c_i <r_k, n_i o t^-1> [SS01 (11)], n the reconstruction kernel and t the map from
  /// the texture to the surface: the w_k minimise SS01 (10), the error of sum_k w_k r_k itself.
  /// That sum is the surface's colour only where amplitudes are areas; without the column `area`,
  /// coefficients take up the factor.
  kPublished,
  /// c_k = <r_k, sum_j r_j> w_ewa: the sum of all functions in place of 1, by which the renderer
  /// divides. A constant texture has constant coefficients, whatever the amplitudes and lambda.
  kNormalised,
};

enum class FitSolver {
  kConjugateGradients,  ///< conjugate_gradients.h: fast, in parallel, to the tolerance.
  kCeres,               ///< ceres_solver.h: least squares by Ceres, for small systems.
};

/// A part of a cloud among the surfels around it (fit_blocks.h), which are fitted as well, but
/// count in no report. The surfels are in the order of a curve through the whole cloud.
struct FittedPart {
  std::size_t begin = 0, end = 0;  ///< The part's own rows of the cloud.
  /// kRender: where set, nothing is solved; the part's own sums are added.
  RenderMeasure* measured = nullptr;
  /// kRender: of the whole cloud; without functions: the part's own.
  RenderMeasure whole{};
  /// kGram: the least that an automatic lambda is.
  double least_lambda = 0;

  bool owns(std::size_t surfel) const { return surfel >= begin && surfel < end; }
};

/// How fit_texture() finds coefficients.
struct SURFEL_API TextureFitOptions {
  TextureFitKind kind = TextureFitKind::kEwa;
  /// Standard deviation of the texture's reconstruction kernel n, texels, 0.25 to 16. Unset:
  /// texels are interpolated bilinearly, as other renderers and MeshRenderer do; kGram and kRender
  /// soften them up to 1 where surfels are wider than texels. SS01: 1.
  std::optional<double> reconstruction{};
  /// kEwa of a texture: variance of the kernel that the texture is filtered with by the surfel's
  /// own variance V_k, 1/16 to 4. SS01: 1. The renderer, too, filters by V_k. Where surfels are
  /// less than a pixel apart the pixel filter removes what less than that leaves of the texture's
  /// finest detail, so that pictures get sharper.
  double prefilter = 1;
  /// Kernels longer than this many times their width are widened, 1 to 10000.
  double max_aspect = kMaxAspect;
  /// Sum every kernel over the image's own texels: slow where kernels are large, and the truth that
  /// the pyramid is measured against.
  bool exact = false;

  // Of kGram and kRender:
  FitSolver solver = FitSolver::kConjugateGradients;
  /// Of conjugate gradients: relative residual; of Ceres and of robust fits: relative change of the
  /// coefficients in the last step. 1e-14 to 0.1.
  double tolerance = 1e-5;
  /// Weight of |w - w_ewa|^2 by the mean of the system's diagonal, 0 (kGram only) to 1e6. Unset:
  /// render 0.03; gram as much as brings the condition down to 1e6, 0 if it is less, and with
  /// kConjugateGradients as much more as makes them converge: where surfels of a bent surface or a
  /// thin sheet do not couple, R may be indefinite.
  std::optional<double> lambda{};
  /// Coefficients stay within; kConjugateGradients only.
  std::optional<CoefficientBounds> bounds{};
  /// kGram: unset: kPublished of a texture; kNormalised of colours, which are no function on the
  /// surface that could be integrated.
  std::optional<GramRightSide> right_side{};
  double cutoff = 1;  ///< kRender: c of the renderer that the fit is for, 0.1 to 16.
  /// kRender: quadrature points a surfel, 1 to 256. Unset: 6; 12 with refine_variance, which has a
  /// size to find for every surfel as well and gains 0.3 to 0.5 dB by them.
  std::optional<int> points{};
  /// kRender: outliers count by their distance instead of its square (robust_fit.h), and there is
  /// no minified term (render_system.h), which would hold the fit to coefficients with outliers;
  /// needs kConjugateGradients, which are reweighted, or kCeres, which is the reference; no bounds.
  bool robust = false;
  std::optional<double> robust_scale{};  ///< RobustOptions::scale, > 0.
  /// kRender of a texture: the surfels' variances are fitted as well (variance_fit.h, which needs
  /// Ceres whatever the solver, and knows no minified term), and written; neither robust nor
  /// bounds. Takes about 0.5 ms of one core a surfel.
  bool refine_variance = false;
  double coverage = 0;  ///< VarianceFitOptions::coverage, 0 to 1e6.
  /// The cloud is a part of a larger one. Needs kConjugateGradients, and is neither for robust nor
  /// refine_variance.
  std::optional<FittedPart> part{};
  /// Called with the share of assembly and solution that is done; may be empty.
  std::function<void(double)> progress{};
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Figures of a fit that solved a system of equations.
struct SystemReport {
  std::size_t functions = 0;  ///< Unknowns: the usable surfels; all other surfels keep w_ewa.
  std::size_t entries = 0;    ///< Entries of the matrix, both triangles.
  double lambda = 0;          ///< Lambda in units of the diagonal's mean.
  /// Estimated extreme eigenvalues of the matrix that is solved, lambda included.
  double eigen_min = 0;
  double eigen_max = 0;
  int iterations = 0;  ///< Iterations of conjugate gradients, or steps of Ceres.
  /// kRender: iterations of the rough solution that shows unresolved detail.
  int rough_iterations = 0;
  double residual = 0;  ///< Relative residual of the worst channel.
  bool converged = true;
  std::size_t points = 0;     ///< kRender: quadrature points.
  std::size_t uncovered = 0;  ///< kRender: points that no kernel reaches, which are left out.
  /// kRender: unknowns held to w_ewa as the texture has detail there that surfels cannot hold
  /// (unresolved_detail.h).
  std::size_t unresolved = 0;
  double error_ewa = 0;  ///< kRender: root mean square error of w_ewa, all points and channels.
  double error = 0;      ///< kRender: root mean square error of the fit.
  double min_reach = 0;  ///< kGram: least distance that entries go to, standard deviations.
  double max_reach = 0;  ///< kGram: largest distance that entries go to, standard deviations.
  std::optional<RobustReport> robust{};
  std::optional<VarianceFitReport> variance{};
  double error_before = 0;  ///< With `variance`: `error` as it was with the variances given.

  double condition() const { return eigen_min > 0 ? eigen_max / eigen_min : 0; }
  /// Adds the figures of another part of the same cloud.
  void add(const SystemReport& more);
};

/// The texture of the surfels.
struct TextureSet {
  std::vector<TextureMap> maps;
  std::vector<std::size_t> map_of_material{};  ///< Index into maps; empty: maps[0] for all surfels.
  std::optional<UvCharts> charts{};            ///< Kernels take no colour from beyond their chart.
  /// By material: the surfels' own colours multiply the map's. Empty: none.
  std::vector<bool> multiplied{};
  ColorLight light = ColorLight::kReflectance;  ///< What the colours that surfels get are.
  /// The maps are loaded for all kernels to come (load_requested()).
  bool loaded = false;

  bool takes_colors(std::size_t material) const {
    return material < multiplied.size() && multiplied[material];
  }

  /// Index of a surfel's map.
  std::size_t map_index(const SurfelCloud& cloud, std::size_t surfel) const {
    if (map_of_material.empty()) return 0;
    return map_of_material[cloud.material.empty() ? 0 : cloud.material[surfel]];
  }
};

/// Figures of a fit, and the numbers of unusual surfels.
struct SURFEL_API TextureFitReport {
  std::size_t surfels = 0;
  std::size_t without_uv = 0;      ///< uv not finite: given the image's mean colour.
  std::size_t without_kernel = 0;  ///< Derivatives or variance unusable: colour at the point.
  std::size_t widened = 0;         ///< Kernels beyond max_aspect.
  std::size_t charts = 0;
  std::size_t charts_too_large = 0;  ///< Not masked: they repeat the image more than four times.
  std::vector<std::uint32_t> too_large{};  ///< Numbers of these charts, ascending.
  std::size_t outside_charts = 0;        ///< Surfels whose uv is on no chart: filtered without one.
  int levels = 0;                        ///< Largest number of pyramid levels used.
  bool alpha = false;                    ///< The alpha column was written.
  std::optional<SystemReport> system{};  ///< Figures of the system of kGram and kRender.
  /// Least and largest coefficients over all surfels, by channel.
  Vec3f coefficient_min{0, 0, 0};
  Vec3f coefficient_max{0, 0, 0};
  StageTimes times;

  /// Adds the figures of a fit of further surfels of the same cloud.
  void add(const TextureFitReport& more);
};

/// Throws Error(kInput) with a message that starts with `name` where a cloud lacks columns that the
/// kernels of textures need, or has a material without a map.
/// \param cloud     A cloud, or some of its surfels.
/// \param textures  The maps of the materials.
/// \param name      The cloud's file, which starts messages.
/// \param first     Number of the first surfel in its file, for messages.
SURFEL_API void check_textured(const SurfelCloud& cloud, const TextureSet& textures,
                               const std::string& name, std::size_t first = 0);

/// The lambda that kGram chooses for these surfels, relative to the mean of the diagonal.
/// \param cloud     Surfels with sizes.
/// \param textured  Surfels without uv are left out.
/// \param options   The weights of the fit.
/// \param name      The cloud's file, for messages.
///
/// Throws as fit_colors() does where kernels are missing.
SURFEL_API double gram_lambda(const SurfelCloud& cloud, bool textured,
                              const TextureFitOptions& options,
                              const std::string& name = "surfels");

/// For clouds that come piece by piece: announces the kernels of a piece to the maps. Once all are
/// announced and load_requested() was called, fit_texture() by kEwa gives the surfels of a piece
/// what it gives them in the whole cloud. Throws as fit_texture() does.
/// \param piece     Consecutive surfels of the cloud.
/// \param textures  The maps of the materials.
/// \param options   The options of the fit to come.
/// \param name      The cloud's file, for messages.
/// \param first     Number of the piece's first surfel in the file, for messages.
SURFEL_API void request_kernels(SurfelCloud& piece, TextureSet& textures,
                                const TextureFitOptions& options, const std::string& name,
                                std::size_t first);
SURFEL_API void load_requested(TextureSet& textures);

/// Writes the coefficients (and, if an image has any, alpha) of the surfels; all other columns stay
/// as they are. Throws Error(kUsage) where the options are not usable, Error(kInput) with a message
/// that starts with `name`, the cloud's, where it lacks columns or has a material without a map.
SURFEL_API TextureFitReport fit_texture(SurfelCloud& cloud, TextureSet& textures,
                                        const TextureFitOptions& options,
                                        const std::string& name = "surfels");

/// Fits the coefficients to the surfels' own colour samples instead of a texture, so that the
/// rendered surface takes the colours c_k at the points, where w_k = c_k blurs. kEwa is w_k = c_k.
/// With robust, coefficients are pulled towards the winsorised samples (robust_fit.h): an outlier
/// would hold its own coefficient. With kRender, lambda is 0.5 if unset, as noise must not be
/// fitted (render_system.h). Of the columns, position, normal, variance and colour are needed.
/// Throws Error(kUsage) for refine_variance: one point a surfel does not tell its variance; and for
/// the right side kPublished, which needs a texture.
SURFEL_API TextureFitReport fit_colors(SurfelCloud& cloud, const TextureFitOptions& options,
                                       const std::string& name = "surfels");

/// Fits the coefficients to a solid texture, which needs no uv: of the columns, position, normal
/// and variance are used. kEwa is the texture's mean over each surfel's Gaussian (solid_texture.h);
/// of the options, reconstruction, max_aspect and exact have no meaning here. Surfels without a
/// normal or of unusable variance get the colour at their place, or the texture's mean where they
/// have none; they are counted as without_kernel. Throws as fit_texture().
SURFEL_API TextureFitReport fit_solid(SurfelCloud& cloud, const SolidTexture& texture,
                                      const TextureFitOptions& options,
                                      const std::string& name = "surfels");

/// Gives surfels the colours of their coefficients, within 0..1, for viewers that do not know
/// coefficients. Coefficients that are no numbers give black.
SURFEL_API void show_coefficients(SurfelCloud& cloud);

}  // namespace surfel
