// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 2.

#include <algorithm>
#include <array>
#include <bit>
#include <numeric>

#include <surfel/render/shading.h>
#include <surfel/sp06/joint_blend.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/joint_blend.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/function_ref.h>
#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// Calls take(pixel, fragment) for all fragments of a tile; the fragments of a pixel come in the
/// job's order of splats, and say neither side nor group.
void for_each_disc_fragment_simd(const TileJob& job, const TileABuffer& tile,
                                 FunctionRef<void(std::size_t, const DiscFragment&)> take) {
  const D d;
  const KernelRaster raster(job, tile.x0, tile.y0);
  const V cutoff = hn::Set(d, job.rules->cutoff);
  const V inv_cutoff = hn::Set(d, 1 / job.rules->cutoff);
  HWY_ALIGN float depths[kTileSize];
  HWY_ALIGN float epsilons[kTileSize];
  HWY_ALIGN float keys[kTileSize];
  HWY_ALIGN float kernels[kTileSize];
  raster.draw(
      0, job.count, nullptr, [&](std::uint32_t index, std::size_t pixel, const Sample& s) HWY_ATTR {
        const M inside = hn::Lt(s.beta, cutoff);
        if (hn::AllFalse(d, inside)) return;
        hn::Store(s.depth, d, depths);
        hn::Store(s.epsilon, d, epsilons);
        hn::Store(hn::IfThenElse(inside, hn::Sqrt(hn::Mul(s.beta, inv_cutoff)), hn::Set(d, -1.0F)),
                  d, keys);
        hn::Store(hn::Mul(s.amplitude, raster.sampler().decay(s.beta)), d, kernels);
        for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
          if (keys[lane] < 0) continue;
          take(pixel + lane, {.disc = index,
                              .group = job.groups[index],
                              .front = (job.splats[index].tag & kFrontTag) != 0,
                              .enlarged = false,
                              .depth = depths[lane],
                              .epsilon = epsilons[lane],
                              .key = keys[lane],
                              .rho = kernels[lane]});
        }
      });
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(for_each_disc_fragment_simd);

/// Weight of a nearest fragment at its splat's rim, where a fragment at the centre has 1. It is not
/// 0, so that a pixel without other fragments has a normal.
constexpr float kRimWeight = 1e-3F;

class JointBlender {
 public:
  JointBlender(const JointJobs& jobs, PictureLayers& picture, const NearestLayer* masked,
               const TileABuffer& tile, JointScratch& scratch)
      : jobs_(jobs), picture_(picture), masked_(masked), tile_(tile), scratch_(scratch) {}

  std::uint64_t run() {
    scratch_.merged.assign(kTilePixels, Fragment{});
    scratch_.groups.clear();
    collect();
    sort_by_pixel();
    std::uint64_t culled = 0;
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      if (in_picture(pixel)) culled += blend(pixel);
      groups_end_[pixel + 1] = scratch_.groups.size();
    }
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      if (in_picture(pixel)) merge(pixel);
    }
    return culled;
  }

 private:
  bool in_picture(int pixel) const {
    return tile_pixel_x(pixel) < tile_.width && tile_pixel_y(pixel) < tile_.height;
  }
  int x(int pixel) const { return tile_.x0 + tile_pixel_x(pixel); }
  int y(int pixel) const { return tile_.y0 + tile_pixel_y(pixel); }

  bool in_nearest_layer(std::size_t pixel, const DiscFragment& f) const {
    if (!masked_) return false;
    const NearestLayer& nearest = masked_[pixel];
    return f.depth >= nearest.depth ||
           (f.front == nearest.front && f.depth + f.epsilon >= nearest.depth);
  }

  void collect() {
    scratch_.fragments.clear();
    scratch_.pixels.clear();
    for (const bool enlarged : {false, true}) {
      const TileJob* job = enlarged ? jobs_.enlarged : jobs_.discs;
      if (!job) continue;
      HWY_DYNAMIC_DISPATCH(for_each_disc_fragment_simd)
      (*job, tile_, [&](std::size_t pixel, const DiscFragment& fragment) {
        if (!enlarged && in_nearest_layer(pixel, fragment)) return;
        scratch_.pixels.push_back(static_cast<std::uint16_t>(pixel));
        scratch_.fragments.push_back(fragment);
        scratch_.fragments.back().enlarged = enlarged;
      });
    }
  }

  void sort_by_pixel() {
    fragments_begin_.fill(0);
    for (const std::uint16_t pixel : scratch_.pixels) ++fragments_begin_[pixel + 1U];
    std::partial_sum(fragments_begin_.begin(), fragments_begin_.end(), fragments_begin_.begin());
    auto next = fragments_begin_;
    scratch_.sorted.resize(scratch_.fragments.size());
    for (std::size_t i = 0; i < scratch_.fragments.size(); ++i) {
      scratch_.sorted[next[scratch_.pixels[i]]++] = scratch_.fragments[i];
    }
  }

  /// Blends a pixel's layers. Adds the groups that have a layer to scratch.groups. Returns the
  /// number of fragments culled.
  std::size_t blend(int pixel) {
    scratch_.images.assign(static_cast<std::size_t>(picture_.groups()), {});
    const std::size_t begin = fragments_begin_[pixel];
    float layers = 0;
    float layer_depth = 0;
    for (const JointLayers::Member& member : scratch_.layers.tell(
             std::span(scratch_.sorted).subspan(begin, fragments_begin_[pixel + 1] - begin),
             picture_.groups())) {
      JointScratch::GroupImage& image = scratch_.images[member.group];
      if (image.used) {
        Rgba front = shaded(image.last, pixel);
        front.composite(image.behind);
        image.behind = front;
        image.touched += (1 - image.touched) * coverage(image.last);
      }
      if (layers == 0 || member.depth != layer_depth) layers += coverage(member);
      layer_depth = member.depth;
      image.last = member;
      image.used = true;
    }
    PictureLayers::Surface nearest{0, Vec3f(0, 0, 0)};
    for (const JointScratch::GroupImage& image : scratch_.images) {
      if (!image.used) continue;
      scratch_.groups.push_back(group_pixel(image));
      // Fragments count most near their splat's centre and nothing at its rim: the groups' splats
      // are flat, and the mean normal and the refracted light are to have no steps there.
      const float inside = 1 - image.last.key * image.last.key;
      const float weight = std::max(kRimWeight, inside * inside);
      nearest.weight += weight;
      if (tile_.shader->has_environment()) nearest.normal += weight * normal(image.last);
    }
    if (tile_.shader->has_environment()) {
      picture_.nearest(x(pixel), y(pixel)) = nearest;
      picture_.layers(x(pixel), y(pixel)) = layers;
    }
    return scratch_.layers.culled();
  }

  void merge(int pixel) {
    const std::span groups(scratch_.groups.data() + groups_end_[pixel],
                           groups_end_[pixel + 1] - groups_end_[pixel]);
    if (tile_.shader->has_environment() && picture_.at_border(x(pixel), y(pixel))) {
      picture_.keep(x(pixel), y(pixel), groups);
    } else {
      scratch_.merged[pixel] = picture_.merged(*tile_.shader, x(pixel), y(pixel), groups);
    }
  }

  const TileJob& job(const JointLayers::Member& member) const {
    return member.enlarged ? *jobs_.enlarged : *jobs_.discs;
  }
  float coverage(const JointLayers::Member& member) const {
    return std::min(1.0F, member.weight / tile_.full_weight);
  }
  Vec3f normal(const JointLayers::Member& member) const {
    const SplatNormal& n = job(member).normals[member.disc];
    return {n.x, n.y, n.z};
  }

  PictureLayers::GroupPixel group_pixel(const JointScratch::GroupImage& image) const {
    const float covered = coverage(image.last);
    const auto part = [&](float share) {
      const Rgba& c = image.behind;
      return Rgba{share * c.red, share * c.green, share * c.blue, share * c.alpha};
    };
    return {fragment(image.last, 1), part(covered), part(1 - covered), covered,
            covered + (1 - covered) * image.touched};
  }

  Fragment fragment(const JointLayers::Member& member, float weight) const {
    const Splat& splat = job(member).splats[member.disc];
    Fragment out{};
    float* c = out.channel;
    c[kWeight] = weight;
    c[kDepth] = weight * member.depth;
    c[kRed] = weight * splat.red;
    c[kGreen] = weight * splat.green;
    c[kBlue] = weight * splat.blue;
    c[kAlpha] = weight * splat.alpha;
    c[kTag] = std::bit_cast<float>(splat.tag);
    if (job(member).normals) {
      const Vec3f n = weight * normal(member);
      std::copy_n(n.data(), 3, c + kNormalX);
    }
    return out;
  }

  Rgba shaded(const JointLayers::Member& member, int pixel) const {
    return tile_.shader->shade(fragment(member, coverage(member)),
                               static_cast<float>(x(pixel)) + 0.5F,
                               static_cast<float>(y(pixel)) + 0.5F, 1);
  }

  const JointJobs& jobs_;
  PictureLayers& picture_;
  const NearestLayer* masked_;
  const TileABuffer& tile_;
  JointScratch& scratch_;
  std::array<std::uint32_t, kTilePixels + 1> fragments_begin_{};
  std::array<std::size_t, kTilePixels + 1> groups_end_{};  ///< Shifted by a pixel: 0 comes first.
};

}  // namespace

std::uint64_t blend_joint_layers(const JointJobs& jobs, PictureLayers& picture,
                                 const NearestLayer* masked, const TileABuffer& tile,
                                 JointScratch& scratch) {
  return JointBlender(jobs, picture, masked, tile, scratch).run();
}

}  // namespace surfel
#endif
