// Everitt, "Interactive Order-Independent Transparency", 2001, with the smooth interpolation of
// splats that Zhang, Pajarola, 2006, peel with.

#include <algorithm>
#include <bit>

#include <surfel/sp06/depth_peel.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/sp06/depth_peel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// Planes of kTilePixels floats for each side of the surface that may be seen.
enum Plane : int {
  kPeeled = 0,  ///< Depth of the side's last layer; fragments that do not reach it are left.
  kNext = 2,    ///< Depth of the nearest fragment left.
  kMean = 4,    ///< Mean depth of the fragments that reach that.
  kPlanes = 6,
};

template <bool kNormals, bool kOpaqueSplats>
class Peeler {
 public:
  Peeler(const TileJob& job, PeelScratch& scratch, TileABuffer& tile)
      : job_(job), tile_(tile), raster_(job, tile.x0, tile.y0) {
    scratch.planes.resize(std::size_t{kPlanes} * kTilePixels);
    planes_ = scratch.planes.data();
    for (int p = 0; p < kTilePixels; ++p) {
      const bool inside = tile_pixel_x(p) < tile.width && tile_pixel_y(p) < tile.height;
      for (int side = 0; side < 2; ++side) {
        plane(kPeeled, side)[p] = inside ? __builtin_inff() : -__builtin_inff();
      }
    }
  }

  PeelStatistics run() {
    PeelStatistics statistics;
    while (find_next() > 0) {
      if (statistics.layers == tile_.layout.layers) {
        for (int p = 0; p < kTilePixels; ++p) {
          statistics.unpeeled_pixels += std::max(plane(kNext, 0)[p], plane(kNext, 1)[p]) > none();
        }
        break;
      }
      add_layer(statistics.layers++);
    }
    statistics.passes = passes_;
    return statistics;
  }

 private:
  static float none() { return -__builtin_inff(); }
  float* plane(int which, std::uint32_t side) const {
    return planes_ + (static_cast<std::size_t>(which) + side) * kTilePixels;
  }

  /// Is there a depth in a side's plane, in some pixel of a vector?
  bool has_depth(Plane which, std::uint32_t side, std::size_t pixel) const {
    const D d;
    return !hn::AllTrue(d, hn::Eq(hn::Load(d, plane(which, side) + pixel), hn::Set(d, none())));
  }

  /// Calls body(splat's index, side, first pixel, mask, Sample) for all fragments that no layer
  /// has, of the sides that have a depth in the plane `open` somewhere in their vector of pixels.
  template <class Body>
  HWY_INLINE void for_each_fragment(Plane open, const Body& body) {
    const D d;
    ++passes_;
    raster_.for_each_vector(0, job_.count, nullptr, [&](const PixelSplats& list) HWY_ATTR {
      const std::size_t pixel = list.pixel;
      const bool sides[] = {has_depth(open, 0, pixel), has_depth(open, 1, pixel)};
      if (!sides[0] && !sides[1]) return;
      const SplatSampler sampler = raster_.sampler();
      const V cutoff = hn::Set(d, job_.rules->cutoff);
      FragmentCounter fragments;
      for (const std::uint32_t* index = list.begin; index < list.end; ++index) {
        const std::uint32_t side = job_.splats[*index].tag & kFrontTag;
        if (!sides[side]) continue;
        const Sample s = sampler.at(*index, list.x, list.y);
        const M inside = hn::Lt(s.beta, cutoff);
        fragments.add(inside);
        const M left = hn::And(
            inside, hn::Lt(hn::Add(s.depth, s.epsilon), hn::Load(d, plane(kPeeled, side) + pixel)));
        if (!hn::AllFalse(d, left)) body(*index, side, pixel, left, s);
      }
      raster_.count(fragments);
    });
  }

  /// Depth of the nearest fragment left in every pixel, of the side that is nearer; none of the
  /// other. Returns in how many pixels there is one.
  std::size_t find_next() {
    const D d;
    std::fill_n(plane(kNext, 0), 2 * kTilePixels, none());
    for_each_fragment(kPeeled, [&](std::uint32_t, std::uint32_t side, std::size_t pixel, M left,
                                   const Sample& s) HWY_ATTR {
      float* next = plane(kNext, side) + pixel;
      const V old = hn::Load(d, next);
      hn::Store(hn::IfThenElse(left, hn::Max(old, s.depth), old), d, next);
    });
    std::size_t found = 0;
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      float* back = plane(kNext, 0) + pixel;
      float* front = plane(kNext, 1) + pixel;
      const V b = hn::Load(d, back);
      const V f = hn::Load(d, front);
      const M front_first = hn::Ge(f, b);
      hn::Store(hn::IfThenElse(front_first, hn::Set(d, none()), b), d, back);
      hn::Store(hn::IfThenElse(front_first, f, hn::Set(d, none())), d, front);
      found += hn::CountTrue(d, hn::Gt(hn::Max(b, f), hn::Set(d, none())));
    }
    return found;
  }

  /// Adds the fragments left that reach the plane `anchor`, without the fragments that were added
  /// as they reach the plane `added`, if that is another plane.
  void add_reaching(int layer, Plane anchor, Plane added) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    for_each_fragment(anchor, [&](std::uint32_t index, std::uint32_t side, std::size_t pixel,
                                  M left, const Sample& s) HWY_ATTR {
      const V reach = hn::Add(s.depth, s.epsilon);
      const V nearest = hn::Load(d, plane(anchor, side) + pixel);
      M joins = hn::And(left, hn::And(hn::Ge(reach, nearest), hn::Gt(nearest, hn::Set(d, none()))));
      if (added != anchor) {
        joins = hn::AndNot(hn::Ge(reach, hn::Load(d, plane(added, side) + pixel)), joins);
      }
      if (hn::AllFalse(d, joins)) return;
      const V rho =
          hn::IfThenElseZero(joins, hn::Mul(s.amplitude, raster_.sampler().decay(s.beta)));
      const Splat& splat = job_.splats[index];
      float* fragment = tile_.fragment(layer, pixel);
      FragmentSums<kNormals, kOpaqueSplats> sums(fragment);
      float* tags = fragment + kTag * kPatchPixels;
      const M fresh = hn::And(hn::Eq(sums.weight, hn::Zero(d)), hn::Gt(rho, hn::Zero(d)));
      hn::BlendedStore(hn::BitCast(d, hn::Set(du, splat.tag)), fresh, d, tags);
      sums.add(splat, kNormals ? job_.normals + index : nullptr, rho, s.depth);
      sums.store(fragment);
    });
  }

  void add_layer(int layer) {
    const D d;
    add_reaching(layer, kNext, kNext);
    // With the nearest fragment alone as the measure, the far fragments of a steep or noisy surface
    // would fall off as another layer: a fragment that reaches the mean depth of the fragments that
    // joined belongs to them.
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      const V mean = hn::Div(hn::Load(d, tile_.fragment(layer, pixel) + kDepth * kPatchPixels),
                             hn::Load(d, tile_.fragment(layer, pixel) + kWeight * kPatchPixels));
      for (std::uint32_t side = 0; side < 2; ++side) {
        // Rounding must not move the mean in front of the depths that it is the mean of.
        const V next = hn::Load(d, plane(kNext, side) + pixel);
        hn::Store(hn::IfThenElse(hn::Gt(next, hn::Set(d, none())), hn::Min(mean, next), next), d,
                  plane(kMean, side) + pixel);
      }
    }
    add_reaching(layer, kMean, kNext);
    // The depth up to which the pixel has been peeled; behind an opaque surface that covers its
    // pixel everything has.
    for (std::size_t pixel = 0; pixel < kTilePixels; pixel += hn::Lanes(d)) {
      const V weight = hn::Load(d, tile_.fragment(layer, pixel) + kWeight * kPatchPixels);
      M closed = hn::Ge(weight, hn::Set(d, tile_.edge_weight));
      if constexpr (!kOpaqueSplats) {
        const V alpha = hn::Load(d, tile_.fragment(layer, pixel) + kAlpha * kPatchPixels);
        closed = hn::And(closed, hn::Ge(alpha, hn::Mul(weight, hn::Set(d, kOpaqueAlpha))));
      }
      for (std::uint32_t side = 0; side < 2; ++side) {
        float* peeled = plane(kPeeled, side) + pixel;
        const V mean = hn::Load(d, plane(kMean, side) + pixel);
        const M reached = hn::Gt(mean, hn::Set(d, none()));
        const V now = hn::IfThenElse(reached, mean, hn::Load(d, peeled));
        hn::Store(hn::IfThenElse(closed, hn::Set(d, none()), now), d, peeled);
      }
    }
  }

  const TileJob& job_;
  TileABuffer& tile_;
  KernelRaster raster_;
  float* planes_;
  int passes_ = 0;
};

}  // namespace

PeelStatistics peel_tile_simd(const TileJob& job, PeelScratch& scratch, TileABuffer& tile) {
  if (job.normals) {
    return job.rules->opaque ? Peeler<true, true>(job, scratch, tile).run()
                             : Peeler<true, false>(job, scratch, tile).run();
  }
  return job.rules->opaque ? Peeler<false, true>(job, scratch, tile).run()
                           : Peeler<false, false>(job, scratch, tile).run();
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(peel_tile_simd);

PeelStatistics peel_tile(const TileJob& job, PeelScratch& scratch, TileABuffer& tile) {
  return HWY_DYNAMIC_DISPATCH(peel_tile_simd)(job, scratch, tile);
}

}  // namespace surfel
#endif
