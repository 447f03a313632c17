#pragma once

// How methods of compositing plug into the Renderer. A CompositingMethod is chosen by the user and
// belongs to RenderOptions; a Compositor belongs to one Renderer; a Compositor::Worker belongs to
// one thread and owns the memory that drawing a tile needs.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/render/depth_sort.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

struct Fragment;
class Shader;
struct TileABuffer;
struct TileJob;

/// Figures of one frame: times, and numbers of splats, clusters and fragments.
struct FrameStatistics {
  double milliseconds = 0;
  StageTimes stages;             ///< cull, read (from the store's file), raster.
  std::size_t clusters = 0;      ///< Clusters drawn.
  std::size_t splats = 0;        ///< Splats set up and inside the picture.
  std::size_t exact_splats = 0;  ///< Splats among them that have perspective-exact kernels.
  /// Splats that tiles left out, added up over the tiles, since hundreds larger than a tile lie
  /// over each other there; the others stand for them.
  std::size_t thinned_splats = 0;
  /// Most passes over its splats that a tile took: the number of times that a GPU would draw the
  /// geometry.
  int geometry_passes = 0;
  /// Pixels of all splats, in all passes, where beta < c. Splats that are skipped in a patch of
  /// pixels, as something in front of them hides them there, have none in it.
  std::uint64_t fragments = 0;
  std::uint64_t merged = 0;  ///< Pairs of fragments merged because all layers were taken.
  /// Share of the sum of rho that came too late for its merged surface: a bound of the error that
  /// merging made.
  double late_weight_share = 0;
  int groups = 0;            ///< SP06's K; 0 without groups.
  std::uint64_t culled = 0;  ///< Fragments culled by SP06 (6): their layer had a fragment already.
  int peeled_layers = 0;     ///< Most layers that a pixel has, as far as they were peeled.
  std::uint64_t unpeeled_pixels = 0;  ///< Pixels with more layers than were peeled.

  /// Adds what was counted of another picture, or of another part of one.
  SURFEL_API void add(const FrameStatistics& other);
};

/// The surfels of a cloud in groups that a list has.
enum class ListedSurfels : std::uint8_t {
  kAll,
  kOriginals,  ///< All but copies (RenderColumns::copies), so that each disc is there once.
  kAdditions,  ///< Copies, and surfels whose groups enlarge them.
};

/// Most splats larger than a tile that a tile draws one by one, so that its time is bounded.
/// Hundreds of surfaces over each other have fewer, as about six kernels of cutoff 1 reach a place
/// of each.
inline constexpr std::size_t kMostLargeSplats = 2048;

/// The rules by which surfels become the splats of a list.
struct SplatListOptions {
  ListedSurfels surfels = ListedSurfels::kAll;
  bool groups = false;                   ///< Splats carry their groups.
  DepthOrder order = DepthOrder::kFine;  ///< Order of a tile's splats.
  /// Discs have the enlarged radius of their group (SP06 section 4.2.2), where the cloud has it.
  bool enlarged = false;
  double lowpass = 1;  ///< Standard deviation of the pixel filter, pixels.
  /// Splats are listed, and have boxes, so many pixels beyond their kernels.
  double margin = 0;
  /// Splats of one surface may come as sheets.
  bool sheets = false;
  /// Splats larger than a tile that a tile draws where it has more than kMostLargeSplats of them:
  /// the fewer, the more often a method goes over them.
  std::size_t large_splats = 256;
  /// Splats that are smaller than the pixel filter, and that half-planes cut, get whole kernels
  /// with the volume, the mean and the variance of the cut ones: EdgeCoverage tells where their
  /// surfaces end.
  bool edges_filtered = false;
};

/// Turns the splats of tiles into fragments of A-buffers.
class SURFEL_API Compositor {
 public:
  /// The part of a compositor that one thread owns.
  class SURFEL_API Worker {
   public:
    virtual ~Worker() = default;
    /// Draws a tile: fills its A-buffer, which is empty unless the method takes splats in parts.
    /// \param jobs  The tile's splats, parallel to Compositor::lists().
    /// \param tile  The A-buffer of the tile.
    virtual void draw(std::span<const TileJob> jobs, TileABuffer& tile) = 0;
    /// Empties the A-buffer of a tile.
    virtual void clear(const TileABuffer& tile);
    /// All splats of a tile have been drawn.
    virtual void finish(TileABuffer& /*tile*/) {}
    /// A merged fragment behind all layers of the A-buffer of a pixel of the tile drawn last: its
    /// kCovered counts where there is an environment, and its depths do not. Only called if
    /// Compositor::has_background().
    virtual Fragment behind(int pixel) const;
    /// Whether a pixel of the tile drawn last depends on other tiles, and is left to complete().
    /// Only called if Compositor::has_background().
    virtual bool waits(const TileABuffer& /*tile*/, int /*pixel*/) const { return false; }
    /// Adds this worker's counts to the statistics, and sets them to 0.
    virtual void take_statistics(FrameStatistics& /*statistics*/) {}
  };

  virtual ~Compositor() = default;
  /// The lists of splats that are drawn, one or more. Where splats come in batches, only the first
  /// list does.
  virtual std::vector<SplatListOptions> lists() const = 0;
  /// Fragments per pixel of the A-buffer, 1..kMostLayers.
  virtual int layers() const = 0;
  /// Pixels show something behind the fragments of their A-buffer: Worker::behind().
  virtual bool has_background() const { return false; }
  /// The fragments of a pixel of opaque surfaces have all of its sums of rho.
  virtual bool sums_are_whole() const { return false; }
  /// Begins a picture. No worker draws meanwhile.
  virtual void begin(const Camera& /*camera*/) {}
  /// The worker refers to this.
  virtual std::unique_ptr<Worker> make_worker() const = 0;
  /// Completes the fragments of a pixel of the picture that waits, when all tiles have been drawn:
  /// the A-buffer's, nearest first, and the one behind them. Called for different pixels at once.
  virtual void complete(const Shader& /*shader*/, int /*x*/, int /*y*/,
                        std::span<Fragment> /*fragments*/) const {}
};

/// A way to composite splats, with its own options. Immutable: any number of Renderers may share
/// one.
class SURFEL_API CompositingMethod {
 public:
  virtual ~CompositingMethod() = default;
  /// Empty if the method can be used with these options, else one sentence per violated rule.
  virtual std::vector<std::string> problems(const RenderOptions& /*options*/) const { return {}; }
  /// The optional columns of a RenderCloud that the method needs.
  virtual RenderColumns columns() const { return {}; }
  /// All splats of a tile must be there at once, so that all surfels must be in memory.
  virtual bool needs_whole_tiles() const { return true; }
  /// Throws Error if the method cannot draw this cloud. The compositor keeps references to both.
  /// \param cloud    The surfels of all pictures to come.
  /// \param options  The options of all pictures to come.
  /// \param opaque   No surfel, nor any material, has an opacity below 1.
  virtual std::unique_ptr<Compositor> make(const RenderCloud& cloud, const RenderOptions& options,
                                           bool opaque) const = 0;
};

/// SS01 section 6: surfaces are separated and interpolated as splats arrive.
SURFEL_API const CompositingMethod& a_buffer_method();

}  // namespace surfel
