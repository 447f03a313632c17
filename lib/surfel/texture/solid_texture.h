#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/texture/kernel_axes.h>

namespace surfel {

/// Textures that fill space, so that surfaces are cut out of them without texture coordinates.
enum class SolidPattern {
  kChecker,  ///< Cubes of two colours; the block's centre is the middle of a light one.
  kNoise,    ///< Fractal noise, its values spread evenly from dark to light.
  kMarble,   ///< Light stone with dark veins of two widths.
  kWood,     ///< Year rings about an axis along y beside the block's centre, with fibres.
};

/// Pattern, size and colours of a texture that fills space.
struct SURFEL_API SolidTextureOptions {
  SolidPattern pattern = SolidPattern::kMarble;
  /// Features along the diagonal of the bounds, 0.01 to 1e6: a feature is a cube of the checker, a
  /// cell of the noise's first octave, a vein of the marble, a ring of the wood. Unset: checker 16,
  /// noise 12, marble 9, wood 32.
  std::optional<double> frequency{};
  std::optional<double> feature_size{};  ///< Of a feature, scene units, > 0; instead of frequency.
  std::optional<Vec3d> center{};  ///< World; where the pattern's block has its centre. Unset: the
                                  ///< bounds' centre.
  int octaves = 8;                ///< Of the noise in noise, marble and wood, 1 to 16.
  std::uint64_t seed = 1;         ///< Chooses the noise.
  /// The two colours, linear, finite, >= 0. Unset: the pattern's own; black and white for checker
  /// and noise.
  std::optional<Vec3f> dark{};
  std::optional<Vec3f> light{};
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Names that solid_texture_options() knows: checker, noise, marble, wood.
SURFEL_API const std::vector<std::string>& solid_texture_names();

/// Options for "NAME" or "NAME:FREQUENCY". Throws Error(kUsage), naming the known textures, if the
/// name is unknown or the frequency no number in range.
SURFEL_API SolidTextureOptions solid_texture_options(const std::string& name);

/// A colour at every point of space, and its mean over Gaussians, of which there is next to no
/// aliasing: octaves of noise that a Gaussian averages away are left out, and the ramp of colours
/// is averaged over the variance that they had. Callable from any thread.
class SURFEL_API SolidTexture {
 public:
  /// \param options  The pattern, its colours and its frequency.
  /// \param bounds   That options.frequency and options.center refer to; an empty box or a point
  ///                 counts as one of diagonal 1.
  ///
  /// Throws Error(kUsage) for bad options.
  SolidTexture(const SolidTextureOptions& options, const Bounds& bounds);
  ~SolidTexture();
  SolidTexture(SolidTexture&&) noexcept;
  SolidTexture& operator=(SolidTexture&&) noexcept;

  double feature_size() const { return feature_size_; }  ///< Scene units.
  /// The colour at a point, linear; between dark and light. The mean where the point is not finite,
  /// or so many features away that doubles have no fractions left.
  Vec3f evaluate(const Vec3d& point) const;
  /// The mean colour over a Gaussian about a point. Checker: within 0.003 of the range of colours.
  /// The others: the mean of nine parts of the Gaussian, on each of which the noise is taken as
  /// linear with a normal distribution about it; root mean square errors by the Gaussian's size are
  /// in docs/texture.md.
  /// \param point  Centre of the Gaussian, world coordinates.
  /// \param axes   Scene units; longer than 1e9 features: the mean of all space.
  Vec3f filtered(const Vec3d& point, const KernelAxes& axes) const;
  Vec3f mean() const;  ///< Of all space.

  class Pattern;  ///< Internal.

 private:
  Vec3f color(double share) const;

  double feature_size_ = 1;
  Vec3d center_{0, 0, 0};
  Vec3f dark_{0, 0, 0};
  Vec3f light_{1, 1, 1};
  std::unique_ptr<const Pattern> pattern_;
};

}  // namespace surfel
