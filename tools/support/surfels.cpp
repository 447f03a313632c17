#include "tools/support/surfels.h"

#include <fmt/format.h>
#include <surfel/io/cloud_io.h>

namespace surfel::tool {

SurfelCloud read_finest(const Tool& tool, const std::string& path) {
  SurfelCloud cloud = read_cloud(path);
  if (cloud.coarser_skipped > 0) {
    tool.note(fmt::format(
        "{}: has levels of detail; the finest alone is used, {} of {} surfels (run surfel-lod on "
        "the result to have them again)",
        path == "-" ? "standard input" : path, cloud.size(), cloud.size() + cloud.coarser_skipped));
  }
  return cloud;
}

}  // namespace surfel::tool
