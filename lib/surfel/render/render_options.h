#pragma once

// How a picture is drawn. Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001
// (SS01).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

class CompositingMethod;

/// How a kernel is projected.
enum class Kernel : std::uint8_t {
  kAffine,       ///< SS01 (4), (6): linearised at the surfel's centre.
  kPerspective,  ///< SS01 (8): linearised at every pixel (exact_kernel.h).
  kAuto,         ///< kPerspective where kAffine may be off by more than kernel_tolerance.
};

/// How a kernel is filtered (SS01 figure 8).
enum class Filter : std::uint8_t {
  kEwa,       ///< SS01 (6): the footprint convolved with the pixel's Gaussian.
  kCircular,  ///< A round kernel as wide as that ellipse is long: blurs where surfaces slant.
  kNone,      ///< The footprint alone: aliases where it is smaller than a pixel.
};

/// How a picture's depths darken it (relief.h).
enum class Relief : std::uint8_t {
  kNone,
  kEyeDome,    ///< By what is nearer around a pixel: slopes and outlines.
  kOcclusion,  ///< By how much of the sky what is around a pixel hides: creases and hollows.
};

/// How a Renderer draws: kernel, filter, layers, coverage, light.
struct RenderOptions {
  /// The method by which a pixel's splats are composited; null: the A-buffer of SS01 section 6.
  /// sp06/methods.h makes the others.
  std::shared_ptr<const CompositingMethod> method = nullptr;
  Kernel kernel = Kernel::kAuto;
  double kernel_tolerance = 0.1;  ///< Tolerance of Kernel::kAuto, pixels, > 0.
  Filter filter = Filter::kEwa;   ///< kCircular is affine: it needs another kernel than the exact.
  double cutoff = 1;              ///< c: kernels end where beta >= c; 0.1..16. SS01 uses 1.
  double lowpass = 1;  ///< Standard deviation h_s of the low-pass filter, pixels, 0.1..16.
  int layers = 4;      ///< l: fragments per pixel, 1..64, of methods with an A-buffer.
  /// Contributions join a surface within this many footprints of it, > 0. A footprint ends at beta
  /// = 1, or at the cutoff if that is less: the tails of larger cutoffs would mix sheets that are
  /// far apart (20 dB of a transparent scene's at c = 4).
  double depth_epsilon = 1;
  std::optional<double> coverage_threshold;  ///< tau, > 0; unset: coverage_threshold(cutoff).
  bool cull_back = false;  ///< Leave out surfels that face away: for closed, opaque surfaces.
  bool lit = true;         ///< Shade with the scene; else show the filtered texture itself.
  /// Darkens the picture by the relief of its depths. Methods that blend layers cannot.
  Relief relief = Relief::kNone;
  std::array<float, 4> background{0, 0, 0, 0};  ///< Linear R G B, straight alpha.
  /// Surfels of a block of pixels that are set up and sorted at once, 256..2^27. The nearest ones
  /// are drawn before the others are set up, which bounds the memory. Methods that need all splats
  /// of a tile at once do not heed it.
  std::size_t batch = std::size_t{1} << 20;
  /// Of clouds with levels of detail: surfels may stand for pieces of surface with this length on
  /// the longer side, pixels, 0..1000; 0: the finest level alone. Unset: kLodError times the
  /// low-pass filter's deviation, so that neighbours are one deviation apart.
  std::optional<double> lod_error;
  static constexpr double kLodError = 1.4;  ///< About kLongerSide (lod/cut.h).
  /// depth_epsilon in footprints that end at the cutoff.
  double epsilon_share() const { return depth_epsilon / std::sqrt(std::max(1.0, cutoff)); }
  /// lod_error with its default filled in, pixels.
  double lod_pixels() const { return lod_error.value_or(kLodError * lowpass); }
  /// Also make Z, Z.first, N.X, N.Y, N.Z and weight. Methods that blend layers cannot.
  bool aovs = false;

  /// The method in use: `method`, or the A-buffer.
  SURFEL_API const CompositingMethod& compositing() const;
  /// Standard deviation of the pixel filter, pixels: lowpass, or next to nothing with
  /// Filter::kNone, so that a disc seen edge-on keeps a width.
  SURFEL_API double filter_deviation() const;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

}  // namespace surfel
