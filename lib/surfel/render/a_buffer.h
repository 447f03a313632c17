#pragma once

// SS01 section 6 and table 1; design notes in lib/README.md.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>

#include <surfel/render/splat.h>

namespace surfel {

/// A fragment is one surface in one pixel (SS01 table 1): sums over the surface's contributions,
/// each weighted by its resampling kernel rho. kPatchPixels floats each.
enum FragmentChannel : int {
  kWeight,  ///< Sum of rho; 0 = free; shaded and merged: how many surfaces it holds, negative.
  kDepth,   ///< Sum of rho * depth; merged: the nearest fragment's depth.
  kRed,     ///< Sum of rho * alpha * colour; merged: composite, premultiplied.
  kGreen,
  kBlue,
  kAlpha,    ///< Sum of rho * alpha (not kept where all splats are opaque); merged: opacity.
  kTag,      ///< Splat::tag of the first contribution, as bits; merged: the nearest fragment's.
  kBack,     ///< Merged only: the farthest fragment's depth.
  kNormalX,  ///< Sum of rho * normal, only in shaded pictures; merged: the nearest one's mean.
  kNormalY,
  kNormalZ,
  /// Only in pictures with clipped surfels, and of unmerged fragments: sums over the contributions
  /// that half-planes cut, with C the share that they leave and C_j each line's own share.
  kCutAway,     ///< Sum of rho (1 - C) / C times SplatClip::beyond: what kWeight lacks.
  kCutPartial,  ///< Sum of rho (1 - C_j) ...
  kCutX,        ///< ... and of that times SplatClip::outward.
  kCutY,
  kFragmentChannels,
  /// The number of a second material plus its share, at most 1/2, of the contributions' weight; 0:
  /// all contributions are of the tag's material. Fragments merged in the A-buffer have kBack here
  /// instead.
  kOther = kBack,
  /// In unmerged fragments of pictures with ABufferLayout::planes: the DepthSlope of the first
  /// contribution, packed.
  kSlope = kAlpha,
  kCovered = kDepth,  ///< Of Compositor::Worker::behind(): the share of the pixel that it covers.
};

/// Most fragments that a pixel may keep.
inline constexpr int kMostLayers = 64;

/// An opacity from which on nothing behind is seen in 8 bits, with room to spare.
inline constexpr float kOpaqueAlpha = 0.9995F;

/// Lines that take no more than this share of a surface's sum leave it whole, in 8 bits.
inline constexpr float kWholeCutAway = 1e-3F;

/// Fragments whose sums of rho together are up to kOneSurface of the mean sum are parts of one
/// surface; sums of several whole ones are more than kSeveralSurfaces of it.
inline constexpr float kOneSurface = 1.15F;
inline constexpr float kSeveralSurfaces = 1.35F;

/// The two sides of a body at its silhouette are not further apart than this part of their
/// distance, as a rule.
inline constexpr float kRimDepth = 0.02F;

/// Shape of a tile's A-buffer: patches x layers x channels x kPatchPixels floats. The values of a
/// vector of pixels lie together: planes of a whole tile would be a power of two apart, which
/// caches and the order of loads behind stores suffer from.
struct ABufferLayout {
  int layers = 1;
  bool normals = false;
  bool opaque = false;  ///< Every splat has alpha 1: kAlpha is kWeight, except in merged fragments.
  bool clips = false;   ///< Splats may be cut by half-planes.
  bool planes = false;  ///< Fragments have a kSlope, in opaque pictures.

  int channels() const { return clips ? kFragmentChannels : normals ? kNormalZ + 1 : kBack + 1; }
  std::size_t layer_stride() const { return static_cast<std::size_t>(channels()) * kPatchPixels; }
  std::size_t patch_stride() const { return layer_stride() * static_cast<std::size_t>(layers); }
  std::size_t size() const { return patch_stride() * (kTilePixels / kPatchPixels); }
};

/// One fragment of one pixel, by value.
struct Fragment {
  float channel[kFragmentChannels];
  std::uint32_t slope = 0;  ///< DepthSlope, packed; 0 where it is not known.
};

inline bool is_merged(const Fragment& fragment) { return fragment.channel[kWeight] < 0; }
/// Depth of a fragment, or of the nearest surface in a merged one.
inline float front_depth(const Fragment& fragment) {
  return is_merged(fragment) ? fragment.channel[kDepth]
                             : fragment.channel[kDepth] / fragment.channel[kWeight];
}
/// Tests of a fragment's kTag for its flags.
inline bool shows_front(float tag) { return (std::bit_cast<std::uint32_t>(tag) & kFrontTag) != 0; }
inline bool is_filtered(float tag) {
  return (std::bit_cast<std::uint32_t>(tag) & kFilteredTag) != 0;
}
/// Do the planes of its splats tell its depth better than their footprints do?
inline bool is_even(float tag) { return (std::bit_cast<std::uint32_t>(tag) & kEvenTag) != 0; }
inline bool is_grazing(float tag) { return (std::bit_cast<std::uint32_t>(tag) & kGrazingTag) != 0; }

/// A fragment's kOther.
struct OtherMaterial {
  std::uint32_t material;
  float share;  ///< 0: there is none.

  explicit OtherMaterial(float channel)
      : material(static_cast<std::uint32_t>(channel)),
        share(channel - static_cast<float>(material)) {}
};
/// The fragment as if all its contributions were of one material.
inline Fragment of_material(Fragment fragment, std::uint32_t material) {
  const auto tag = std::bit_cast<std::uint32_t>(fragment.channel[kTag]);
  const std::uint32_t flags = tag & ((1U << kMaterialShift) - 1);
  fragment.channel[kTag] = std::bit_cast<float>(flags | material << kMaterialShift);
  fragment.channel[kOther] = 0;
  return fragment;
}

/// Sums up the materials of contributions. Two materials are told apart, the first one and the
/// latest other one, which stands for all others.
class MaterialShares {
 public:
  void add(float tag, float weight) {
    const std::uint32_t material = std::bit_cast<std::uint32_t>(tag) >> kMaterialShift;
    if (!(first_weight_ > 0)) first_ = material;
    if (material != first_) other_ = material;
    (material == first_ ? first_weight_ : other_weight_) += weight;
  }
  /// Sets the material of the fragment's tag, and its kOther.
  void store(Fragment& fragment) const {
    const bool more = first_weight_ >= other_weight_;
    fragment = of_material(fragment, more ? first_ : other_);
    const float share = std::min(first_weight_, other_weight_) / (first_weight_ + other_weight_);
    if (share > 0) fragment.channel[kOther] = static_cast<float>(more ? other_ : first_) + share;
  }

 private:
  std::uint32_t first_ = 0, other_ = 0;
  float first_weight_ = 0, other_weight_ = 0;
};

/// Colour with premultiplied opacity.
struct Rgba {
  float red = 0, green = 0, blue = 0, alpha = 0;

  /// Front-to-back compositing, SS01 (12): this over `back`.
  void composite(const Rgba& back) {
    const float transmitted = 1.0F - alpha;
    red += transmitted * back.red;
    green += transmitted * back.green;
    blue += transmitted * back.blue;
    alpha += transmitted * back.alpha;
  }
};

/// The errors that merging made, summed over a frame.
struct MergeStatistics {
  std::uint64_t merged = 0;  ///< Pairs of fragments merged.
  std::uint64_t late = 0;    ///< Contributions that came after their surface had been merged ...
  double late_weight = 0;    ///< ... and the sum of their rho.
  double total_weight = 0;   ///< Sum of rho of all fragments at the end (merged ones left out).

  void add(const MergeStatistics& other) {
    merged += other.merged;
    late += other.late;
    late_weight += other.late_weight;
    total_weight += other.total_weight;
  }
};

class EdgeFilter;
class Shader;
struct OpenPixels;

/// A tile being rasterised: its A-buffer, and the weights and the shader that merging needs.
struct TileABuffer {
  ABufferLayout layout;
  float* data = nullptr;
  int x0 = 0, y0 = 0;     ///< Top left pixel of the tile in the picture.
  int width = kTileSize;  ///< Pixels of the tile inside the picture.
  int height = kTileSize;
  int picture_width = kTileSize;
  int picture_height = kTileSize;
  float full_weight = 1;  ///< tau: a surface whose rho sum up to this covers the pixel.
  float edge_weight = 1;  ///< The sum of rho from which a surface covers the pixel at its edge, and
                          ///< hides all surfaces behind it; >= tau.
  float mean_weight = 1;  ///< The mean sum of rho within a surface.
  /// No edge is looked for where the sum of rho of a pixel's last fragment is this or more.
  float inside_weight = 1;
  /// EdgeCoverage sets the opacities at edges, so that a pixel's only fragment need not look at the
  /// pixels around.
  bool edges_later = false;
  /// Null: surfaces cover by tau alone what they cover, at their edges, too.
  const EdgeFilter* edge_filter = nullptr;
  const Shader* shader = nullptr;
  MergeStatistics merges;

  /// Weight of a fragment: the other channels follow at distances of kPatchPixels.
  float* fragment(int layer, std::size_t pixel) const {
    return data + layout.patch_stride() * (pixel / kPatchPixels) +
           layout.layer_stride() * static_cast<std::size_t>(layer) + pixel % kPatchPixels;
  }
  /// Share of a pixel that an unmerged fragment covers, 0..1.
  /// \param edge  To what degree the pixel is at the edge of its surface, 0..1.
  float coverage(const Fragment& fragment, float edge) const {
    return std::min(1.0F, fragment.channel[kWeight] / full_weight_of(fragment, edge));
  }
  /// The sum of rho from which on an unmerged fragment covers the pixel. Where lines cut its
  /// splats, that is the sum that they would have without: the ratio is the share that the lines
  /// leave, whatever the sums are. Surfels on both sides of a crease count twice in that sum, and
  /// cover the pixel together: their lines' outward vectors cancel each other, and where these do
  /// the fragment's sum counts as everywhere.
  float full_weight_of(const Fragment& fragment, float edge) const {
    const bool cut = layout.clips && fragment.channel[kCutPartial] > 0;
    return cut ? full_weight_of_cut(fragment, edge) : weight_at_edge(edge);
  }
  /// Of a fragment that lines cut.
  float full_weight_of_cut(const Fragment& fragment, float edge) const;
  /// The mean of the outward vectors of one line's surfels, however bent, has this length at least,
  /// and the mean of two sides of a crease, however uneven the sums of the sides, has less than
  /// this.
  static constexpr float kOneSide = 0.95F;
  static constexpr float kTwoSides = 0.4F;
  /// Where three surfaces meet at a corner their lines' outward vectors need not cancel each other,
  /// and their mean may have this length; but the fragment's sum is then nearly as large as inside
  /// a surface. As it comes from the first to the second share of that, it counts as everywhere.
  static constexpr float kCorner = 0.8F;
  static constexpr float kUncovered = 0.75F;
  static constexpr float kCovered = 1.05F;
  /// The sum of rho from which on a surface covers a pixel.
  float weight_at_edge(float edge) const {
    return full_weight + (edge_weight - full_weight) * edge;
  }
  /// The depth behind which nothing of a patch is seen that opaque surfaces cover: behind the
  /// farthest of its pixels' nearest surfaces, as they go on for some pixels beyond the patch, and
  /// a few pixels' depth further. There a surface may end, or cross what lies behind, of which the
  /// pixel filter sees a part.
  /// \param nearest, farthest  among the depths of those surfaces; minus infinity: a pixel has
  /// none.
  float hidden_behind(float nearest, float farthest) const;
  float& at(int layer, int channel, int pixel) {
    return fragment(layer, static_cast<std::size_t>(pixel))[channel * kPatchPixels];
  }
};

/// To what degree merged fragments of filtered splats are taken to be at an edge: see
/// insert_by_merging().
inline constexpr float kMergedEdge = 0.8F;

/// A splat's contribution to a pixel.
struct PixelContribution {
  float rho, depth;
  const Splat& splat;
  const SplatNormal* normal;  ///< Null in unshaded pictures.
  float cut[4];               ///< What is added to kCutAway and the channels that follow.
};

/// A contribution that matches no fragment of a pixel whose layers are all taken, nor lies within a
/// merged pair: steps 2 and 3 of SS01 section 6. It joins the fragment next to it in depth if the
/// fragment shows the same side and does not cover the pixel yet: without this, a grazing surface,
/// which is deeper within a pixel than epsilon, takes all layers and leaves holes. Otherwise, as
/// contributions arrive roughly front to back, the nearest two fragments are the ones that are
/// complete: they are shaded and composited (12), and the free layer goes to the newcomer. With a
/// single layer the nearer surface stays.
/// \param fresh  the contribution, or the sums over several of one surface.
/// \param depth  its depth.
void insert_by_merging(TileABuffer& tile, int pixel, const Fragment& fresh, float depth);

/// Does a fragment, its edges aside, hide what lies behind it?
bool covers(const TileABuffer& tile, const Fragment& fragment);

/// Puts a fragment that shows its front, for which there is no layer, in the place of the farthest
/// one that shows its back and lies behind a depth: that is the far side of a body. False if there
/// is none.
/// \param depth  of a surface that covers the pixel.
bool replace_back(TileABuffer& tile, int pixel, const Fragment& fresh, float depth);

/// Drops the fragments of a pixel that lie behind a depth, and behind the surface that covers it
/// the unmerged ones that show their backs.
/// \param covering  the depth of the nearest surface that covers the pixel; minus infinity: none.
void drop_behind(TileABuffer& tile, int pixel, float depth, float covering);

/// Reads the fragment of a pixel's layer, in place: a copy would wait for the stores. A channel
/// that the tile's layout leaves out becomes 0; kAlpha becomes the weight in tiles of opaque
/// splats.
void load_fragment(const TileABuffer& tile, int layer, int pixel, Fragment& fragment);

/// A contribution as a fragment of its own.
Fragment unmerged(const PixelContribution& contribution);

/// A contribution that comes after its surface has been merged into `layer`: composites it into the
/// share that the merged surfaces leave open. For opaque surfaces, where the order behind them
/// matters less than that nothing is missing.
void add_to_merged_layer(TileABuffer& tile, int layer, int pixel, const Fragment& fresh);

/// Nearest surface of a pixel.
struct NearestLayer {
  /// Nearness, as in Splat::depth; stays so where there is no layer.
  float depth = -std::numeric_limits<float>::infinity();
  bool front = false;  ///< The side that is seen.
};
/// The nearest layer of a pixel, if it is unmerged.
NearestLayer nearest_layer(TileABuffer& tile, int pixel);

/// Per-pixel result of a tile.
struct PixelResult {
  Rgba color;
  float opacity = 0;      ///< Of the fragments, without the environment.
  float depth = 0;        ///< z where opacity passes one half; infinity if it stays below.
  float depth_first = 0;  ///< z of the nearest fragment; infinity if there is none.
  /// Unit normal of the nearest unmerged fragment; zero if there is none.
  float normal[3] = {0, 0, 0};
  float weight = 0;  ///< Sum of rho of the nearest fragment.
};

/// Shades, weighs by coverage (SS01 section 7) and composites a pixel's fragments front to back.
///
/// Coverage is the sum of rho over a weight that is tau inside a surface, below the least sum
/// there. At its edge, where the sum falls with the surface's share of the pixel, tau would make it
/// too large (0.4 to 0.7 pixels): there an EdgeFilter tells it by the surface's sums in the pixels
/// around, in which a fragment belongs to the surface next to it in depth, whatever lies behind.
/// That tells nothing where splats are larger than the pixel filter, so that edges are looked for
/// only where they are not (kFilteredTag).
///
/// Opaque fragments of one side, none of which has a whole sum of rho, while all of them together
/// have one, share what they cover by their sums: where the pixel's kernel crosses a fold, a step,
/// or the line in which two bodies meet, the nearest one would hide the others (tau).
///
/// The two sides of one body at its silhouette cover the same part of the pixel, while unrelated
/// surfaces cover independent parts (12). They are a front-facing fragment at an edge, or seen at a
/// grazing angle, and a back-facing one behind it, seen at a grazing angle in the latter case; and
/// a back-facing fragment nearer than a front-facing one, where neither covers the whole pixel or
/// both are close together and seen at a grazing angle: there kernels reach beyond the silhouette,
/// where the tangent planes of the two sides have crossed, and the front is seen. At grazing angles
/// it lends its colour to what the back covers and the front does not. Of opaque surfaces whose
/// splats are no larger than the pixel filter, the far side of a body is known by the pixels
/// around, at any angle: a front is close by, and nowhere is the back the nearest surface with a
/// whole sum. Where an edge, or a fragment, depends on another tile, the pixel is added to `open`
/// instead.
///
/// \param rest   a merged fragment that lies behind all others; of weight 0: none.
/// \param waits  the fragments depend on other tiles.
std::optional<PixelResult> resolve_pixel(TileABuffer& tile, int pixel, const Fragment& rest,
                                         bool waits, OpenPixels& open);

}  // namespace surfel
