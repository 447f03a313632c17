#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_search.h>
#include <surfel/render/shading.h>

namespace surfel {
namespace {

/// In place: a copy would wait for the stores, as would a call.
[[gnu::always_inline]] inline void load(const TileABuffer& tile, int layer, int pixel,
                                        Fragment& fragment) {
  const float* from = tile.fragment(layer, static_cast<std::size_t>(pixel));
  for (int c = 0; c <= kBack; ++c) fragment.channel[c] = from[c * kPatchPixels];
  for (int c = kNormalX; c <= kNormalZ; ++c) {
    fragment.channel[c] = tile.layout.normals ? from[c * kPatchPixels] : 0.0F;
  }
  for (int c = kCutAway; c < kFragmentChannels; ++c) {
    fragment.channel[c] = tile.layout.clips ? from[c * kPatchPixels] : 0.0F;
  }
  fragment.slope = 0;
  if (tile.layout.opaque && fragment.channel[kWeight] > 0) {
    if (tile.layout.planes) fragment.slope = std::bit_cast<std::uint32_t>(fragment.channel[kSlope]);
    fragment.channel[kAlpha] = fragment.channel[kWeight];
  }
}

float back_depth(const Fragment& fragment) {
  return is_merged(fragment) ? fragment.channel[kBack] : front_depth(fragment);
}

/// Are both fragments seen at a grazing angle, as the two sides of a body are at its silhouette?
bool at_rims(const Fragment& a, const Fragment& b) {
  return is_grazing(a.channel[kTag]) && is_grazing(b.channel[kTag]);
}

/// How far slabs of one surface are apart at most.
float slab_depth(const Fragment& a, const Fragment& b) {
  constexpr float kAtRims = 0.05F;  // Instead of kRimDepth, at grazing angles.
  return (at_rims(a, b) ? kAtRims : kRimDepth) * std::abs(front_depth(b));
}

/// May a front be seen before a nearer back that covers the pixel? Beyond a silhouette it is: the
/// tangent planes part fast there, but other bodies are further away.
bool at_one_rim(const Fragment& back, const Fragment& front) {
  const float depth = front_depth(back);
  return at_rims(back, front) &&
         std::abs(depth - front_depth(front)) <= kRimDepth * std::abs(depth);
}

/// A fragment of a pixel.
struct SeenFragment {
  const Fragment* fragment;
  /// Share of the pixel that it covers. Of merged transparent surfaces it is not known: they count
  /// as covering all.
  float coverage;
  /// Of an unmerged fragment: the sum of rho from which on it covers the pixel.
  float full_weight;
  float edge;  ///< EdgeFilter::Edge::degree.
  /// Of a front-facing fragment, the degree to which back-facing fragments that follow are the
  /// other side of its body.
  float one_body;
  bool far_side;  ///< See is_far_side().
};

SeenFragment seen_at(const TileABuffer& tile, const Fragment& fragment, float edge,
                     bool far_side = false) {
  if (is_merged(fragment)) {
    const float coverage = tile.layout.opaque ? fragment.channel[kAlpha] : 1.0F;
    return {&fragment, coverage, 1, edge, edge, far_side};
  }
  const float full_weight = tile.full_weight_of(fragment, edge);
  const float coverage = std::min(1.0F, fragment.channel[kWeight] / full_weight);
  return {&fragment, coverage, full_weight, edge, edge, far_side};
}

/// Fragments cover no less of a pixel, so that their colours can be told.
constexpr float kLeastCoverage = 1e-6F;

/// May a fragment, one of several in its pixel, be the far side of a body?
bool may_be_far_side(const TileABuffer& tile, int count, const Fragment& fragment) {
  return tile.layout.opaque && count > 1 && !is_merged(fragment) &&
         !shows_front(fragment.channel[kTag]);
}

/// Whether a fragment's surface may end near its pixel, so that the pixels around have to be looked
/// at. Of a pixel's last fragment EdgeCoverage sets the opacity, if it does so at all, whatever it
/// is now, unless lines cut the surface, which tell more about its edge; and its sum tells that it
/// goes on.
bool may_be_at_edge(const TileABuffer& tile, bool last, const Fragment& fragment) {
  const float* const c = fragment.channel;
  if (!tile.edge_filter || is_merged(fragment) || !is_filtered(c[kTag])) return false;
  if (!last && tile.layout.opaque) return true;
  const bool later = tile.edges_later && !(tile.layout.clips && c[kCutPartial] > 0);
  return !(last && later) && c[kWeight] < tile.inside_weight;
}

/// Does a fragment hide what lies behind it?
bool hides(const TileABuffer& tile, const SeenFragment& seen) {
  constexpr float kHides = 0.9F;
  return tile.layout.opaque && seen.coverage >= kHides && shows_front(seen.fragment->channel[kTag]);
}

/// Is a back-facing fragment the far side of a body, at whose silhouette it reaches beyond the near
/// side? Then the near side is close by, and the back is nowhere around the nearest surface with a
/// whole sum, as it would be if it were really seen. Sums of splats that are larger than the pixel
/// filter are too uneven to tell whether it is: there the near side is also close in depth, or
/// lines tell that the back ends.
bool is_far_side(const TileABuffer& tile, const Fragment& back, const EdgeNeighbors& around) {
  constexpr float kWhole = 0.8F;
  constexpr float kDeepest = 0.3F;  // The depth of a body, as a part of its distance.
  const float depth = front_depth(back);
  const bool is_cut = tile.layout.clips && back.channel[kCutPartial] > 0;
  const bool is_close = around.nearest_front - depth <= kDeepest * std::abs(depth);
  return around.leading < kWhole * tile.edge_weight &&
         (is_filtered(back.channel[kTag]) || is_cut || is_close) &&
         around.nearest_front >= depth - kRimDepth * std::abs(depth);
}

/// Is a fragment a whole surface of which the DepthSlope is known? At grazing angles the slopes of
/// uneven surfaces change too fast.
bool is_slanted(const TileABuffer& tile, const Fragment& fragment) {
  const float* const c = fragment.channel;
  return tile.layout.planes && !is_merged(fragment) && is_filtered(c[kTag]) &&
         c[kWeight] >= kWholeSurface * tile.mean_weight &&
         (is_even(c[kTag]) || !is_grazing(c[kTag]));
}

/// Does it tell the depths some pixels around, too?
bool is_plane(const TileABuffer& tile, const Fragment& fragment) {
  return is_slanted(tile, fragment) && is_even(fragment.channel[kTag]);
}

/// What parts the surfaces of two fragments of a side, of which the first is nearer.
/// \param middle  the depth between the surfaces.
DepthBorder border_between(const TileABuffer& tile, const Fragment& near, const Fragment& far,
                           float middle) {
  const DepthSlope a = DepthSlope::unpack(near.slope);
  const DepthSlope b = DepthSlope::unpack(far.slope);
  if (is_plane(tile, near) && is_plane(tile, far)) {
    return {{middle, {(a.x + b.x) / 2, (a.y + b.y) / 2}},
            {front_depth(near) - front_depth(far), {a.x - b.x, a.y - b.y}}};
  }
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  // What slopes have in common tells surfaces beside each other apart, where planes say too much of
  // curved ones.
  const auto common = [](float s, float t) {
    return s * t > 0 ? std::copysign(std::min(std::abs(s), std::abs(t)), s) : 0.0F;
  };
  return {{middle, {common(a.x, b.x), common(a.y, b.y)}}, {kInfinity, {}}};
}

/// Finds the surfaces that a pixel's fragments, nearest first, are parts of: fragments of one side
/// are slabs of one surface where they lie close together and none of them is a whole surface.
/// \param at  The fragment of a number.
template <class At>
class PixelSurfaces {
 public:
  PixelSurfaces(const TileABuffer& tile, int count, const At& at) : at_(at) {
    std::array<int, 2> last{-1, -1};  // By side: the surface that was found last.
    for (int i = 0; i < count; ++i) {
      const Fragment& fragment = at(i);
      const float depth = front_depth(fragment);
      const float weight = is_merged(fragment) ? kMany : fragment.channel[kWeight];
      int& before = last[shows_front(fragment.channel[kTag]) ? 1 : 0];
      const bool goes_on =
          before >= 0 &&
          std::min(weight, surfaces_[before].sum) < kWholeSurface * tile.mean_weight &&
          surfaces_[before].sum + weight < kSeveralSurfaces * tile.mean_weight &&
          surfaces_[before].last - depth <= slab_depth(at(before), fragment);
      if (!goes_on) {
        surfaces_[i] = {
            depth, 0, {{-kInfinity, {}}, {kInfinity, {}}}, {{kInfinity, {}}, {kInfinity, {}}}};
        if (before >= 0) {
          const float between = (surfaces_[before].last + depth) / 2;
          surfaces_[i].nearest = border_between(tile, at(before), fragment, between);
          surfaces_[before].farthest = surfaces_[i].nearest;
        }
        before = i;
      }
      surfaces_[before].sum += weight;
      surfaces_[before].last = depth;
      of_[i] = before;
    }
  }

  /// The depths of the surface of a fragment around the pixel.
  SurfaceRange range(int i) const {
    const Surface& surface = surfaces_[of_[i]];
    const float tag = at_(i).channel[kTag];
    return {shows_front(tag), surface.nearest, surface.farthest, surface.sum,
            spacing_step(std::bit_cast<std::uint32_t>(tag))};
  }
  /// The number of the surface of a fragment: of its first fragment.
  int of(int i) const { return of_[i]; }
  /// The share of a surface's sum that a fragment has.
  float share(int i) const { return at_(i).channel[kWeight] / surfaces_[of_[i]].sum; }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr float kMany = 1e6F;  ///< More than any surface sums up to.
  struct Surface {
    float last;  ///< Depth of its last fragment.
    float sum;   ///< Of rho.
    DepthBorder farthest, nearest;
  };

  const At& at_;
  std::array<Surface, kMostLayers> surfaces_;
  std::array<int, kMostLayers> of_;
};

/// Leaves a surface the part of its pixel in which it is nearer than the next whole one, where
/// their planes cross: what the pixel filter has on its side of the line. The other one has the
/// rest. Planes of the two sides of a body cross at its rim, where the surfaces do not.
/// \param behind  The fragments behind the surface, nearest first.
void cross(const TileABuffer& tile, SeenFragment& seen, std::span<SeenFragment> behind) {
  const Fragment& fragment = *seen.fragment;
  if (!tile.edge_filter || !is_slanted(tile, fragment)) return;
  const auto found = std::find_if(behind.begin(), behind.end(), [&](const SeenFragment& other) {
    return is_slanted(tile, *other.fragment);
  });
  if (found == behind.end() || at_rims(fragment, *found->fragment)) return;
  const Fragment& next = *found->fragment;
  const DepthSlope a = DepthSlope::unpack(fragment.slope);
  const DepthSlope b = DepthSlope::unpack(next.slope);
  const float gap = front_depth(fragment) - front_depth(next);
  const float slope = std::sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y));
  constexpr float kFar = 4;  // Pixels.
  if (!(gap < kFar * slope)) return;
  // A surface that ends beside the line covers less.
  const float coverage = tile.edge_filter->half_plane(gap / slope);
  if (!(coverage < seen.coverage)) return;
  seen.coverage = coverage;
  seen.full_weight = fragment.channel[kWeight] / seen.coverage;
  found->coverage = 1;
  found->full_weight = next.channel[kWeight];
}

/// What is seen of a pixel's fragments, nearest first.
/// \param at       The fragment of a number.
/// \param look     The EdgeNeighbors of a fragment.
/// \param edge_of  How the surface of a SurfaceRange covers the pixel.
template <class At, class Look, class EdgeOf>
std::span<SeenFragment> look_at(const TileABuffer& tile, int count, const At& at, const Look& look,
                                const EdgeOf& edge_of,
                                std::array<SeenFragment, kMostLayers>& seen) {
  std::optional<PixelSurfaces<At>> surfaces;
  std::array<EdgeFilter::Edge, kMostLayers> edges;  // By surface.
  std::array<float, kMostLayers> open;              // By surface: what its fragments leave of it.
  std::array<bool, kMostLayers> known{};            // By surface.
  bool hidden = false;
  for (int i = 0; i < count; ++i) {
    const Fragment& fragment = at(i);
    const bool may_end = !hidden && may_be_at_edge(tile, i + 1 == count, fragment);
    const bool may_be_far = may_be_far_side(tile, count, fragment);
    const bool far_side = may_be_far && is_far_side(tile, fragment, look(fragment));
    if (!may_end) {
      const bool ends = far_side && is_filtered(fragment.channel[kTag]);
      seen[i] = seen_at(tile, fragment, ends ? 1.0F : 0.0F, far_side);
      hidden = hidden || hides(tile, seen[i]);
      continue;
    }
    if (!surfaces) surfaces.emplace(tile, count, at);
    const int surface = surfaces->of(i);
    if (!known[surface]) {
      known[surface] = true;
      edges[surface] = edge_of(surfaces->range(i));
      open[surface] = 1;
    }
    const EdgeFilter::Edge edge = edges[surface];
    const float degree = far_side ? 1 : edge.degree;
    seen[i] = seen_at(tile, fragment, degree, far_side);
    const bool cut = tile.layout.clips && fragment.channel[kCutPartial] > 0;
    if (!cut && edge.degree > 0) {
      // Fragments of one surface share what it covers.
      const float part = edge.coverage * surfaces->share(i);
      const float coverage = open[surface] > 0 ? std::min(1.0F, part / open[surface]) : 1;
      open[surface] -= part;
      const float inside = tile.coverage(fragment, 0);
      seen[i].coverage = std::max(kLeastCoverage, inside + degree * (coverage - inside));
      seen[i].full_weight = fragment.channel[kWeight] / seen[i].coverage;
    }
    hidden = hidden || hides(tile, seen[i]);
  }
  const std::span all = std::span(seen).first(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i + 1 < all.size(); ++i) cross(tile, all[i], all.subspan(i + 1));
  return all;
}

/// The front and the back of one body in a pixel. Near the body's silhouette each of the two sides
/// covers a part of the pixel, and the two parts are the same, except where the samples of the
/// sides are uneven.
class TwoSides {
 public:
  /// A front-facing fragment is added.
  /// \param transmitted  what the fragments before it let through.
  /// \param one_body  the degree to which it is one body with what follows.
  void add_front(float coverage, float transmitted, float one_body) {
    const bool another = back_ > 0 || front_ >= 1;
    if (another || front_ == 0) before_ = transmitted;
    front_ = joint(another ? 0 : front_, coverage);
    back_ = 0;
    one_body_ = one_body;
  }
  /// How much of a back is added, by what (12) lets it add: (12) is for surfaces which cover parts
  /// of the pixel that have nothing to do with each other.
  struct BackShare {
    float all = 1;
    float beyond = 0;  ///< The part of `all` where the front does not cover the pixel.
  };
  /// A back-facing fragment is added.
  /// \param rim  it is surely one body with the front before.
  BackShare add_back(float coverage, float transmitted, bool rim) {
    if (rim) one_body_ = 1;
    const float independent = coverage * transmitted;
    if (front_ == 0 || !(independent > 0)) return {};
    if (back_ == 0) after_front_ = transmitted;
    // What looks out from behind the body so far, and what the front lets through of the rest.
    const float back = joint(back_, coverage);
    const float beyond = std::max(0.0F, back - std::max(front_, back_));
    const float hidden = (coverage - beyond) * (1 - (1 - after_front_ / before_) / front_);
    back_ = back;
    if (back >= 1) end();
    const float share = std::min(1.0F, (beyond + hidden) * before_ / independent);
    const float all = 1 + one_body_ * (share - 1);
    return {all, std::min(all, one_body_ * beyond * before_ / independent)};
  }
  /// What comes next is of other bodies.
  void end() { front_ = back_ = 0; }

 private:
  /// Layers of one side are taken to cover independent parts.
  static float joint(float a, float b) { return a + (1 - a) * b; }

  float front_ = 0, back_ = 0;          ///< Coverage of the body's sides so far.
  float before_ = 1, after_front_ = 1;  ///< What is let through before the body and by its front.
  float one_body_ = 0;
};

/// What fragments that end at lines cover of a pixel together. (12) is for surfaces that cover
/// parts of the pixel which have nothing to do with each other, but parts beside parallel lines are
/// one within the other where they lie on the same side of their lines, as at the silhouette of a
/// box, and exclude each other where they lie on opposite sides, as at a crease.
class PartsBesideLines {
 public:
  /// A fragment is added, front to back. Returns the factor on what (12) lets it add.
  float add(const Fragment& fragment, float coverage) {
    const float* c = fragment.channel;
    const float x = c[kCutX] / c[kCutPartial];
    const float y = c[kCutY] / c[kCutPartial];
    const float independent = coverage * (1 - coverage_);
    if (coverage_ == 0 || !(independent > 0)) {
      if (coverage_ == 0) *this = {coverage, x, y, shows_front(c[kTag])};
      return 1;
    }
    const float alike = std::clamp(x * x_ + y * y_, -1.0F, 1.0F);
    // The two sides of a body end together: the larger of the two would be too large wherever
    // their sums are uneven.
    const float beyond = shows_front(c[kTag]) == front_ ? std::max(0.0F, coverage - coverage_) : 0;
    const float added = alike > 0 ? beyond : std::min(coverage, 1 - coverage_);
    const float adds = independent + std::abs(alike) * (added - independent);
    coverage_ += adds;
    return adds / independent;
  }

  PartsBesideLines() = default;

 private:
  PartsBesideLines(float coverage, float x, float y, bool front)
      : coverage_(coverage), x_(x), y_(y), front_(front) {}

  float coverage_ = 0;   ///< Of all fragments so far; 0: there is none.
  float x_ = 0, y_ = 0;  ///< Mean outward vector of the first one ...
  bool front_ = false;   ///< ... and whether it shows its front.
};

/// Composites the fragments of a pixel front to back.
class FrontToBack {
 public:
  /// \param x, y  the pixel in the picture.
  FrontToBack(const TileABuffer& tile, int x, int y)
      : tile_(tile), x_(static_cast<float>(x) + 0.5F), y_(static_cast<float>(y) + 0.5F) {}

  void add(const SeenFragment& seen) {
    const Fragment& fragment = *seen.fragment;
    const float* c = fragment.channel;
    const bool several = is_merged(fragment);
    Rgba color{c[kRed], c[kGreen], c[kBlue], c[kAlpha]};
    if (!several) color = tile_.shader->shade(fragment, x_, y_, seen.full_weight);
    const bool cut = !several && tile_.layout.clips && c[kCutPartial] > 0;
    const float beside = cut ? beside_lines_.add(fragment, seen.coverage) : 1;
    const auto scaled = [](const Rgba& by, float f) {
      return Rgba{f * by.red, f * by.green, f * by.blue, f * by.alpha};
    };
    if (several && !tile_.layout.opaque) {
      sides_.end();
    } else if (shows_front(c[kTag])) {
      if (cut) color = scaled(color, beside);
      sides_.add_front(seen.coverage, 1 - color_.alpha, seen.one_body);
      front_ = &fragment;
      front_color_ = color;
    } else {
      const bool rim =
          front_ && (seen.far_side || at_rims(*front_, fragment)) && front_color_.alpha > 0;
      const TwoSides::BackShare share = sides_.add_back(seen.coverage, 1 - color_.alpha, rim);
      // At a silhouette the back reaches beyond the front where its samples happen to lie so: it
      // is the front's edge that is seen there.
      const float own = rim ? share.all - share.beyond : share.all;
      const float others = rim ? share.beyond * color.alpha / front_color_.alpha : 0;
      if (cut && beside < share.all) {
        color = scaled(color, beside);
      } else {
        color = {own * color.red + others * front_color_.red,
                 own * color.green + others * front_color_.green,
                 own * color.blue + others * front_color_.blue, share.all * color.alpha};
      }
    }
    color_.composite(color);
    if (!tile_.shader->has_environment()) return;
    if (several) {
      Fragment one = fragment;
      one.channel[kOther] = 0;
      surfaces_.add(one, -c[kWeight], 1, color.alpha);
    } else {
      surfaces_.add(fragment, 1, seen.coverage, color.alpha);
    }
  }
  /// A merged fragment behind all others.
  void add_rest(const Fragment& fragment) {
    const float* c = fragment.channel;
    color_.composite({c[kRed], c[kGreen], c[kBlue], c[kAlpha]});
    if (!tile_.shader->has_environment()) return;
    surfaces_.add(fragment, -c[kWeight], c[kCovered], c[kAlpha]);
  }
  /// Composites what has been added over the environment.
  void add_environment() { tile_.shader->add_environment(color_, surfaces_, x_, y_); }
  const Rgba& color() const { return color_; }
  /// How many surfaces there are, where there is an environment behind them.
  float layers() const { return surfaces_.layers(); }

 private:
  const TileABuffer& tile_;
  float x_, y_;
  Rgba color_;
  const Fragment* front_ = nullptr;  ///< The last front-facing fragment.
  Rgba front_color_;
  TwoSides sides_;
  PartsBesideLines beside_lines_;
  SeenThrough surfaces_;
};

/// Puts a pixel's fragments, nearest first, into the order in which they are seen. That is the
/// order of their depths, but beyond a body's silhouette, where kernels still reach: there the
/// tangent planes of its front and of its back have crossed, and the back is the nearer one. Where
/// neither covers the whole pixel, or both are at one rim, the front goes first.
void order_by_sight(std::span<SeenFragment> fragments) {
  // From here on the fragments before show backs that may lie beyond a silhouette.
  std::size_t first_back = 0;
  bool covered = false;   // Does one of these backs cover the pixel?
  bool far_sides = true;  // Are all of them far sides of bodies whose near sides do not come first?
  for (std::size_t i = 0; i < fragments.size(); ++i) {
    const Fragment& fragment = *fragments[i].fragment;
    const bool front = shows_front(fragment.channel[kTag]);
    const bool part = fragments[i].coverage < 1;
    const bool far_side = fragments[i].far_side;
    if (!front && (part || far_side || is_grazing(fragment.channel[kTag]))) {
      covered = covered || !part;
      far_sides = far_sides && far_side;
      continue;
    }
    if (front && first_back < i &&
        (far_sides || (part && !covered) ||
         at_one_rim(*fragments[first_back].fragment, fragment))) {
      fragments[i].one_body = 1;
      const auto begin = fragments.begin();
      std::rotate(begin + static_cast<std::ptrdiff_t>(first_back),
                  begin + static_cast<std::ptrdiff_t>(i),
                  begin + static_cast<std::ptrdiff_t>(i) + 1);
      ++first_back;
      far_sides = false;
    } else {
      first_back = i + 1;
      covered = false;
      far_sides = !front;
    }
  }
}

/// Opaque surfaces that the kernel of a pixel crosses at a fold, at a step or where two bodies meet
/// come as several fragments. They cover as much of it as a fragment with all of their sums would,
/// and that is shared out by the sums, which are what the pixel filter sees of each. A sum between
/// edge_weight and the mean may be a whole one, unless all fragments together have little more. Of
/// an even surface it is a whole one: another one close behind lacks what the first has hidden.
/// \param seen  in the order in which they are seen.
void share_by_sums(const TileABuffer& tile, std::span<SeenFragment> seen) {
  if (!tile.layout.opaque || seen.size() < 2) return;
  const auto weight_of = [](const SeenFragment& at) {
    return is_merged(*at.fragment) ? 0 : at.fragment->channel[kWeight];
  };
  float total = 0;
  for (const SeenFragment& at : seen) total += weight_of(at);
  const float several = kSeveralSurfaces * tile.mean_weight;
  const float nearly = total < several ? tile.mean_weight : tile.edge_weight;
  const auto is_part = [&](const SeenFragment& at) {
    const float* c = at.fragment->channel;
    return !is_merged(*at.fragment) && is_filtered(c[kTag]) &&
           !(tile.layout.clips && c[kCutPartial] > 0);
  };
  const auto follows = [&](const SeenFragment& back, const SeenFragment& front) {
    const float depth = front_depth(*front.fragment);
    return is_part(back) &&
           shows_front(back.fragment->channel[kTag]) ==
               shows_front(front.fragment->channel[kTag]) &&
           std::abs(depth - front_depth(*back.fragment)) <= kRimDepth * std::abs(depth);
  };
  for (std::size_t first = 0; first + 1 < seen.size();) {
    float sum = weight_of(seen[first]);
    float open = 1 - seen[first].coverage;
    std::size_t end = first + 1;
    const bool even = is_even(seen[first].fragment->channel[kTag]);
    if (is_part(seen[first]) && sum < (even ? tile.edge_weight : nearly)) {
      for (; end < seen.size() && follows(seen[end], seen[end - 1]); ++end) {
        if (sum + weight_of(seen[end]) >= several) break;
        sum += weight_of(seen[end]);
        open *= 1 - seen[end].coverage;
      }
    }
    if (end - first > 1) {
      const float degree =
          std::clamp((kSeveralSurfaces - sum / tile.mean_weight) / (kSeveralSurfaces - kOneSurface),
                     0.0F, 1.0F);
      // At an edge the pixels around have told what they cover.
      const float covered =
          std::max(1 - open, (1 - seen[first].edge) * std::min(1.0F, sum / tile.edge_weight));
      float transmitted = 1;
      for (SeenFragment& part : seen.subspan(first, end - first)) {
        // Rounding may leave nothing for a part that hardly weighs.
        const float shared =
            transmitted > 0 ? std::min(1.0F, covered * weight_of(part) / sum / transmitted) : 1;
        transmitted *= 1 - shared;
        part.coverage += degree * (shared - part.coverage);
        part.full_weight = weight_of(part) / part.coverage;
      }
    }
    first = end;
  }
}

/// SS01 (12).
Fragment merged(const TileABuffer& tile, const Fragment& front, const Fragment& back, int pixel) {
  // Layers run out at rims, where surfaces end before one another. The sums around merged fragments
  // are not known yet: taken to be inside a surface, rims grow (by 1 dB of a head's picture); taken
  // to be at an edge, crests that are seen at a grazing angle get thin. Filtered splats are
  // therefore taken to be most of the way to an edge; surfaces that cover the pixel are not
  // changed.
  const auto see = [&](const Fragment& f, const Fragment& other) {
    const bool far_side = may_be_far_side(tile, 2, f) && shows_front(other.channel[kTag]) &&
                          is_far_side(tile, f, {f.channel[kWeight], front_depth(other)});
    return seen_at(tile, f, !is_merged(f) && is_filtered(f.channel[kTag]) ? kMergedEdge : 0.0F,
                   far_side);
  };
  std::array<SeenFragment, 2> seen{see(front, back), see(back, front)};
  order_by_sight(seen);
  share_by_sums(tile, seen);
  FrontToBack pair(tile, tile.x0 + tile_pixel_x(pixel), tile.y0 + tile_pixel_y(pixel));
  pair.add(seen[0]);
  const float first_alpha = pair.color().alpha;
  pair.add(seen[1]);
  const Rgba& color = pair.color();
  Fragment out{};
  // Negative, as in SS01. The number matters where there is an environment to be seen behind.
  out.channel[kWeight] = pair.layers() > 0 ? -pair.layers() : -1;
  out.channel[kDepth] = front_depth(front);
  out.channel[kRed] = color.red;
  out.channel[kGreen] = color.green;
  out.channel[kBlue] = color.blue;
  out.channel[kAlpha] = color.alpha;
  // The environment behind all surfaces is seen through the first one. Opaque surfaces let none
  // through: what they leave of the pixel is left to the side that shows more of itself.
  const Fragment& shown =
      *seen[tile.layout.opaque && color.alpha > 2 * first_alpha ? 1 : 0].fragment;
  out.channel[kTag] = shown.channel[kTag];
  const float weight = is_merged(shown) ? 1 : shown.channel[kWeight];
  for (const int c : {kNormalX, kNormalY, kNormalZ}) out.channel[c] = shown.channel[c] / weight;
  out.channel[kBack] = back_depth(back);
  return out;
}

/// Makes a PixelResult of a pixel's fragments.
class Resolver {
 public:
  Resolver(const TileABuffer& tile, int x, int y) : tile_(tile), composite_(tile, x, y) {
    result_.depth = result_.depth_first = kInfinity;
  }

  /// The next fragment, front to back.
  void add(const SeenFragment& seen) {
    composite_.add(seen);
    const Fragment& fragment = *seen.fragment;
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
    if (is_merged(rest)) composite_.add_rest(rest);
    result_.opacity = composite_.color().alpha;
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

/// Makes a pixel opaque whose surfaces leave a part of it open, so that each keeps its part of the
/// colour. Surfaces behind an edge may not have been drawn. Where nothing is behind a surface that
/// ends, EdgeCoverage sets the opacity later.
void cover(PixelResult& result) {
  if (!(result.opacity > 0)) return;
  const float scale = 1 / result.opacity;
  for (float* const c : {&result.color.red, &result.color.green, &result.color.blue}) *c *= scale;
  result.color.alpha = result.opacity = 1;
}

/// \param seen  the fragments of a pixel in the picture, nearest first; gets reordered.
PixelResult resolve(const TileABuffer& tile, int x, int y, std::span<SeenFragment> seen,
                    const Fragment& rest) {
  order_by_sight(seen);
  share_by_sums(tile, seen);
  Resolver resolver(tile, x, y);
  bool whole = false;  // Is one of them a whole surface, which may end near the pixel?
  for (const SeenFragment& fragment : seen) {
    resolver.add(fragment);
    const float* const c = fragment.fragment->channel;
    const bool cut = tile.layout.clips && c[kCutPartial] > 0;
    whole = whole || (!is_merged(*fragment.fragment) && is_filtered(c[kTag]) && !cut &&
                      c[kWeight] >= tile.edge_weight);
  }
  PixelResult result = resolver.finish(rest);
  if (tile.edges_later && whole) cover(result);
  return result;
}

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
  if (tile.layout.planes && !is_merged(fragment)) {
    tile.at(layer, kSlope, pixel) = std::bit_cast<float>(fragment.slope);
  }
}

/// Adds the sums of a fragment to those in a layer, which keeps its tag.
void add_to_layer(TileABuffer& tile, int layer, int pixel, const Fragment& more) {
  for (int c = 0; c < tile.layout.channels(); ++c) {
    const bool sum = c != kTag && c != kBack && !(tile.layout.planes && c == kSlope);
    if (sum) tile.at(layer, c, pixel) += more.channel[c];
  }
}

/// The numbers of two fragments of a pixel that are slabs of one surface by their depths and sums,
/// no other fragment of their side between them: the closest pair, if there is one.
std::optional<std::pair<int, int>> slabs_of_one(const TileABuffer& tile, const Sorted& sorted) {
  std::optional<std::pair<int, int>> found;
  float least = std::numeric_limits<float>::infinity();
  std::array<int, 2> last{-1, -1};  // By side: the fragment before.
  for (int i = 0; i < sorted.count; ++i) {
    const float* const c = sorted[i].channel;
    const int before = std::exchange(last[shows_front(c[kTag]) ? 1 : 0], i);
    if (before < 0 || is_merged(sorted[i]) || is_merged(sorted[before])) continue;
    const float depth = front_depth(sorted[i]);
    const float distance = front_depth(sorted[before]) - depth;
    const bool one = c[kWeight] + sorted[before].channel[kWeight] < kOneSurface * tile.mean_weight;
    if (one && distance < least && distance <= slab_depth(sorted[before], sorted[i])) {
      least = distance;
      found = {before, i};
    }
  }
  return found;
}

}  // namespace

bool covers(const TileABuffer& tile, const Fragment& fragment) {
  const float* const c = fragment.channel;
  if (is_merged(fragment)) return c[kAlpha] >= kOpaqueAlpha;
  if (tile.layout.clips && c[kCutAway] > kWholeCutAway * c[kWeight]) return false;
  return c[kWeight] >= tile.edge_weight && c[kAlpha] >= c[kWeight] * kOpaqueAlpha;
}

float TileABuffer::hidden_behind(float nearest, float farthest) const {
  if (!(farthest > -std::numeric_limits<float>::infinity()) || !(nearest >= farthest))
    return farthest;
  constexpr float kBeyond = 2;  // Pixels.
  constexpr float kDeeper = 3;  // Depths of a pixel.
  const float slope = (nearest - farthest) / (kStripWidth - 1);
  return farthest - kBeyond * slope - kDeeper * (shader ? shader->pixel_depth(farthest) : 0);
}

bool replace_back(TileABuffer& tile, int pixel, const Fragment& fresh, float depth) {
  if (!shows_front(fresh.channel[kTag])) return false;
  int place = -1;
  float farthest = depth;
  for (int layer = 0; layer < tile.layout.layers; ++layer) {
    const float weight = tile.at(layer, kWeight, pixel);
    if (!(weight > 0) || shows_front(tile.at(layer, kTag, pixel))) continue;
    const float at = tile.at(layer, kDepth, pixel) / weight;
    if (!(at < farthest)) continue;
    farthest = at;
    place = layer;
  }
  if (place >= 0) store(tile, place, pixel, fresh);
  return place >= 0;
}

void drop_behind(TileABuffer& tile, int pixel, float depth, float covering) {
  int kept = 0;
  int layer = 0;
  for (; layer < tile.layout.layers && tile.at(layer, kWeight, pixel) != 0; ++layer) {
    const float weight = tile.at(layer, kWeight, pixel);
    const float sum = tile.at(layer, kDepth, pixel);
    const bool is_back = weight > 0 && !shows_front(tile.at(layer, kTag, pixel));
    if ((weight < 0 ? sum : sum / weight) < (is_back ? std::max(covering, depth) : depth)) continue;
    if (kept < layer) {
      Fragment fragment;
      load(tile, layer, pixel, fragment);
      store(tile, kept, pixel, fragment);
    }
    ++kept;
  }
  for (; kept < layer; ++kept) tile.at(kept, kWeight, pixel) = 0;
}

void load_fragment(const TileABuffer& tile, int layer, int pixel, Fragment& fragment) {
  load(tile, layer, pixel, fragment);
}

float TileABuffer::full_weight_of_cut(const Fragment& fragment, float edge) const {
  const float full = weight_at_edge(edge);
  const float* c = fragment.channel;
  const float aligned = std::sqrt(c[kCutX] * c[kCutX] + c[kCutY] * c[kCutY]) / c[kCutPartial];
  const auto ramp = [](float x, float from, float to) {
    return std::clamp((x - from) / (to - from), 0.0F, 1.0F);
  };
  const float corner = ramp(c[kWeight], kUncovered * mean_weight, kCovered * mean_weight) *
                       ramp(aligned, kOneSide, kCorner);
  const float one_side = ramp(aligned, kTwoSides, kOneSide) * (1 - corner);
  // Kernels smaller than the pixel filter do not reach as far beyond the line as that does: there
  // the mean sum tells more where the pixels around tell that the surface ends, and sums above the
  // mean are of surfels that lie on several short creases.
  float uncut = c[kWeight] + c[kCutAway];
  if (is_filtered(c[kTag])) uncut = std::clamp(uncut, mean_weight * edge, mean_weight);
  return full + one_side * std::max(0.0F, uncut - full);
}

Fragment unmerged(const PixelContribution& contribution) {
  const auto& [rho, depth, splat, normal, cut] = contribution;
  Fragment out{};
  float* c = out.channel;
  c[kWeight] = rho;
  c[kDepth] = rho * depth;
  c[kRed] = rho * splat.red;
  c[kGreen] = rho * splat.green;
  c[kBlue] = rho * splat.blue;
  c[kAlpha] = rho * splat.alpha;
  c[kTag] = std::bit_cast<float>(splat.tag);
  out.slope = DepthSlope::pack(splat);
  if (normal) {
    c[kNormalX] = rho * normal->x;
    c[kNormalY] = rho * normal->y;
    c[kNormalZ] = rho * normal->z;
  }
  std::copy_n(cut, kFragmentChannels - kCutAway, c + kCutAway);
  return out;
}

void insert_by_merging(TileABuffer& tile, int pixel, const Fragment& fresh, float depth) {
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
    add_to_layer(tile, sorted.order[slab], pixel, fresh);
    constexpr float kRest = 0.2F;  // A rim's last sum is less than this share of the mean.
    const Fragment& nearer = slab < in_front ? sorted[slab] : fresh;
    if (tile.layout.opaque && least > kRimDepth * std::abs(depth) &&
        nearer.channel[kWeight] < kRest * tile.mean_weight) {
      // The last contributions of a rim have joined the surface behind it. More of that surface is
      // to come, which must find the fragment at its depth.
      const float farther = std::min(depth, front_depth(sorted[slab]));
      tile.at(sorted.order[slab], kDepth, pixel) =
          farther * tile.at(sorted.order[slab], kWeight, pixel);
    }
    return;
  }
  if (const auto slabs = slabs_of_one(tile, sorted)) {
    add_to_layer(tile, sorted.order[slabs->first], pixel, sorted[slabs->second]);
    store(tile, sorted.order[slabs->second], pixel, fresh);
    return;
  }
  // What lies furthest behind a surface that covers the pixel gives way.
  int covering = 0;
  while (covering < sorted.count && !covers(tile, sorted[covering])) ++covering;
  if (covering + 2 < sorted.count) {
    store(tile, sorted.order[sorted.count - 1], pixel, fresh);
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

void add_to_merged_layer(TileABuffer& tile, int layer, int pixel, const Fragment& fresh) {
  const float x = static_cast<float>(tile.x0 + tile_pixel_x(pixel)) + 0.5F;
  const float y = static_cast<float>(tile.y0 + tile_pixel_y(pixel)) + 0.5F;
  const Rgba color = tile.shader->shade(fresh, x, y, tile.full_weight);
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
    look = look || may_be_at_edge(tile, i + 1 == sorted.count, fragment) ||
           may_be_far_side(tile, sorted.count, fragment);
  }
  if (waits || (look && sees_other_tiles(tile, pixel))) {
    const bool has_rest = waits || is_merged(rest);
    open.pixels.push_back({x, y, open.fragments.size(), sorted.count, has_rest});
    for (int i = 0; i < sorted.count; ++i) open.fragments.push_back(sorted[i]);
    if (has_rest) open.fragments.push_back(rest);
    return std::nullopt;
  }
  std::array<SeenFragment, kMostLayers> seen;
  return resolve(
      tile, x, y,
      look_at(
          tile, sorted.count, [&](int i) -> const Fragment& { return sorted[i]; },
          [&](const Fragment& fragment) { return look_around(tile, fragment, pixel); },
          [&](const SurfaceRange& range) { return edge_around(tile, range, pixel); }, seen),
      rest);
}

PixelResult resolve_open_pixel(const TileABuffer& tile, const OpenPixels& open,
                               const OpenPixels::Pixel& pixel, const TileRims& rims) {
  std::array<SeenFragment, kMostLayers> seen;
  const Fragment* const fragments = open.fragments.data() + pixel.first;
  return resolve(
      tile, pixel.x, pixel.y,
      look_at(
          tile, pixel.count, [&](int i) -> const Fragment& { return fragments[i]; },
          [&](const Fragment& fragment) { return rims.look_around(fragment, pixel.x, pixel.y); },
          [&](const SurfaceRange& range) {
            return rims.edge_around(*tile.edge_filter, range, pixel.x, pixel.y);
          },
          seen),
      pixel.rest ? fragments[pixel.count] : Fragment{});
}

}  // namespace surfel
