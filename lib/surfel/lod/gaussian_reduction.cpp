#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/elementary.h>
#include <surfel/base/median.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/lod/gaussian_reduction.h>

namespace surfel {
namespace {

constexpr std::size_t kReductionGrain = 256;
/// Neighbours along the curve that a Gaussian looks at, before it and after it.
constexpr std::size_t kWindow = 16;
/// Difference of colours, 1 being black against white, that costs as much as two balls whose
/// middles are about two of their deviations apart.
constexpr double kColorUnit = 0.1;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

double determinant(const std::array<double, 6>& s) {
  const double yz = s[3] * s[5] - s[4] * s[4];
  const double xz = s[1] * s[5] - s[4] * s[2];
  const double xy = s[1] * s[4] - s[3] * s[2];
  return s[0] * yz - s[1] * xz + s[2] * xy;
}

double log_determinant(const std::array<double, 6>& s) {
  return portable::log(std::max(determinant(s), std::numeric_limits<double>::min()));
}

}  // namespace

void GaussianReduction::sort(MergeGaussians& gaussians, std::size_t round) {
  const std::size_t size = gaussians.size();
  Vec3f low = gaussians.position[0];
  Vec3f high = low;
  for (const Vec3f& p : gaussians.position) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  // A curve's cells have other borders each time.
  for (int axis = 0; axis < 3; ++axis) {
    const double share =
        round == 0 ? 0 : random_uniform(0, round, static_cast<std::uint64_t>(axis));
    low[axis] -= static_cast<float>(share) * (high - low).maxCoeff();
  }
  const Array<std::uint32_t> order = morton_order(gaussians.position, MortonGrid(low, high));
  sorted_.rule = gaussians.rule;
  sorted_.stride = gaussians.stride;
  sorted_.resize(size);
  parallel_each(size, kReductionGrain,
                [&](std::size_t i) { sorted_.assign(i, gaussians, order[i]); });
  std::swap(sorted_, gaussians);
}

void GaussianReduction::find_pairs(const MergeGaussians& gaussians, double blur2) {
  const std::size_t size = gaussians.size();
  terms_.resize(size);
  parallel_each(size, kReductionGrain, [&](std::size_t i) {
    Term& t = terms_[i];
    t.position = gaussians.position[i];
    t.mass = gaussians.mass[i];
    std::array<double, 6> s{};
    std::copy_n(gaussians.covariance[i].begin(), 6, s.begin());
    for (const std::size_t k : {0, 3, 5}) s[k] += blur2;
    std::transform(s.begin(), s.end(), t.variance.begin(),
                   [](double v) { return static_cast<float>(v); });
    t.mass_log = t.mass * log_determinant(s);
  });
  // The mean over the sphere of a squared sum of harmonics is the sum of squares over 4 pi; three
  // colours.
  const double color =
      portable::squared(GaussianCloud::kHarmonic0) / (3 * portable::squared(kColorUnit));
  costs_.resize(size * kWindow);
  parallel_each(size, kReductionGrain, [&](std::size_t i) {
    const Term& a = terms_[i];
    for (std::size_t k = 0; k < kWindow; ++k) {
      float& cost = costs_[i * kWindow + k];
      const std::size_t j = i + k + 1;
      if (j >= size) {
        cost = std::numeric_limits<float>::infinity();
        continue;
      }
      const Term& b = terms_[j];
      const double mass = double{a.mass} + double{b.mass};
      const double share = b.mass / mass;
      const Vec3d apart = (b.position - a.position).cast<double>();
      const double between = share * (1 - share);
      std::array<double, 6> s{};
      for (std::size_t n = 0; n < 6; ++n)
        s[n] = (1 - share) * a.variance[n] + share * b.variance[n];
      s[0] += between * apart[0] * apart[0];
      s[1] += between * apart[0] * apart[1];
      s[2] += between * apart[0] * apart[2];
      s[3] += between * apart[1] * apart[1];
      s[4] += between * apart[1] * apart[2];
      s[5] += between * apart[2] * apart[2];
      const double shape = (mass * log_determinant(s) - a.mass_log - b.mass_log) / 2;
      const float* const first = gaussians.harmonics_of(i);
      const float* const second = gaussians.harmonics_of(j);
      float squares = 0;
      for (std::size_t h = 0; h < gaussians.stride; ++h) {
        squares += portable::squared(first[h] - second[h]);
      }
      cost = static_cast<float>(shape + color * mass * between * squares);
      // Some pair can be merged, whatever overflows.
      if (!std::isfinite(cost)) cost = std::numeric_limits<float>::max();
    }
  });
  best_.resize(size);
  parallel_each(size, kReductionGrain, [&](std::size_t i) {
    float least = std::numeric_limits<float>::infinity();
    std::uint32_t best = kNone;
    const auto look = [&](std::size_t j, float cost) {
      if (!(cost < least)) return;
      least = cost;
      best = static_cast<std::uint32_t>(j);
    };
    for (std::size_t k = std::min(kWindow, i); k > 0; --k) {
      look(i - k, costs_[(i - k) * kWindow + k - 1]);
    }
    for (std::size_t k = 0; k < kWindow; ++k) look(i + k + 1, costs_[i * kWindow + k]);
    best_[i] = best;
  });
  pairs_.clear();
  for (std::size_t i = 0; i < size; ++i) {
    const std::uint32_t j = best_[i];
    if (j == kNone || j < i || best_[j] != i) continue;
    pairs_.push_back({costs_[i * kWindow + (j - i - 1)], static_cast<std::uint32_t>(i), j});
  }
}

void GaussianReduction::merge_pairs(MergeGaussians& gaussians, std::size_t most) {
  const auto cheaper = [](const Pair& a, const Pair& b) {
    return a.cost != b.cost ? a.cost < b.cost : a.first < b.first;
  };
  most = std::min(most, (pairs_.size() + 1) / 2);
  if (most < pairs_.size()) {
    std::nth_element(pairs_.begin(), pairs_.begin() + static_cast<std::ptrdiff_t>(most),
                     pairs_.end(), cheaper);
    pairs_.resize(most);
  }
  parallel_each(pairs_.size(), kReductionGrain,
                [&](std::size_t p) { gaussians.merge(pairs_[p].first, pairs_[p].second); });
  gone_.assign(gaussians.size(), 0);
  for (const Pair& pair : pairs_) gone_[pair.second] = 1;
  std::size_t to = 0;
  for (std::size_t i = 0; i < gaussians.size(); ++i) {
    if (gone_[i]) continue;
    if (to != i) gaussians.assign(to, gaussians, i);
    ++to;
  }
  gaussians.resize(to);
}

void GaussianReduction::run(MergeGaussians& gaussians, std::size_t count, double blur,
                            const std::function<void(std::size_t)>& progress) {
  count = std::max<std::size_t>(count, 1);
  for (std::size_t round = 0; gaussians.size() > count; ++round) {
    sort(gaussians, round);
    find_pairs(gaussians, portable::squared(blur));
    merge_pairs(gaussians, gaussians.size() - count);
    if (progress) progress(gaussians.size());
  }
}

double group_blur(const MergeGaussians& gaussians, std::size_t size) {
  const Array<std::uint32_t> order = morton_order(gaussians.position);
  std::vector<double> radius2;
  for (std::size_t first = 0; first + size <= order.size(); first += size) {
    Vec3d sum(0, 0, 0);
    double squares = 0;
    for (std::size_t i = first; i < first + size; ++i) {
      const Vec3d p =
          (gaussians.position[order[i]] - gaussians.position[order[first]]).cast<double>();
      sum += p;
      squares += p.squaredNorm();
    }
    const auto n = static_cast<double>(size);
    radius2.push_back(std::max(0.0, squares / n - (sum / n).squaredNorm()));
  }
  return radius2.empty() ? 0 : 0.5 * std::sqrt(median(radius2));
}

}  // namespace surfel
