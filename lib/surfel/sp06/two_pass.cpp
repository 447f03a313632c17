// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: section 3.1.

#include <algorithm>

#include <surfel/sp06/two_pass.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/two_pass.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

template <bool kNormals>
class TwoPasses {
 public:
  TwoPasses(const TileJob& job, TileABuffer& tile)
      : job_(job), tile_(tile), raster_(job, tile.x0, tile.y0) {
    for (int p = 0; p < kTilePixels; ++p) {
      const bool inside = tile_pixel_x(p) < tile.width && tile_pixel_y(p) < tile.height;
      nearest_[p] = outside_[p] = inside ? -__builtin_inff() : __builtin_inff();
    }
  }

  void run() {
    for_each_part([&](std::size_t begin, std::size_t end) { find_visible(begin, end); });
    for_each_part([&](std::size_t begin, std::size_t end) { add_attributes(begin, end); });
  }

 private:
  using Layer = FragmentLayer<kNormals, true>;

  /// Calls draw(begin, end) for all splats, so many at a time that those behind what has been drawn
  /// can be left out.
  template <class Draw>
  void for_each_part(const Draw& draw) const {
    // A check costs as much as about a dozen splats.
    constexpr std::size_t kCheckEvery = 256;
    for (std::size_t begin = 0; begin < job_.count; begin += kCheckEvery) {
      draw(begin, std::min(begin + kCheckEvery, job_.count));
    }
  }

  /// The visibility pass: the depth of the nearest fragment, and its splat's tag.
  void find_visible(std::size_t begin, std::size_t end) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const V cutoff = hn::Set(d, job_.rules->cutoff);
    raster_.draw(begin, end, nearest_,
                 [&](std::uint32_t index, std::size_t pixel, const Sample& s) HWY_ATTR {
                   const M nearer = hn::And(hn::Lt(s.beta, cutoff),
                                            hn::Gt(s.depth, hn::Load(d, nearest_ + pixel)));
                   if (hn::AllFalse(d, nearer)) return;
                   const V tag = hn::BitCast(d, hn::Set(du, job_.splats[index].tag));
                   hn::BlendedStore(s.depth, nearer, d, nearest_ + pixel);
                   hn::BlendedStore(tag, nearer, d, tags(pixel));
                 });
  }

  float* tags(std::size_t pixel) const { return tile_.fragment(0, pixel) + kTag * kPatchPixels; }

  /// The attribute pass. Nothing is seen behind surfaces that cover their pixel so far.
  void add_attributes(std::size_t begin, std::size_t end) {
    const D d;
    HWY_ALIGN float hidden[kTilePixels];
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      const V weight = hn::Load(d, tile_.fragment(0, pixel) + kWeight * kPatchPixels);
      const M covered = hn::Ge(weight, hn::Set(d, tile_.edge_weight));
      // A single layer shows nothing behind itself.
      const V depth = hn::Load(d, (tile_.layout.layers == 1 ? nearest_ : outside_) + pixel);
      hn::Store(hn::IfThenElse(covered, hn::Load(d, nearest_ + pixel), depth), d, hidden + pixel);
    }
    raster_.for_each_vector(begin, end, hidden, [&](const PixelSplats& list) HWY_ATTR {
      add(list, hn::Load(D(), hidden + list.pixel));
    });
  }

  HWY_NOINLINE void add(const PixelSplats& list, V hidden) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const SplatSampler sampler = raster_.sampler();
    const V cutoff = hn::Set(d, job_.rules->cutoff);
    const V nearest = hn::Load(d, nearest_ + list.pixel);
    const auto tag = hn::BitCast(du, hn::Load(d, tags(list.pixel)));
    float* const fragment = tile_.fragment(0, list.pixel);
    FragmentSums<kNormals, true> sums(fragment);
    FragmentCounter fragments;
    for (const std::uint32_t* index = list.begin; index < list.end; ++index) {
      const Splat& splat = job_.splats[*index];
      const SplatNormal* const normal = kNormals ? job_.normals + *index : nullptr;
      const Sample s = sampler.at(*index, list.x, list.y);
      const M inside = hn::Lt(s.beta, cutoff);
      fragments.add(inside);
      const V reach = hn::Add(s.depth, s.epsilon);
      const M seen = hn::And(inside, hn::Ge(reach, hidden));
      const V rho = hn::IfThenElseZero(seen, hn::Mul(s.amplitude, sampler.decay(s.beta)));
      const auto sides = hn::And(hn::Xor(tag, hn::Set(du, splat.tag)), hn::Set(du, kFrontTag));
      const M visible =
          hn::And(hn::RebindMask(d, hn::Eq(sides, hn::Zero(du))), hn::Ge(reach, nearest));
      sums.add(splat, normal, hn::IfThenElseZero(visible, rho), s.depth);
      const V behind = hn::IfThenZeroElse(visible, rho);
      if (!is_zero(behind)) add_behind(list.pixel, *index, behind, Sample(s));
    }
    sums.store(fragment);
    raster_.count(fragments);
  }

  /// Adds a contribution to the layers behind the first. Where no layer is left it is dropped: as
  /// splats come front to back, its surface is the farthest.
  HWY_NOINLINE void add_behind(std::size_t pixel, std::uint32_t index, V rho, Sample s) {
    const Splat& splat = job_.splats[index];
    const SplatNormal* const normal = kNormals ? job_.normals + index : nullptr;
    const V full = hn::Set(D(), tile_.edge_weight);
    for (int i = 1; i < tile_.layout.layers && !is_zero(rho); ++i) {
      Layer layer(tile_.fragment(i, pixel), full);
      rho = layer.take(rho, s.depth, s.epsilon, splat, normal);
      layer.store();
    }
  }

  const TileJob& job_;
  TileABuffer& tile_;
  const KernelRaster raster_;
  HWY_ALIGN float nearest_[kTilePixels];  ///< Depth of the nearest fragment.
  HWY_ALIGN float outside_[kTilePixels];  ///< Infinity outside of the picture.
};

}  // namespace

void draw_two_pass_simd(const TileJob& job, TileABuffer& tile) {
  job.normals ? TwoPasses<true>(job, tile).run() : TwoPasses<false>(job, tile).run();
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(draw_two_pass_simd);

void draw_two_pass(const TileJob& job, TileABuffer& tile) {
  HWY_DYNAMIC_DISPATCH(draw_two_pass_simd)(job, tile);
}

}  // namespace surfel
#endif
