#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/lod/gaussian_merge.h>

namespace surfel {

/// Merges Gaussians pair by pair until as many are left as asked for, the pairs first that change
/// pictures least. A pair costs
///     B + m m_i m_j / m^2 |c_i - c_j|^2 / color^2,    m = m_i + m_j,
/// where B bounds the Kullback-Leibler divergence of the two from their sum (Runnalls 2007,
/// "Kullback-Leibler approach to Gaussian mixture reduction"),
///     B = (m log |S| - m_i log |S_i| - m_j log |S_j|) / 2,
/// with variances S widened by the blur through which the result is to be seen; c are colours as
/// displays take them, their difference in the mean over all directions. Flat Gaussians of two
/// sides of a thing, or around an edge, have a sum much thicker than they are, which costs.
///
/// Pairs are sought as in Meister & Bittner 2018, "Parallel locally-ordered clustering": each
/// Gaussian looks at its neighbours along a Morton curve, whose origin changes from round to round,
/// and pairs that are each other's best are merged, the cheaper half of them in a round. Does not
/// depend on the number of threads. The result follows a Morton curve. Keeps its memory from call
/// to call.
class SURFEL_API GaussianReduction {
 public:
  /// \param blur  standard deviation of the blur, scene units, >= 0.
  void run(MergeGaussians& gaussians, std::size_t count, double blur,
           const std::function<void(std::size_t left)>& progress = {});

 private:
  /// A Gaussian as costs need it.
  struct Term {
    Vec3f position;
    float mass;
    std::array<float, 6> variance;  ///< Widened by the blur.
    double mass_log;                ///< Mass times the logarithm of |S|.
  };
  struct Pair {
    float cost;
    std::uint32_t first, second;
  };

  void sort(MergeGaussians& gaussians, std::size_t round);
  void find_pairs(const MergeGaussians& gaussians, double blur2);
  void merge_pairs(MergeGaussians& gaussians, std::size_t most);

  MergeGaussians sorted_;
  Array<Term> terms_;
  Array<float> costs_;
  Array<std::uint32_t> best_;
  std::vector<Pair> pairs_;
  std::vector<std::uint8_t> gone_;
};

/// The standard deviation of a blur through which groups of `size` neighbouring Gaussians can
/// hardly be told from one: half of the root mean square distance of their members from their
/// middle, in the median.
SURFEL_API double group_blur(const MergeGaussians& gaussians, std::size_t size);

}  // namespace surfel
