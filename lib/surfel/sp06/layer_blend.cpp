// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 2.

#include <algorithm>
#include <array>
#include <bit>
#include <numeric>
#include <utility>

#include <surfel/render/shading.h>
#include <surfel/sp06/group_layers.h>
#include <surfel/sp06/joint_layers.h>
#include <surfel/sp06/layer_blend.h>

namespace surfel {
namespace {

/// The fragment of a lit splat that covers its pixel.
Fragment covering_fragment(const TileJob& job, std::uint32_t splat, float depth) {
  return unmerged({1, depth, job.splats[splat], job.normals ? job.normals + splat : nullptr, {}});
}

/// Weight of a nearest fragment in its pixel's mean, by sqrt(beta / cutoff). Fragments count most
/// near their splat's centre and next to nothing at its rim: the groups' splats are flat, and the
/// mean normal and the refracted light are to have no steps there.
float nearest_weight(float key) {
  // It is not 0 at the rim, so that a pixel without other fragments has a normal.
  constexpr float kAtRim = 1e-3F;
  const float inside = std::max(0.0F, 1 - key * key);
  return std::max(kAtRim, inside * inside);
}

void add_scaled(Rgba& to, float scale, const Rgba& color) {
  to.red += scale * color.red;
  to.green += scale * color.green;
  to.blue += scale * color.blue;
  to.alpha += scale * color.alpha;
}

/// The mean number of layers of the groups, without the quarter of the groups that has the fewest
/// and the quarter that has the most: a single large disc that sticks out of a bent surface is a
/// layer more, and refraction by one layer more goes elsewhere. Where this mean is 0, all groups
/// are taken.
float mean_count(std::vector<float> counts) {
  const auto groups = static_cast<std::ptrdiff_t>(counts.size());
  const std::ptrdiff_t cut = groups / 4;
  std::sort(counts.begin(), counts.end());
  const auto mean = [&](std::ptrdiff_t left_out) {
    const float sum = std::accumulate(counts.begin() + left_out, counts.end() - left_out, 0.0F);
    return sum / static_cast<float>(groups - 2 * left_out);
  };
  const float inner = mean(cut);
  return inner > 0 ? inner : mean(0);
}

/// A pixel of a group's image.
struct GroupImage {
  std::array<Rgba, kLayerSamples> color{};     ///< Colour of the layers that have been blended ...
  std::array<float, kLayerSamples> touched{};  ///< ... and the share that these cover.
  float layers = 0;                            ///< Number of layers, each counted by its share.
  /// The nearest layer, which is not blended where there is an environment.
  const GroupMember* nearest = nullptr;
};

/// Blends the layers of a tile, pixel by pixel.
class LayerBlender {
 public:
  LayerBlender(const LayerSplats& splats, bool by_group, PictureLayers& picture,
               const TileABuffer& tile, LayerScratch& scratch)
      : splats_(splats),
        by_group_(by_group),
        samples_(by_group ? kLayerSamples : 1),
        picture_(picture),
        tile_(tile),
        scratch_(scratch),
        images_(static_cast<std::size_t>(picture.groups())) {}

  void run() {
    const bool environment = tile_.shader->has_environment();
    for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
      if (!in_picture(tile_, pixel)) continue;
      blend(pixel);
      if (environment) {
        collect(pixel);
      } else if (!scratch_.stacks[pixel].layers.empty()) {
        scratch_.merged[pixel] = mean();
      }
    }
    for (std::size_t pixel = 0; environment && pixel < kTilePixels; ++pixel) {
      if (in_picture(tile_, pixel)) merge(pixel);
    }
  }

 private:
  int x_of(std::size_t pixel) const { return tile_.x0 + tile_pixel_x(static_cast<int>(pixel)); }
  int y_of(std::size_t pixel) const { return tile_.y0 + tile_pixel_y(static_cast<int>(pixel)); }

  /// Blends a pixel's layers, farthest first; where there is an environment, all but each group's
  /// nearest.
  void blend(std::size_t pixel) {
    LayerStack& stack = scratch_.stacks[pixel];
    std::fill(images_.begin(), images_.end(), GroupImage{});
    std::sort(stack.members.begin(), stack.members.end(),
              [&](const GroupMember& a, const GroupMember& b) {
                return std::pair(stack.layers[a.layer].place, a.layer) <
                       std::pair(stack.layers[b.layer].place, b.layer);
              });
    for (const GroupMember& member : stack.members) {
      GroupImage& image = images_[member.group];
      const PixelLayer& layer = stack.layers[member.layer];
      image.layers += coverage(layer);
      const GroupMember* blended = &member;
      if (tile_.shader->has_environment()) blended = std::exchange(image.nearest, blended);
      if (blended) put(pixel, stack.layers[blended->layer], *blended, image);
    }
  }

  /// The share of a sample that a layer covers.
  static float coverage(const PixelLayer& layer, int sample) {
    return (layer.samples >> sample & 1U) != 0 ? layer.share : 0;
  }
  /// The share of a pixel.
  float coverage(const PixelLayer& layer) const {
    return layer.share * static_cast<float>(std::popcount(layer.samples)) /
           static_cast<float>(samples_);
  }

  void put(std::size_t pixel, const PixelLayer& layer, const GroupMember& member,
           GroupImage& image) {
    const Rgba color = color_of(pixel, layer, member);
    for (int i = 0; i < samples_; ++i) {
      const float share = coverage(layer, i);
      Rgba& sample = image.color[i];
      Rgba sum{};
      add_scaled(sum, share, color);
      add_scaled(sum, 1 - share * color.alpha, sample);
      sample = sum;
      image.touched[i] += share * (1 - image.touched[i]);
    }
  }

  /// Shades a fragment. Splats that reflect an environment are shaded at their centre, once a load,
  /// as they are flat and their pixels' colours hardly differ; but where their kernels are exact,
  /// as they are large and their centre is not known.
  Rgba color_of(std::size_t pixel, const PixelLayer& layer, const GroupMember& member) {
    const TileJob& job = splats_.job(member);
    const Splat& splat = job.splats[member.splat];
    const Shader& shader = *tile_.shader;
    if (splat.k < 0 || !shader.has_environment()) {
      return shader.shade(covering_fragment(job, member.splat, layer.depth),
                          static_cast<float>(x_of(pixel)) + 0.5F,
                          static_cast<float>(y_of(pixel)) + 0.5F, 1);
    }
    ShadedSplats& shaded = member.added ? scratch_.shaded_added : scratch_.shaded;
    Rgba& color = shaded.colors[member.splat];
    if (std::exchange(shaded.loads[member.splat], job.load) != job.load) {
      color = shader.shade(covering_fragment(job, member.splat, splat.depth), splat.x, splat.y, 1);
    }
    return color;
  }

  /// The mean of the groups' images.
  Fragment mean() const {
    Rgba sum{};
    for (const GroupImage& image : images_) {
      for (const Rgba& sample : image.color) add_scaled(sum, 1, sample);
    }
    Fragment out{};
    const float count = static_cast<float>(picture_.groups() * samples_);
    out.channel[kWeight] = -1;
    out.channel[kRed] = sum.red / count;
    out.channel[kGreen] = sum.green / count;
    out.channel[kBlue] = sum.blue / count;
    out.channel[kAlpha] = sum.alpha / count;
    return out;
  }

  /// Collects the groups that have a layer in a pixel, and sums up their nearest.
  void collect(std::size_t pixel) {
    const LayerStack& stack = scratch_.stacks[pixel];
    PictureLayers::Surface surface{0, Vec3f(0, 0, 0)};
    scratch_.groups[pixel].clear();
    for (const GroupImage& image : images_) {
      if (!image.nearest) continue;
      const GroupMember& member = *image.nearest;
      const PixelLayer& layer = stack.layers[member.layer];
      const TileJob& job = splats_.job(member);
      const SplatNormal& normal = job.normals[member.splat];
      const float weight = nearest_weight(member.key) * (by_group_ ? coverage(layer) : 1);
      surface.weight += weight;
      surface.normal += weight * Vec3f(normal.x, normal.y, normal.z);
      scratch_.groups[pixel].push_back(
          group_pixel(image, layer, covering_fragment(job, member.splat, layer.depth)));
    }
    picture_.nearest(x_of(pixel), y_of(pixel)) = surface;
    picture_.layers(x_of(pixel), y_of(pixel)) = count_layers(stack);
  }

  PictureLayers::GroupPixel group_pixel(const GroupImage& image, const PixelLayer& nearest,
                                        const Fragment& fragment) const {
    PictureLayers::GroupPixel out{fragment, {}, {}, coverage(nearest), 0};
    const float part = 1 / static_cast<float>(samples_);
    for (int i = 0; i < samples_; ++i) {
      const float share = coverage(nearest, i);
      add_scaled(out.beneath, part * share, image.color[i]);
      add_scaled(out.beside, part * (1 - share), image.color[i]);
      out.touched += part * (share + (1 - share) * image.touched[i]);
    }
    return out;
  }

  /// The number of a pixel's layers, each counted by its share.
  float count_layers(const LayerStack& stack) const {
    if (by_group_) {
      std::vector<float> counts;
      for (const GroupImage& image : images_) counts.push_back(image.layers);
      return mean_count(std::move(counts));
    }
    float layers = 0;
    for (const PixelLayer& layer : stack.layers) layers += layer.share;
    return layers;
  }

  /// Merges the groups of a pixel, with an environment around. Pixels at_border() are kept for
  /// later.
  void merge(std::size_t pixel) {
    const int x = x_of(pixel);
    const int y = y_of(pixel);
    const auto& groups = scratch_.groups[pixel];
    if (picture_.at_border(x, y)) {
      picture_.keep(x, y, groups);
    } else {
      scratch_.merged[pixel] = picture_.merged(*tile_.shader, x, y, groups);
    }
  }

  const LayerSplats& splats_;
  bool by_group_;
  int samples_;  ///< Samples of a pixel.
  PictureLayers& picture_;
  const TileABuffer& tile_;
  LayerScratch& scratch_;
  std::vector<GroupImage> images_;  ///< Images of the pixel at hand.
};

}  // namespace

void ShadedSplats::reserve(const TileJob& job) {
  if (job.count == 0) return;
  const std::size_t splats = *std::max_element(job.order, job.order + job.count) + std::size_t{1};
  if (colors.size() >= splats) return;
  colors.resize(2 * splats);
  loads.resize(2 * splats, 0);
}

std::uint64_t blend_layers(const LayerSplats& splats, const LayerRule* rule, PictureLayers& picture,
                           const NearestLayer* masked, const TileABuffer& tile,
                           LayerScratch& scratch) {
  for (LayerStack& stack : scratch.stacks) {
    stack.layers.clear();
    stack.members.clear();
  }
  scratch.merged.assign(kTilePixels, Fragment{});
  if (tile.shader->has_environment()) {
    scratch.shaded.reserve(*splats.discs);
    if (splats.added) scratch.shaded_added.reserve(*splats.added);
  }
  const std::uint64_t culled =
      rule ? tell_group_layers(*splats.discs, *rule, picture.groups(), masked, tile, scratch.stacks)
           : tell_joint_layers(splats, masked, tile, scratch.stacks);
  LayerBlender(splats, rule != nullptr, picture, tile, scratch).run();
  return culled;
}

}  // namespace surfel
