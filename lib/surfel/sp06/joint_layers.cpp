#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/sp06/joint_layers.h>

namespace surfel {
namespace {

constexpr DiscFragment kNoFragment{.key = -1};
/// Least weight in a mean: kernels may be 0 at their rim.
constexpr float kLeastKernel = 1e-12F;

bool same_disc(const DiscFragment& a, const DiscFragment& b) {
  return a.depth == b.depth && a.key == b.key && a.rho == b.rho;
}

/// Sums for the mean depth of fragments, in double: depths lie close together.
struct DepthSum {
  double weight = 0;
  double weighted_depth = 0;

  void add(const DiscFragment& f) {
    const double w = std::max(kLeastKernel, f.rho);
    weight += w;
    weighted_depth += w * static_cast<double>(f.depth);
  }
  float mean() const { return static_cast<float>(weighted_depth / weight); }
};

}  // namespace

std::span<const JointLayers::Member> JointLayers::tell(std::span<DiscFragment> fragments,
                                                       int groups) {
  groups_ = groups;
  culled_ = 0;
  layers_.clear();
  best_.clear();
  members_.clear();
  std::stable_sort(fragments.begin(), fragments.end(),
                   [](const DiscFragment& a, const DiscFragment& b) {
                     if (a.enlarged != b.enlarged) return b.enlarged;
                     if (a.front != b.front) return a.front;
                     return a.depth > b.depth;
                   });
  const auto enlarged = std::find_if(fragments.begin(), fragments.end(),
                                     [](const DiscFragment& f) { return f.enlarged; });
  const auto back =
      std::find_if(fragments.begin(), enlarged, [](const DiscFragment& f) { return !f.front; });
  add_layers({fragments.begin(), back});
  add_layers({back, enlarged});
  for (const DiscFragment& f : std::span(enlarged, fragments.end())) fill(f);
  std::sort(layers_.begin(), layers_.end(), [](const Layer& a, const Layer& b) {
    return a.depth != b.depth ? a.depth < b.depth : a.first > b.first;
  });
  for (const Layer& layer : layers_) {
    for (int k = 0; k < groups_; ++k) {
      const DiscFragment& f = best_[layer.first + static_cast<std::size_t>(k)];
      if (f.key < 0) continue;
      members_.push_back({f.disc, f.group, f.enlarged, layer.depth, layer.weight, f.key});
    }
  }
  return members_;
}

/// \param side  fragments that show the same side, nearest first.
void JointLayers::add_layers(std::span<DiscFragment> side) {
  float most_epsilon = 0;
  for (const DiscFragment& f : side) most_epsilon = std::max(most_epsilon, f.epsilon);
  while (!side.empty()) side = side.subspan(take_layer(side, most_epsilon));
}

/// Takes the nearest layer out of fragments. Moves the others to the end, in their order, and
/// returns where they begin.
std::size_t JointLayers::take_layer(std::span<DiscFragment> left, float most_epsilon) {
  // As in peel_tile(): the fragments that reach the nearest one, and those that reach their mean.
  const float next = left.front().depth;
  DepthSum reaching;
  for (const DiscFragment& f : left) {
    if (f.depth + most_epsilon < next) break;
    if (f.depth + f.epsilon >= next) reaching.add(f);
  }
  const float anchor = std::min(next, reaching.mean());
  std::size_t end = 0;
  while (end < left.size() && left[end].depth + most_epsilon >= anchor) ++end;
  taken_.clear();
  for (std::size_t i = end; i-- > 0;) {
    if (left[i].depth + left[i].epsilon >= anchor) {
      taken_.push_back(left[i]);
    } else {
      left[--end] = left[i];
    }
  }
  DepthSum sum;
  for (std::size_t i = taken_.size(); i-- > 0;) {
    const bool copy = i + 1 < taken_.size() && same_disc(taken_[i], taken_[i + 1]);
    if (!copy) sum.add(taken_[i]);
  }
  const Layer layer{left.front().front, sum.mean(), static_cast<float>(sum.weight), best_.size()};
  layers_.push_back(layer);
  best_.resize(best_.size() + static_cast<std::size_t>(groups_), kNoFragment);
  for (std::size_t i = taken_.size(); i-- > 0;) choose(layer, taken_[i]);
  return end;
}

/// Makes the fragment its group's fragment of a layer if it lies nearer to its disc's centre.
void JointLayers::choose(const Layer& layer, const DiscFragment& fragment) {
  DiscFragment& best = best_[layer.first + fragment.group];
  const bool none = best.key < 0;
  if (!none && !fragment.enlarged) ++culled_;
  if (none || (best.enlarged == fragment.enlarged && fragment.key < best.key)) best = fragment;
}

/// Takes an enlarged disc's fragment for the layer of its side that lies nearest to it, if any does
/// within its epsilon.
void JointLayers::fill(const DiscFragment& fragment) {
  const Layer* nearest = nullptr;
  float least = fragment.epsilon;
  for (const Layer& layer : layers_) {
    const float distance = std::abs(fragment.depth - layer.depth);
    if (layer.front != fragment.front || distance >= least) continue;
    least = distance;
    nearest = &layer;
  }
  if (nearest) choose(*nearest, fragment);
}

}  // namespace surfel
