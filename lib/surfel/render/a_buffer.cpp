#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_search.h>
#include <surfel/render/shading.h>

namespace surfel {
namespace {

/// In place: a copy would wait for the stores.
void load(const TileABuffer& tile, int layer, int pixel, Fragment& fragment) {
  const float* from = tile.fragment(layer, static_cast<std::size_t>(pixel));
  for (int c = 0; c <= kBack; ++c) fragment.channel[c] = from[c * kPatchPixels];
  for (int c = kNormalX; c <= kNormalZ; ++c) {
    fragment.channel[c] = tile.layout.normals ? from[c * kPatchPixels] : 0.0F;
  }
  if (tile.layout.opaque && fragment.channel[kWeight] > 0) {
    fragment.channel[kAlpha] = fragment.channel[kWeight];
  }
}

float back_depth(const Fragment& fragment) {
  return is_merged(fragment) ? fragment.channel[kBack] : front_depth(fragment);
}

/// Composites the fragments of a pixel front to back.
class FrontToBack {
 public:
  /// \param x, y  the pixel in the picture.
  FrontToBack(const TileABuffer& tile, int x, int y)
      : tile_(tile), x_(static_cast<float>(x) + 0.5F), y_(static_cast<float>(y) + 0.5F) {}

  /// \param edge  see edge_of().
  void add(const Fragment& fragment, float edge) {
    const float* c = fragment.channel;
    if (is_merged(fragment)) {
      Fragment seen = fragment;
      seen.channel[kOther] = 0;
      add_merged(seen, 1);
      return;
    }
    Rgba color = tile_.shader->shade(fragment, x_, y_, tile_.weight_at_edge(edge));
    const bool front = shows_front(c[kTag]);
    const float coverage = tile_.coverage(fragment, edge);
    // With the reflected environment, where the surface reflects one.
    const float opacity =
        tile_.shader->has_environment() ? color.alpha / coverage : c[kAlpha] / c[kWeight];
    if (!front && front_coverage_ > 0) {
      // The share of the back's colour that the front lets through, where the back lies behind the
      // front and where it looks out, over the share that (12) is going to let through.
      const float left = std::min(coverage, front_coverage_) * (1 - front_opacity_) +
                         std::max(0.0F, coverage - front_coverage_);
      const float independent = coverage * (1 - front_coverage_ * front_opacity_);
      const float scale = independent > 0 ? 1 + front_edge_ * (left / independent - 1) : 1.0F;
      color = {color.red * scale, color.green * scale, color.blue * scale, color.alpha * scale};
    }
    color_.composite(color);
    see_through(fragment, 1, coverage, color.alpha);
    front_coverage_ = front ? coverage : 0;
    front_opacity_ = opacity;
    front_edge_ = edge;
  }
  void add_merged(const Fragment& fragment, float coverage) {
    const float* c = fragment.channel;
    color_.composite({c[kRed], c[kGreen], c[kBlue], c[kAlpha]});
    see_through(fragment, -c[kWeight], coverage, c[kAlpha]);
    front_coverage_ = 0;
  }
  /// Composites what has been added over the environment.
  void add_environment() { tile_.shader->add_environment(color_, surfaces_, x_, y_); }
  const Rgba& color() const { return color_; }
  /// How many surfaces there are, where there is an environment behind them.
  float layers() const { return surfaces_.layers(); }

 private:
  void see_through(const Fragment& fragment, float surfaces, float coverage, float opacity) {
    if (tile_.shader->has_environment()) surfaces_.add(fragment, surfaces, coverage, opacity);
  }

  const TileABuffer& tile_;
  float x_, y_;
  Rgba color_;
  /// Coverage of the last fragment, if it is unmerged and front-facing.
  float front_coverage_ = 0;
  float front_opacity_ = 0;
  float front_edge_ = 0;
  SeenThrough surfaces_;
};

/// SS01 (12).
Fragment merged(const TileABuffer& tile, const Fragment& front, const Fragment& back, int pixel) {
  // Layers run out at rims, where surfaces end before one another. The sums around merged fragments
  // are not known yet: taken to be inside a surface, rims grow (by 1 dB of a head's picture); taken
  // to be at an edge, crests that are seen at a grazing angle get thin. Filtered splats are
  // therefore taken to be most of the way to an edge; surfaces that cover the pixel are not
  // changed.
  const auto edge = [](const Fragment& f) {
    return !is_merged(f) && is_filtered(f.channel[kTag]) ? 0.8F : 0.0F;
  };
  FrontToBack pair(tile, tile.x0 + tile_pixel_x(pixel), tile.y0 + tile_pixel_y(pixel));
  pair.add(front, edge(front));
  pair.add(back, edge(back));
  const Rgba& color = pair.color();
  Fragment out{};
  // Negative, as in SS01. The number matters where there is an environment to be seen behind.
  out.channel[kWeight] = pair.layers() > 0 ? -pair.layers() : -1;
  out.channel[kDepth] = front_depth(front);
  out.channel[kRed] = color.red;
  out.channel[kGreen] = color.green;
  out.channel[kBlue] = color.blue;
  out.channel[kAlpha] = color.alpha;
  // The environment behind all surfaces is seen through the nearest one.
  out.channel[kTag] = front.channel[kTag];
  const float weight = is_merged(front) ? 1 : front.channel[kWeight];
  for (const int c : {kNormalX, kNormalY, kNormalZ}) out.channel[c] = front.channel[c] / weight;
  out.channel[kBack] = back_depth(back);
  return out;
}

Fragment unmerged(const PixelContribution& contribution) {
  const auto& [rho, depth, splat, normal] = contribution;
  Fragment out{};
  float* c = out.channel;
  c[kWeight] = rho;
  c[kDepth] = rho * depth;
  c[kRed] = rho * splat.red;
  c[kGreen] = rho * splat.green;
  c[kBlue] = rho * splat.blue;
  c[kAlpha] = rho * splat.alpha;
  c[kTag] = std::bit_cast<float>(splat.tag);
  if (normal) {
    c[kNormalX] = rho * normal->x;
    c[kNormalY] = rho * normal->y;
    c[kNormalZ] = rho * normal->z;
  }
  return out;
}

/// Makes a PixelResult of a pixel's fragments.
class Resolver {
 public:
  Resolver(const TileABuffer& tile, int x, int y) : tile_(tile), composite_(tile, x, y) {
    result_.depth = result_.depth_first = kInfinity;
  }

  /// The next fragment, front to back. \param edge  see edge_of().
  void add(const Fragment& fragment, float edge) {
    composite_.add(fragment, edge);
    const float z = tile_.shader->z(front_depth(fragment));
    if (result_.depth_first == kInfinity) {
      result_.depth_first = z;
      if (!is_merged(fragment)) {
        result_.weight = fragment.channel[kWeight];
        if (tile_.layout.normals) {
          const Vec3f n = Vec3f(fragment.channel[kNormalX], fragment.channel[kNormalY],
                                fragment.channel[kNormalZ])
                              .normalized();
          std::copy_n(n.data(), 3, result_.normal);
        }
      }
    }
    if (result_.depth == kInfinity && composite_.color().alpha >= 0.5F) result_.depth = z;
  }

  PixelResult finish(const Fragment& rest) {
    if (is_merged(rest)) composite_.add_merged(rest, rest.channel[kCovered]);
    if (tile_.shader->has_environment()) composite_.add_environment();
    result_.color = composite_.color();
    return result_;
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();

  const TileABuffer& tile_;
  FrontToBack composite_;
  PixelResult result_;
};

/// Layers of a pixel in use, nearest first.
struct Sorted {
  static constexpr int kMost = kMostLayers;
  std::array<Fragment, kMost> fragment;
  std::array<int, kMost> order;
  int count = 0;

  Sorted(TileABuffer& tile, int pixel) {
    std::array<float, kMost> depth;
    for (int layer = 0; layer < tile.layout.layers; ++layer) {
      if (tile.at(layer, kWeight, pixel) == 0) break;
      load(tile, layer, pixel, fragment[layer]);
      depth[layer] = front_depth(fragment[layer]);
      int place = count++;
      for (; place > 0 && depth[order[place - 1]] < depth[layer]; --place) {
        order[place] = order[place - 1];
      }
      order[place] = layer;
    }
  }
  const Fragment& operator[](int i) const { return fragment[order[i]]; }
};

void store(TileABuffer& tile, int layer, int pixel, const Fragment& fragment) {
  for (int c = 0; c < tile.layout.channels(); ++c) tile.at(layer, c, pixel) = fragment.channel[c];
}

}  // namespace

void insert_by_merging(TileABuffer& tile, int pixel, const PixelContribution& contribution) {
  const Fragment fresh = unmerged(contribution);
  const float depth = contribution.depth;
  const Sorted sorted(tile, pixel);
  int in_front = 0;  // How many fragments are nearer than the newcomer.
  while (in_front < sorted.count && front_depth(sorted[in_front]) >= depth) ++in_front;
  if (sorted.count == 1) {
    if (in_front == 0) store(tile, 0, pixel, fresh);
    return;
  }
  // A surface seen at a grazing angle reaches further in depth within the pixel than epsilon
  // allows, and comes in slabs of which none covers the pixel. The newcomer is one more slab; were
  // two slabs merged before they are complete, the rest of their splats would come too late.
  int slab = -1;
  float least = std::numeric_limits<float>::infinity();
  for (const int i : {in_front - 1, in_front}) {
    if (i < 0 || i >= sorted.count || is_merged(sorted[i]) ||
        sorted[i].channel[kWeight] >= tile.full_weight ||
        shows_front(sorted[i].channel[kTag]) != shows_front(fresh.channel[kTag])) {
      continue;
    }
    const float distance = std::abs(front_depth(sorted[i]) - depth);
    if (distance < least) {
      least = distance;
      slab = i;
    }
  }
  if (slab >= 0) {
    Fragment sum = sorted[slab];
    for (int c = 0; c < tile.layout.channels(); ++c) {
      if (c != kTag && c != kBack) sum.channel[c] += fresh.channel[c];
    }
    store(tile, sorted.order[slab], pixel, sum);
    return;
  }
  ++tile.merges.merged;
  // The pair to merge, and the layer that it leaves free. Nothing may lie between the two.
  if (in_front == 1 && sorted.count == 2) {
    // With one fragment on either side, the newcomer itself is merged with the fragment behind it.
    store(tile, sorted.order[1], pixel, merged(tile, fresh, sorted[1], pixel));
    return;
  }
  const int front = in_front >= 2 ? 0 : sorted.count - 2;
  store(tile, sorted.order[front], pixel, merged(tile, sorted[front], sorted[front + 1], pixel));
  store(tile, sorted.order[front + 1], pixel, fresh);
}

void add_to_merged_layer(TileABuffer& tile, int layer, int pixel,
                         const PixelContribution& contribution) {
  const float x = static_cast<float>(tile.x0 + tile_pixel_x(pixel)) + 0.5F;
  const float y = static_cast<float>(tile.y0 + tile_pixel_y(pixel)) + 0.5F;
  const Rgba color = tile.shader->shade(unmerged(contribution), x, y, tile.full_weight);
  const float open = 1 - tile.at(layer, kAlpha, pixel);
  tile.at(layer, kRed, pixel) += open * color.red;
  tile.at(layer, kGreen, pixel) += open * color.green;
  tile.at(layer, kBlue, pixel) += open * color.blue;
  tile.at(layer, kAlpha, pixel) += open * color.alpha;
}

NearestLayer nearest_layer(TileABuffer& tile, int pixel) {
  const Sorted sorted(tile, pixel);
  if (sorted.count == 0 || is_merged(sorted[0])) return {};
  return {front_depth(sorted[0]), shows_front(sorted[0].channel[kTag])};
}

std::optional<PixelResult> resolve_pixel(TileABuffer& tile, int pixel, const Fragment& rest,
                                         bool waits, OpenPixels& open) {
  const Sorted sorted(tile, pixel);
  const int x = tile.x0 + tile_pixel_x(pixel);
  const int y = tile.y0 + tile_pixel_y(pixel);
  bool look = false;
  for (int i = 0; i < sorted.count; ++i) {
    const Fragment& fragment = sorted[i];
    if (!is_merged(fragment)) tile.merges.total_weight += fragment.channel[kWeight];
    look = look || may_be_at_edge(tile, fragment);
  }
  if (waits || (look && sees_other_tiles(tile, pixel))) {
    const bool has_rest = waits || is_merged(rest);
    open.pixels.push_back({x, y, open.fragments.size(), sorted.count, has_rest});
    for (int i = 0; i < sorted.count; ++i) open.fragments.push_back(sorted[i]);
    if (has_rest) open.fragments.push_back(rest);
    return std::nullopt;
  }
  Resolver resolver(tile, x, y);
  for (int i = 0; i < sorted.count; ++i) {
    const Fragment& fragment = sorted[i];
    resolver.add(fragment, may_be_at_edge(tile, fragment)
                               ? edge_of(tile, fragment, look_around(tile, fragment, pixel))
                               : 0);
  }
  return resolver.finish(rest);
}

PixelResult resolve_open_pixel(const TileABuffer& tile, const OpenPixels& open,
                               const OpenPixels::Pixel& pixel, const TileRims& rims) {
  Resolver resolver(tile, pixel.x, pixel.y);
  const Fragment* const fragments = open.fragments.data() + pixel.first;
  for (int i = 0; i < pixel.count; ++i) {
    const Fragment& fragment = fragments[i];
    resolver.add(fragment,
                 may_be_at_edge(tile, fragment)
                     ? edge_of(tile, fragment, rims.look_around(fragment, pixel.x, pixel.y))
                     : 0);
  }
  return resolver.finish(pixel.rest ? fragments[pixel.count] : Fragment{});
}

}  // namespace surfel
