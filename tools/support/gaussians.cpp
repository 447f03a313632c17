#include "tools/support/gaussians.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/timing.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/scene/gaussian_join.h>

#include "tools/support/files.h"
#include "tools/support/surfels.h"

namespace surfel::tool {
namespace {

void tell_left_out(const Tool& tool, const std::string& file, const GaussianCloud& cloud) {
  if (cloud.unusable_skipped > 0) {
    tool.note(fmt::format(
        "{}: {} of {} Gaussians left out, with values that are not finite or scales beyond {:g}",
        shown_name(file), cloud.unusable_skipped, cloud.unusable_skipped + cloud.size(),
        kLargestExtent));
  }
  if (cloud.coarser_skipped > 0) {
    tool.note(fmt::format("{}: has levels of detail; the finest alone is used, {} of {} Gaussians",
                          shown_name(file), cloud.size(), cloud.size() + cloud.coarser_skipped));
  }
}

}  // namespace

bool names_gaussians(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".splat" || extension == ".usda";
}

void require_gaussian_name(const std::string& path, const std::string& input) {
  const std::string extension = lower_extension(path);
  if (extension.empty() || extension == ".ply" || names_gaussians(path)) return;
  throw_usage(fmt::format(
      "{}: {} holds Gaussians in space, which are written as PLY, .splat or .usda", path, input));
}

GaussianCloud load_gaussians(Tool& tool, const std::vector<std::string>& files,
                             const GaussianReadOptions& options) {
  const auto other = std::find_if(files.begin(), files.end(),
                                  [](const std::string& file) { return !holds_gaussians(file); });
  if (other != files.end()) {
    throw_usage(
        fmt::format("{}: holds no Gaussians, unlike other files, which it is not joined with",
                    shown_name(*other)));
  }
  const Timer timer;
  std::vector<GaussianCloud> clouds;
  for (const std::string& file : files) {
    clouds.push_back(read_gaussians(file, options));
    tell_left_out(tool, file, clouds.back());
  }
  GaussianCloud joined = join_gaussians(std::move(clouds), files);
  tool.report()["load_ms"] = timer.milliseconds();
  return joined;
}

void write_result(Tool& tool, const GaussianCloud& cloud, const std::string& path) {
  const bool splat = lower_extension(path) == ".splat";
  if (splat && cloud.degree > 0) {
    tool.note(path + ": colours no longer depend on the direction, .splat has one for all");
  }
  if (splat && !cloud.origin.isZero(0)) {
    tool.note(
        fmt::format("{}: coordinates are relative to {:.10g},{:.10g},{:.10g}, as .splat has "
                    "no place for it",
                    path, cloud.origin.x(), cloud.origin.y(), cloud.origin.z()));
  }
  write_gaussians(cloud, path,
                  {.no_clobber = tool.common().no_clobber, .provenance = {tool.provenance()}});
  tool.report()["gaussians"] = cloud.size();
}

}  // namespace surfel::tool
