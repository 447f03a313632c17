#include "tools/support/gaussians.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/timing.h>
#include <surfel/io/gaussian_io.h>

#include "tools/support/files.h"
#include "tools/support/surfels.h"

namespace surfel::tool {

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

GaussianCloud load_gaussians(Tool& tool, const std::string& path) {
  const Timer timer;
  GaussianCloud cloud = read_gaussians(path);
  tool.report()["load_ms"] = timer.milliseconds();
  tell_unusable(tool, path, cloud);
  if (cloud.coarser_skipped > 0) {
    tool.note(fmt::format("{}: has levels of detail; the finest alone is used, {} of {} Gaussians",
                          path, cloud.size(), cloud.size() + cloud.coarser_skipped));
  }
  return cloud;
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
