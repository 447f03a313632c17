#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/cloud/cloud.h>
#include <surfel/texture/texture_map.h>
#include <surfel/texture/uv_charts.h>

namespace surfel {

/// Ways to choose the coefficients w_k of the texture function sum_k w_k r_k [SS01 (1)].
enum class TextureFitKind {
  kEwa,  ///< View-independent EWA (ewa_fit.h).
};

struct SURFEL_API TextureFitOptions {
  TextureFitKind kind = TextureFitKind::kEwa;
  /// Standard deviation of the texture's reconstruction kernel n, texels, 0.25 to 16. SS01: 1.
  double reconstruction = 1;
  /// Kernels longer than this many times their width are widened, 1 to 10000.
  double max_aspect = KernelLimits{}.max_aspect;
  /// Sum every kernel over the image's own texels: slow where kernels are large, and the truth that
  /// the pyramid is measured against.
  bool exact = false;
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// What the surfels are textured with.
struct TextureSet {
  std::vector<TextureMap> maps;
  std::vector<std::size_t> map_of_material{};  ///< Index into maps; empty: maps[0] for all surfels.
  std::optional<UvCharts> charts{};            ///< Kernels take no colour from beyond their chart.

  /// Index of a surfel's map.
  std::size_t map_index(const SurfelCloud& cloud, std::size_t surfel) const {
    if (map_of_material.empty()) return 0;
    return map_of_material[cloud.material.empty() ? 0 : cloud.material[surfel]];
  }
};

/// What a fit met and made.
struct TextureFitReport {
  std::size_t surfels = 0;
  std::size_t without_uv = 0;      ///< uv not finite: given the image's mean colour.
  std::size_t without_kernel = 0;  ///< Derivatives or variance unusable: colour at the point.
  std::size_t widened = 0;         ///< Kernels beyond max_aspect.
  std::size_t charts = 0;
  std::size_t charts_too_large = 0;  ///< Not masked: they repeat the image more than four times.
  std::size_t outside_charts = 0;    ///< Surfels whose uv is on no chart: filtered without one.
  int levels = 0;                    ///< Largest number of pyramid levels used.
  bool alpha = false;                ///< The alpha column was written.
  Vec3f coefficient_min{0, 0, 0};    ///< Of all surfels, per channel.
  Vec3f coefficient_max{0, 0, 0};
  StageTimes times;
};

/// Writes the coefficients (and, if an image has any, alpha) of the surfels; all other columns stay
/// as they are. Throws Error(kUsage) where the options are not usable, Error(kInput) with a message
/// that starts with `name`, the cloud's, where it lacks columns or has a material without a map.
SURFEL_API TextureFitReport fit_texture(SurfelCloud& cloud, TextureSet& textures,
                                        const TextureFitOptions& options,
                                        const std::string& name = "surfels");

}  // namespace surfel
