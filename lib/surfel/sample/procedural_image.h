#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Texture given by a formula: linear RGB in [0, 1] at the texture coordinate (u, v), defined for
/// all u and v. Callable from any thread.
using ProceduralTexture = std::function<Vec3f(double u, double v)>;

/// Frequency, seed and colours of a procedural texture.
struct SURFEL_API ProceduralTextureOptions {
  double frequency = 16;   ///< > 0. Squares of the checker, pairs of spokes of the star (rounded to
                           ///< a whole number), cells of the noise's first octave per unit of uv.
  std::uint64_t seed = 1;  ///< Chooses the noise.
  Vec3f dark{0, 0, 0};     ///< The two colours of checker and star, linear.
  Vec3f light{1, 1, 1};
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Names that procedural_texture() knows: checker, siemens, noise.
SURFEL_API const std::vector<std::string>& procedural_texture_names();

/// The texture called `name`.
/// checker: squares, dark where floor(u f) + floor(v f) is even.
/// siemens: Siemens star of radius 1/2 about (1/2, 1/2) in the unit square, repeated; dark outside.
/// noise: fractal noise of six octaves, another one in each of the three channels.
/// Throws Error(kUsage) for bad options, or, naming the known textures, if `name` is none of them.
SURFEL_API ProceduralTexture procedural_texture(const std::string& name,
                                                const ProceduralTextureOptions& options = {});

/// The texture's unit square as a picture, channels R G B A (opaque), row 0 at v = 1; a pixel is
/// the mean of samples x samples points in it.
SURFEL_API Image rasterize(const ProceduralTexture& texture, int width, int height,
                           int samples = 4);

}  // namespace surfel
