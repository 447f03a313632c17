#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/checkpoints.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/surfel_sink.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/solid_texture.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// More surfels than that are fitted block by block by kGram and kRender, whatever the memory.
inline constexpr std::size_t kMostFittedAtOnce = std::size_t{1} << 18;

/// What coefficients are fitted to: a texture, a solid texture, or, where both are null, the
/// surfels' own colours.
struct FitSource {
  TextureSet* textures = nullptr;
  const SolidTexture* solid = nullptr;
  /// Where surfels without uv take them from (surface_lookup.h); null: from nowhere.
  const TriangleMesh* mesh = nullptr;
};

/// fit_texture(), fit_solid() or fit_colors(); fit_by_blocks() where there are many surfels
/// (fitted_by_blocks()). The surfels have uv where they are needed: `mesh` is not looked at.
SURFEL_API TextureFitReport fit_coefficients(SurfelCloud& cloud, const FitSource& source,
                                             const TextureFitOptions& options,
                                             const std::string& name = "surfels");

/// A report without its times, as bytes by which Checkpoints keep it.
SURFEL_API std::string state_of(const TextureFitReport& report);
/// None where the state is of something else.
SURFEL_API std::optional<TextureFitReport> kept_report(const std::string& state);

/// How a fit is divided into blocks.
struct FitBlockOptions {
  std::size_t most = std::size_t{1} << 17;  ///< Surfels of a block, >= 1.
  /// Width of the halo, in reaches of kernels: sqrt(2 c V), c being the cutoff of kRender, and 1
  /// of kGram. 0: wide enough for the coefficients to differ from the whole's by no more than the
  /// solver's tolerance leaves, see docs/texture.md.
  double halo = 0;
  /// Keeps the blocks that are finished; null: none.
  Checkpoints* checkpoints = nullptr;
};

/// Why fits with these options need all surfels at once: one sentence each, empty if they do not.
SURFEL_API std::vector<std::string> fit_block_problems(const TextureFitOptions& options);

/// Are so many surfels fitted block by block?
inline bool fitted_by_blocks(std::size_t surfels, const TextureFitOptions& options) {
  return surfels > kMostFittedAtOnce && options.kind != TextureFitKind::kEwa &&
         fit_block_problems(options).empty();
}

/// Bytes that fit_coefficients() by kGram or kRender takes for surfels that are fitted at once, of
/// which each takes `row_bytes`, the surfels included.
SURFEL_API std::uint64_t fit_bytes(std::size_t surfels, std::size_t row_bytes);
/// Bytes that fit_by_blocks() takes for any number of surfels.
SURFEL_API std::uint64_t fit_block_bytes(std::size_t surfels, std::size_t row_bytes);

/// Fits the coefficients of surfels that need not be in memory by kGram or kRender, in the blocks
/// of curve_blocks(): each is solved together with a halo of surfels around it, and keeps its own
/// coefficients. What a coefficient owes to a texture far away falls exponentially with the
/// distance, so that the result is nearly the one of fit_coefficients(), and borders of blocks
/// cannot be seen. The same for any memory and any number of threads.
///
/// The weights that are one number for the whole cloud are one number here, which 64 stretches of
/// the curve tell; kGram needs the largest lambda of any block, for which all blocks are fitted
/// again where a later block needs more than the stretches.
///
/// \param cloud    The surfels, read by ranges.
/// \param source   The textures that coefficients are fitted to.
/// \param options  The method and its weights.
/// \param sink     Gets the blocks along the curve, and all of them anew where they are fitted
///                 again.
/// \param report   If not null, filled.
/// \param name     The cloud's file, for messages.
/// \param blocks   Size of the blocks and of their halo, and where finished ones are kept.
///
/// Returns false, before anything comes to the sink, where the cloud is not in the order of
/// morton_order(). Throws as fit_coefficients() does, and Error(kUsage) for fit_block_problems().
SURFEL_API bool fit_by_blocks(const SurfelRanges& cloud, const FitSource& source,
                              const TextureFitOptions& options, SurfelSink& sink,
                              TextureFitReport* report = nullptr,
                              const std::string& name = "surfels",
                              const FitBlockOptions& blocks = {});

}  // namespace surfel
