#include "tools/support/surfels.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>

namespace surfel::tool {

std::string shown_name(const std::string& path) { return path == "-" ? "standard input" : path; }

SurfelCloud read_finest(Tool& tool, const std::string& path) {
  const Timer timer;
  SurfelCloud cloud = read_cloud(path);
  tool.report()["load_ms"] = timer.milliseconds();
  if (cloud.coarser_skipped > 0) {
    tool.note(fmt::format(
        "{}: has levels of detail; the finest alone is used, {} of {} surfels (run surfel-lod on "
        "the result to have them again)",
        shown_name(path), cloud.size(), cloud.size() + cloud.coarser_skipped));
  }
  return cloud;
}

void tell_left_out(const Tool& tool, const std::string& name, const UnusableSurfels& left_out) {
  if (left_out.total() == 0) return;
  tool.note(
      fmt::format("{}: {} surfels left out ({} with positions, {} with variances, {} with colours "
                  "that are not usable numbers)",
                  name, left_out.total(), left_out.position, left_out.variance, left_out.color));
}

void write_result(const Tool& tool, SurfelCloud& cloud, const std::string& path, bool ascii) {
  cloud.provenance.push_back(tool.provenance());
  write_cloud(cloud, path, {.no_clobber = tool.common().no_clobber, .ascii = ascii});
}

void write_picture(const Tool& tool, const Image& image, const std::string& path) {
  ImageWriteOptions options;
  options.no_clobber = tool.common().no_clobber;
  write_image(image, path, options);
  tool.note(fmt::format("{}: {}x{} pixels", path, image.width, image.height));
}

}  // namespace surfel::tool
