#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/image.h>

namespace surfel {

/// The values in which pictures are compared; full scale is 1 in both.
enum class ImageEncoding {
  kSrgb,   ///< Values as a viewer sees them: clamped to 0..1 and sRGB-encoded.
  kLinear  ///< Linear light, as it is.
};

/// What image_error() compares: encoding, background, part of the picture.
struct ImageErrorOptions {
  ImageEncoding encoding = ImageEncoding::kSrgb;
  /// The background that both pictures are laid over, linear R G B and straight alpha, each finite.
  /// Transparent: the premultiplied colours as they are, which is a picture over black.
  std::array<float, 4> background{0, 0, 0, 0};
  /// A pixel counts as beyond when a colour channel differs by more than this, 0 <= threshold < 1.
  /// The default is passed by two levels of 8 bits, not by the one that rounding can make.
  double threshold = 1.5 / 255;
  /// Compare colours only where both alphas are at least 0.99: inside the silhouette.
  bool inside_only = false;
  SURFEL_API std::vector<std::string> problems() const;
};

/// How far one picture is from another. Differences are fractions of full scale, over the channels
/// R G B of the compared pixels.
///
/// A pixel whose difference is not finite (NaN or infinity in either picture, colour or alpha) is
/// always compared, and counts as a difference of 1 in every channel.
struct ImageError {
  std::size_t pixels = 0;     ///< Pixels that were compared.
  std::size_t nonfinite = 0;  ///< The compared pixels whose difference is not finite.
  double psnr = 0;            ///< -20 log10(rmse), dB; infinity for equal pictures.
  double rmse = 0;            ///< Root of the mean squared difference.
  double mean_absolute = 0;
  double maximum = 0;  ///< Largest difference, first met at `x`, `y` in `channel`.
  int x = 0, y = 0;    ///< Row 0 is the top.
  int channel = 0;     ///< 0..2 for R G B.
  double beyond = 0;   ///< Share of the compared pixels that differ by more than the threshold.
  /// Share of the pixels with an alpha of at least 0.99 in the truth whose alpha in the tested
  /// picture is not at least 0.5; 0 where the truth has no such pixel.
  double holes = 0;
  double alpha_psnr = 0;  ///< PSNR of alpha, of all pixels, never encoded, dB.
};

/// Compares the tested picture with the truth. Both are premultiplied linear, as rendered or as
/// read_premultiplied_image() delivers them; R G B A are found by name, a missing alpha is 1, other
/// channels are left alone. The same for any number of threads. Throws Error(kUsage) for bad
/// options, Error(kInput) for pictures of different sizes, without R G B, or where no pixel is left
/// to compare.
SURFEL_API ImageError image_error(const Image& tested, const Image& truth,
                                  const ImageErrorOptions& options = {});

/// Picture of scale * |tested - truth| in R G B, opaque; pixels that are not compared are black.
/// Under kSrgb encoded values are subtracted, and the differences are decoded here, so that the
/// levels of a PNG show them. `scale` is finite and > 0. Throws as image_error() does, except that
/// there may be no pixel to compare.
SURFEL_API Image difference_image(const Image& tested, const Image& truth,
                                  const ImageErrorOptions& options = {}, double scale = 10);

}  // namespace surfel
