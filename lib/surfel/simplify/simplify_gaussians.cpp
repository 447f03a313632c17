#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/lod/gaussian_merge.h>
#include <surfel/lod/gaussian_reduction.h>
#include <surfel/simplify/simplify_gaussians.h>

namespace surfel {

std::vector<std::string> SimplifyGaussiansOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, count >= 1, "count", count, ">= 1");
  return found;
}

GaussianCloud simplify_gaussians(const GaussianCloud& cloud,
                                 const SimplifyGaussiansOptions& options, const std::string& name,
                                 SimplifyGaussiansReport* report) {
  require_usable(options);
  if (cloud.size() > MergeGaussians::kMerged) {
    throw_input(name, "holds more than 2^32 Gaussians; leave some out");
  }
  SimplifyGaussiansReport done;
  StageTimer stage(done.times);
  Array<std::uint32_t> order = morton_order(cloud.position);
  done.unseen = without_massless(cloud, order, name);
  MergeGaussians gaussians = merge_gaussians(cloud, order);
  stage.end("prepare");
  const std::size_t before = gaussians.size();
  if (before > options.count) {
    const std::size_t group = (before + options.count - 1) / options.count;
    done.blur = group_blur(gaussians, group);
    ProgressStage progress("merging", before - options.count, "Gaussians");
    std::size_t left = before;
    GaussianReduction().run(gaussians, options.count, done.blur, [&](std::size_t now) {
      progress.add(left - now);
      left = now;
    });
  }
  stage.end("merge");
  GaussianCloud out = drawn_gaussians(gaussians, cloud);
  done.merged = static_cast<std::size_t>(
      std::count(gaussians.source.begin(), gaussians.source.end(), MergeGaussians::kMerged));
  stage.end("write");
  if (report) *report = done;
  return out;
}

}  // namespace surfel
