#include <algorithm>
#include <cmath>

#include <surfel/sp06/joint_layers.h>

namespace surfel {
namespace {

/// Least weight of a fragment in a mean depth: kernels may be 0 at their rim.
constexpr float kLeastRho = 1e-12F;

float key_of(const TileJob& job, const SplatFragment& f) {
  return std::sqrt(f.beta / job.rules->cutoff);
}

/// The layer of whose surface a fragment is, or a new one.
std::uint32_t layer_of(const SplatFragment& f, std::uint32_t side, LayerStack& stack) {
  for (std::uint32_t i = 0; i < stack.layers.size(); ++i) {
    const PixelLayer& layer = stack.layers[i];
    // The difference of depths, times the layer's weight.
    const float nearer = f.depth * layer.sum - layer.depth;
    if (layer.side == side && std::abs(nearer) < f.epsilon * layer.sum) return i;
  }
  return stack.add({.side = side, .depth = 0});
}

/// Adds a fragment to its layer. Returns whether the layer has had one of the group.
bool join(const TileJob& job, const SplatFragment& f, LayerStack& stack) {
  const std::uint32_t layer = layer_of(f, side_of(job, f.splat), stack);
  const float weight = std::max(f.rho, kLeastRho);
  stack.layers[layer].sum += weight;
  stack.layers[layer].depth += weight * f.depth;
  const float key = key_of(job, f);
  GroupMember* const member = stack.find(layer, job.groups[f.splat]);
  if (!member) {
    stack.members.push_back({layer, f.splat, job.groups[f.splat], false, key});
  } else if (key < member->key) {
    member->splat = f.splat;
    member->key = key;
  }
  return member != nullptr;
}

/// Fills the place that a group leaves in the nearest layer, within epsilon, of a fragment's side.
void fill(const TileJob& added, const SplatFragment& f, LayerStack& stack) {
  const std::uint32_t side = side_of(added, f.splat);
  float least = f.epsilon;
  const PixelLayer* nearest = nullptr;
  for (const PixelLayer& layer : stack.layers) {
    const float distance = std::abs(f.depth - layer.depth);
    if (layer.side != side || !(distance < least)) continue;
    least = distance;
    nearest = &layer;
  }
  if (!nearest) return;
  const auto layer = static_cast<std::uint32_t>(nearest - stack.layers.data());
  const GroupMember filling{layer, f.splat, added.groups[f.splat], true, key_of(added, f)};
  GroupMember* const member = stack.find(layer, filling.group);
  if (!member) {
    stack.members.push_back(filling);
  } else if (member->added && filling.key < member->key) {
    *member = filling;
  }
}

}  // namespace

std::uint64_t tell_joint_layers(const LayerSplats& splats, const NearestLayer* masked,
                                const TileABuffer& tile, LayerStacks& stacks) {
  const TileJob& discs = *splats.discs;
  std::uint64_t culled = 0;
  for_each_fragment(discs, tile, {0, discs.count}, nullptr, [&](const SplatFragment& f) {
    if (!is_seen(masked, f, side_of(discs, f.splat))) return;
    culled += join(discs, f, stacks[f.pixel]) ? 1 : 0;
  });
  for (LayerStack& stack : stacks) {
    for (PixelLayer& layer : stack.layers) {
      layer.depth /= layer.sum;
      layer.place = layer.depth;
      layer.share = std::min(1.0F, layer.sum / tile.full_weight);
    }
  }
  if (!splats.added) return culled;
  const TileJob& added = *splats.added;
  for_each_fragment(added, tile, {0, added.count}, nullptr,
                    [&](const SplatFragment& f) { fill(added, f, stacks[f.pixel]); });
  return culled;
}

}  // namespace surfel
