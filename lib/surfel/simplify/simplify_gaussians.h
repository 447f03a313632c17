#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// How many Gaussians simplify_gaussians() leaves.
struct SimplifyGaussiansOptions {
  std::size_t count = 0;  ///< Gaussians to keep, >= 1.

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Figures of a simplify_gaussians().
struct SimplifyGaussiansReport {
  std::size_t unseen = 0;  ///< Gaussians left out, which no trained renderer shows.
  std::size_t merged = 0;  ///< Gaussians of the result that stand for several.
  /// Standard deviation of the blur through which the result was made to be seen, scene units.
  double blur = 0;
  StageTimes times;
};

/// Fewer Gaussians that look the same from afar. Gaussians that nobody can see (has_mass()) are
/// left out, the others are merged pair by pair (gaussian_reduction.h), the pairs first that change
/// pictures least, seen through a blur of the size of what one Gaussian stands for in the mean.
/// Mass, mean, covariance and colours are kept (gaussian_merge.h); Gaussians that are not merged
/// stay as they are, all of them where there are no more than `count`. The result follows a Morton
/// curve. Does not depend on the number of threads.
///
/// Throws Error(kUsage) for bad options, Error(kInput), starting with `name`, where no Gaussian can
/// be seen.
SURFEL_API GaussianCloud simplify_gaussians(const GaussianCloud& cloud,
                                            const SimplifyGaussiansOptions& options,
                                            const std::string& name = {},
                                            SimplifyGaussiansReport* report = nullptr);

}  // namespace surfel
