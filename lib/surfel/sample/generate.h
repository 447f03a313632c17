#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// Number, jitter, size and columns of generated surfels.
struct SURFEL_API GenerateOptions {
  std::size_t count = 100000;  ///< Surfels, exactly; 1 to 2^32 - 1.
  std::uint64_t seed = 1;
  double jitter = 0.35;       ///< Uniform offset from the cell's centre, +- this part of the
                              ///< spacing; 0 to 0.5.
  double variance_scale = 1;  ///< Standard deviation of the kernels in units of the spacing, > 0.
  bool uv = true;             ///< With uv, dpdu and dpdv: nearly half of a surfel's bytes.
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Surfels on the scene's surfaces, jittered in cells of equal area h^2 (EqualAreaStrata), where
/// all parts have one h up to rounding. Columns: position, normal (exact), variance =
/// (variance_scale h)^2, area, color, uv, dpdu, dpdv (unless left out) and, in transparent scenes,
/// alpha. Surfels come by part, row and cell, and do not depend on the number of threads. Throws
/// Error(kUsage) for bad options, or more surfels than memory holds.
SURFEL_API SurfelCloud generate_surfels(const ProceduralScene& scene,
                                        const GenerateOptions& options);

/// Makes the surfels of generate_surfels() in the order of morton_order(), and hands them on in
/// pieces of about `piece` surfels: memory grows by 48 bytes per 512 surfels only. The surface is
/// evaluated two to three times as often. Throws Error(kUsage) for bad options.
SURFEL_API void generate_surfels_in_order(const ProceduralScene& scene,
                                          const GenerateOptions& options, std::size_t piece,
                                          FunctionRef<void(SurfelCloud&& piece)> consume);

/// The scene as triangles, `resolution` cells along u and v of every part, with a uv and the exact
/// normal per wedge. Seams and poles are closed: their vertices are shared. `texture`, if not
/// empty, is named as the material's texture. Throws Error(kUsage) unless 3 <= resolution <= 16384.
SURFEL_API TriangleMesh generate_mesh(const ProceduralScene& scene, int resolution,
                                      const std::string& texture = {});

/// The colours of the scene's first part over its uv square, as rasterize() makes them.
SURFEL_API Image generate_texture(const ProceduralScene& scene, int width, int height);

}  // namespace surfel
