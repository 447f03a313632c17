#pragma once

// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001 (SS01), and Zhang,
// Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/store/render_cloud.h>
#include <surfel/surface/coverage_threshold.h>

namespace surfel {

class CloudStream;

/// How a kernel is projected.
enum class Kernel : std::uint8_t {
  kAffine,       ///< SS01 (4), (6): linearised at the surfel's centre.
  kPerspective,  ///< SS01 (8): linearised at every pixel (exact_kernel.h).
  kAuto,         ///< The latter where the former may be off by more than kernel_tolerance.
};

/// How a kernel is filtered (SS01 figure 8).
enum class Filter : std::uint8_t {
  kEwa,       ///< SS01 (6): the footprint convolved with the pixel's Gaussian.
  kCircular,  ///< A round kernel as wide as the longer axis of that: blurs where surfaces slant.
  kNone,      ///< The footprint alone: aliases where it is smaller than a pixel.
};

/// What becomes of the splats of a pixel.
enum class Method : std::uint8_t {
  kABuffer,      ///< SS01 section 6: surfaces separated and interpolated as splats arrive.
  kDeferred,     ///< SP06's Algorithm 1, for opaque surfaces: an image for each group, composited.
  kTransparent,  ///< SP06's Algorithm 2: layers blended in each group's image, images averaged.
  kTransparentHigh,  ///< SP06's Algorithm 3: the nearest layer by Algorithm 1, the others by 2.
  kDepthPeel,  ///< One surface after another: the reference that SP06 compares with, and slow.
};

/// Of the groups of SP06, which fragments of a group are of one layer, and which of them stays: see
/// group_raster.h and layer_blend.h.
enum class Voronoi : std::uint8_t {
  kOff,        ///< None are; Algorithm 1 keeps the nearest, Algorithm 2 blends all.
  kQuantised,  ///< Those in one step of the depth, SP06 (6) and (10), with seams between steps.
  kWindowed,   ///< Those nearer than epsilon. The one nearest to its splat's centre stays.
};

struct RenderOptions {
  Method method = Method::kABuffer;
  Voronoi voronoi = Voronoi::kWindowed;  ///< Of the methods with groups.
  int peel = 8;                          ///< Of kDepthPeel: most layers, 1..64.
  Kernel kernel = Kernel::kAuto;
  double kernel_tolerance = 0.1;  ///< Of Kernel::kAuto, pixels, > 0.
  Filter filter = Filter::kEwa;   ///< kCircular is affine: it needs another kernel than the exact.
  double cutoff = 1;              ///< c: kernels end where beta >= c; 0.1..16. SS01 uses 1.
  double lowpass = 1;  ///< Standard deviation h_s of the low-pass filter, pixels, 0.1..16.
  int layers = 3;      ///< l: fragments per pixel of kABuffer and kDeferred, 1..64.
  /// Contributions join a surface within this many footprints of it, > 0. A footprint ends at
  /// beta = 1, or at the cutoff if that is less: what the tails of larger cutoffs reach over would
  /// mix sheets that are far apart (20 dB of a transparent scene's at c = 4).
  double depth_epsilon = 1;
  std::optional<double> coverage_threshold;  ///< tau, > 0; unset: coverage_threshold(cutoff).
  bool cull_back = false;  ///< Leave out surfels that face away: for closed, opaque surfaces.
  bool lit = true;         ///< Shade with the scene; else show the filtered texture itself.
  std::array<float, 4> background{0, 0, 0, 0};  ///< Linear R G B, straight alpha.
  /// Of kABuffer: surfels of a block of pixels that are set up and sorted at once, 256..2^27. The
  /// nearest ones are drawn before the others are set up, which bounds the memory.
  std::size_t batch = std::size_t{1} << 20;
  /// Of clouds with levels of detail: surfels may stand for pieces of surface with this length on
  /// the longer side, pixels, 0..1000; 0: the finest level alone. Unset: kLodError times the
  /// low-pass filter's deviation, so that neighbours are one deviation apart.
  std::optional<double> lod_error;
  static constexpr double kLodError = 1.4;
  /// depth_epsilon in footprints that end at the cutoff.
  double epsilon_share() const { return depth_epsilon / std::sqrt(std::max(1.0, cutoff)); }
  /// lod_error with its default filled in, pixels.
  double lod_pixels() const { return lod_error.value_or(kLodError * lowpass); }
  bool aovs = false;  ///< Also make Z, Z.first, N.X, N.Y, N.Z and weight; not where layers are
                      ///< blended.

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// The columns that a method needs of a RenderCloud.
SURFEL_API RenderColumns columns_of(Method method);

/// What one frame cost and did.
struct FrameStatistics {
  double milliseconds = 0;
  StageTimes stages;                  ///< cull, read (a CloudStream), raster.
  std::size_t clusters = 0;           ///< Drawn, of all.
  std::size_t splats = 0;             ///< Set up and inside the picture ...
  std::size_t exact_splats = 0;       ///< ... of these with perspective-exact kernels.
  std::uint64_t merged = 0;           ///< Pairs of fragments merged because all layers were taken.
  double late_weight_share = 0;       ///< Share of the sum of rho that came too late for its merged
                                      ///< surface: a bound of the error that merging made.
  int groups = 0;                     ///< SP06's K; 0 without groups.
  std::uint64_t culled = 0;           ///< Fragments culled by SP06 (6): the layer had one already.
  int peeled_layers = 0;              ///< Most layers that a tile has, of `peel` at most.
  std::uint64_t unpeeled_pixels = 0;  ///< Pixels with more layers than that, which are left out.
};

/// Renders a cloud by screen space EWA splatting: clusters are culled, sorted front to back and
/// listed by block of pixels; one thread sets up the splats of a block, sorts them into its tiles,
/// rasterises and resolves these. The picture does not depend on the number of threads, nor on the
/// order of the surfels.
///
/// Memory: of each thread 128 bytes for every splat of its block, 20 bytes for every tile it
/// touches, and the A-buffer of a tile, or of a block where the splats are more than a batch. The
/// methods other than kABuffer need all splats of a block at once, and the images of a tile: 6 KB
/// for each group and layer of Algorithm 1, 24 KB for each group of Algorithm 2.
class SURFEL_API Renderer {
 public:
  /// Keeps references to the cloud and the scene. Throws Error(kUsage) for options that are not
  /// usable, and for kDeferred of what is transparent; Error(kInput) if the cloud was made without
  /// columns_of(method).
  Renderer(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options);
  /// Of a cloud that stays in its file and is read anew for each picture, nearest clusters first, a
  /// batch of the stream at a time. The A-buffers of all tiles are kept meanwhile. The same bytes
  /// as in memory where what is seen fits into one batch; else fragments may merge in another
  /// order. Keeps a reference. Error(kUsage) for other methods than kABuffer.
  Renderer(CloudStream& stream, const Scene& scene, const RenderOptions& options);
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Premultiplied linear R G B A over the background, then Z (depth along the view where opacity
  /// passes one half, infinity where it never does), Z.first (of the nearest surface), N.X N.Y N.Z
  /// (world axes) and weight (sum of rho of the nearest surface) if asked for.
  Image render(const Camera& camera, FrameStatistics* statistics = nullptr);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
