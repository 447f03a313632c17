#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/cloud/cloud.h>
#include <surfel/io/image.h>
#include <surfel/io/mesh.h>
#include <surfel/sample/procedural_surface.h>

namespace surfel {

struct SURFEL_API GenerateOptions {
  std::size_t count = 100000;  ///< Surfels, exactly; 1 to 2^32 - 1.
  std::uint64_t seed = 1;
  double jitter = 0.35;       ///< Uniform offset from the cell's centre, +- this part of the
                              ///< spacing; 0 to 0.5.
  double variance_scale = 1;  ///< Standard deviation of the kernels in units of the spacing, > 0.
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Surfels on the scene's surfaces, jittered in cells of equal area h^2 (EqualAreaStrata), h being
/// the same for all parts up to rounding. Columns: position, normal (exact), variance =
/// (variance_scale h)^2, area, color, uv, dpdu, dpdv and, in transparent scenes, alpha. In order of
/// part, row, cell. The same for any number of threads.
SURFEL_API SurfelCloud generate_surfels(const ProceduralScene& scene,
                                        const GenerateOptions& options);

/// The scene as triangles, `resolution` cells along u and v of every part, with a uv and the exact
/// normal per wedge. Seams and poles are closed: their vertices are shared. `texture`, if not
/// empty, is named as the material's texture. Throws Error(kUsage) unless 3 <= resolution <= 16384.
SURFEL_API TriangleMesh generate_mesh(const ProceduralScene& scene, int resolution,
                                      const std::string& texture = {});

/// The colours of the scene's first part over its uv square, as rasterize() makes them.
SURFEL_API Image generate_texture(const ProceduralScene& scene, int width, int height);

}  // namespace surfel
