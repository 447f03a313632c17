#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <vector>

#include <surfel/sp06/group_layers.h>

namespace surfel {
namespace {

constexpr std::uint32_t kAllSamples = (1U << kLayerSamples) - 1;
/// Places of the samples from a pixel's centre, pixels: one in each row and each column of a grid.
/// Groups of odd numbers have them mirrored.
constexpr float kSampleX[kLayerSamples] = {-0.125F, 0.375F, -0.375F, 0.125F};
constexpr float kSampleY[kLayerSamples] = {-0.375F, -0.125F, 0.125F, 0.375F};
constexpr float kSampleReach = 0.396F;  ///< No sample is further from the centre.

/// Finds the samples of a patch's pixels that a splat's disc covers.
class CoveredSamples {
 public:
  CoveredSamples(const TileJob& job, const TileABuffer& tile, std::uint32_t splat,
                 std::size_t first)
      : job_(job), tile_(tile), index_(splat), first_(first), rim_(std::sqrt(job.rules->cutoff)) {
    // The root of beta is a norm, which grows by no more than this between a pixel's centre and its
    // samples. The bracket bounds the eigenvalues.
    const Splat& s = job.splats[splat];
    step_ = kSampleReach * std::sqrt(s.k * (1 + s.m * s.m) + s.q);
    if (s.k < 0 || (job.clips && (s.tag & kClippedTag) != 0)) step_ = kUnbounded;
  }

  /// The samples of pixel i of the patch, as bits.
  /// \param beta  at the pixel's centre.
  std::uint32_t at(std::size_t i, float beta) {
    const float root = std::sqrt(beta);
    if (root < rim_ - step_) return kAllSamples;
    if (root > rim_ + step_) return 0;
    if (!sampled_) sample();
    return samples_[i];
  }

 private:
  static constexpr float kUnbounded = std::numeric_limits<float>::infinity();

  void sample() {
    sampled_ = true;
    samples_.fill(0);
    const float mirrored = (job_.groups[index_] & 1) != 0 ? -1.0F : 1.0F;
    PatchSample sample;
    for (int k = 0; k < kLayerSamples; ++k) {
      sample_patch(job_, index_, {tile_.x0, tile_.y0, first_, mirrored * kSampleX[k], kSampleY[k]},
                   sample);
      for (std::size_t i = 0; i < kPatchPixels; ++i) {
        samples_[i] |= sample.beta[i] < job_.rules->cutoff ? 1U << k : 0U;
      }
    }
  }

  const TileJob& job_;
  const TileABuffer& tile_;
  std::uint32_t index_;
  std::size_t first_;
  float rim_, step_;
  bool sampled_ = false;
  std::array<std::uint32_t, kPatchPixels> samples_;
};

/// The most recent layers of a group's side in a pixel.
struct RecentLayers {
  /// The member of the pending layer: its place among the layers is known when the next layer
  /// begins, and until then a fragment nearer to its splat's centre may take its place.
  std::optional<std::uint32_t> pending;
  float last_depth = 0;            ///< Depth of the layer before ...
  std::uint32_t last_samples = 0;  ///< ... and the samples that it covers; 0: there is none.
};

/// The two sides of a group in a pixel.
struct RecentSides {
  std::array<RecentLayers, 2> side;
  float top = 0;     ///< Place of the layer above all others, ...
  float bottom = 0;  ///< ... and beneath all others.
};

class GroupTeller {
 public:
  GroupTeller(const TileJob& job, const LayerRule& rule, LayerStacks& stacks)
      : job_(job), rule_(rule), stacks_(stacks) {}

  /// Takes a fragment that covers some samples.
  void take(const SplatFragment& f, std::uint32_t samples, RecentSides& recent) {
    stack_ = &stacks_[f.pixel];
    const std::uint32_t side = side_of(job_, f.splat);
    RecentLayers& own = recent.side[side];
    const float key = std::sqrt(f.beta / job_.rules->cutoff);
    if (own.pending) {
      GroupMember& member = stack_->members[*own.pending];
      PixelLayer& layer = stack_->layers[member.layer];
      if (rule_.one_layer(f.depth, layer.depth, f.epsilon)) {
        ++culled_;
        layer.samples |= samples;
        if (!(key < member.key)) return;
        layer.depth = f.depth;
        member.splat = f.splat;
        member.key = key;
        return;
      }
      if (f.depth < layer.depth) return take_behind(f, samples, key, recent);
      end_layer(recent, side);
    }
    own.pending = add(f, samples, key);
  }

  /// Gives the layers that are pending their places.
  void finish(LayerStack& stack, RecentSides& recent) {
    stack_ = &stack;
    const bool both = recent.side[0].pending && recent.side[1].pending;
    const bool front_first = both && depth_of(recent.side[1]) < depth_of(recent.side[0]);
    end(recent, front_first ? 1 : 0);
    end(recent, front_first ? 0 : 1);
  }

  std::uint64_t culled() const { return culled_; }

 private:
  float depth_of(const RecentLayers& recent) const {
    return stack_->layers[stack_->members[*recent.pending].layer].depth;
  }

  /// Adds a layer of one fragment and returns its member.
  std::uint32_t add(const SplatFragment& f, std::uint32_t samples, float key) {
    const std::uint32_t layer =
        stack_->add({.side = side_of(job_, f.splat), .depth = f.depth, .samples = samples});
    stack_->members.push_back({layer, f.splat, job_.groups[f.splat], false, key});
    return static_cast<std::uint32_t>(stack_->members.size() - 1);
  }

  /// Puts a side's pending layer over all others.
  void end(RecentSides& recent, std::size_t side) {
    RecentLayers& own = recent.side[side];
    if (!own.pending) return;
    PixelLayer& layer = stack_->layers[stack_->members[*own.pending].layer];
    layer.place = ++recent.top;
    own = {{}, layer.depth, layer.samples};
  }

  /// Ends a side's pending layer, and the other side's behind it.
  void end_layer(RecentSides& recent, std::size_t side) {
    const RecentLayers& other = recent.side[1 - side];
    if (other.pending && depth_of(other) < depth_of(recent.side[side])) end(recent, 1 - side);
    end(recent, side);
  }

  /// Takes a fragment whose splat's centre lies in front of the pending layer, but which does not.
  /// The layer before gets only the samples that it left open.
  void take_behind(const SplatFragment& f, std::uint32_t samples, float key, RecentSides& recent) {
    RecentLayers& own = recent.side[side_of(job_, f.splat)];
    const bool any = own.last_samples != 0;
    const bool same = any && rule_.one_layer(f.depth, own.last_depth, f.epsilon);
    const bool front = !any || f.depth >= own.last_depth;
    const std::uint32_t before = same ? own.last_samples : 0;
    culled_ += same ? 1 : 0;
    if (const std::uint32_t opened = samples & ~before; opened != 0) {
      const std::uint32_t member = add(f, opened, key);
      stack_->layers[stack_->members[member].layer].place = front ? ++recent.top : --recent.bottom;
    }
    if (front && !same) own.last_depth = f.depth;
    if (front || same) own.last_samples = before | samples;
  }

  const TileJob& job_;
  const LayerRule& rule_;
  LayerStacks& stacks_;
  LayerStack* stack_ = nullptr;  ///< Layers of the pixel at hand.
  std::uint64_t culled_ = 0;
};

}  // namespace

std::uint64_t tell_group_layers(const TileJob& job, const LayerRule& rule, int groups,
                                const NearestLayer* masked, const TileABuffer& tile,
                                LayerStacks& stacks) {
  const std::vector<std::uint32_t> order(std::make_reverse_iterator(job.order + job.count),
                                         std::make_reverse_iterator(job.order));
  TileJob back_to_front = job;
  back_to_front.order = order.data();
  std::vector<RecentSides> recent(static_cast<std::size_t>(groups) * kTilePixels);
  const auto at = [&](std::size_t pixel, std::size_t group) -> RecentSides& {
    return recent[pixel * static_cast<std::size_t>(groups) + group];
  };
  GroupTeller teller(job, rule, stacks);
  for_each_patch(back_to_front, tile, {0, job.count}, nullptr,
                 [&](std::uint32_t splat, std::size_t first, const PatchSample& s) {
                   CoveredSamples covered(job, tile, splat, first);
                   for (std::size_t i = 0; i < kPatchPixels; ++i) {
                     const std::uint32_t samples = covered.at(i, s.beta[i]);
                     const SplatFragment f{first + i,  splat,        s.beta[i],
                                           s.depth[i], s.epsilon[i], s.rho[i]};
                     if (samples == 0 || !in_picture(tile, f.pixel)) continue;
                     ++*job.fragments;
                     if (!is_seen(masked, f, side_of(job, splat))) continue;
                     teller.take(f, samples, at(f.pixel, job.groups[splat]));
                   }
                 });
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    for (std::size_t group = 0; group < static_cast<std::size_t>(groups); ++group) {
      teller.finish(stacks[pixel], at(pixel, group));
    }
  }
  return teller.culled();
}

}  // namespace surfel
