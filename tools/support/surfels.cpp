#include "tools/support/surfels.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/bounds.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/gaussian_join.h>

#include "tools/support/options.h"

namespace surfel::tool {

namespace {

bool is_finite(float value) { return std::isfinite(value); }
bool is_finite(const Vec3f& value) { return value.allFinite(); }

/// Number of a column's values that are NaN or infinite.
template <class T>
std::size_t not_finite(const Array<T>& column) {
  return count_where(column.size(), [&](std::size_t i) { return !is_finite(column[i]); });
}

}  // namespace

std::string shown_name(const std::string& path) { return path == "-" ? "standard input" : path; }

void tell_skipped(const Tool& tool, const std::string& path, const SurfelCloud& cloud) {
  if (cloud.unmeasured_skipped > 0) {
    tool.note(fmt::format("{}: {} points were not measured, as the file says: left out",
                          shown_name(path), cloud.unmeasured_skipped));
  }
  for (const auto& [element, count] : cloud.skipped_elements) {
    const bool faces = element == "face" || element == "tristrips";
    tool.note(fmt::format("{}: its {} {} not used, the vertices alone are{}", shown_name(path),
                          count,
                          faces ? (element == "face" ? "faces are" : "triangle strips are")
                                : fmt::format("entries of the element '{}' are", element),
                          faces ? "; surfel-from-mesh makes surfels of the surface" : ""));
  }
}

void NotFinite::add(const SurfelCloud& cloud) {
  surfels += cloud.size();
  positions += not_finite(cloud.position);
  normals += not_finite(cloud.normal);
  variances += not_finite(cloud.variance) + not_finite(cloud.variance_u);
  colors += not_finite(cloud.color);
}

void tell_not_finite(const Tool& tool, const std::string& path, const NotFinite& found) {
  std::string counts;
  const auto add = [&](std::size_t count, const char* what) {
    if (count > 0) counts += fmt::format("{}{} {}", counts.empty() ? "" : ", ", count, what);
  };
  add(found.positions, "positions");
  add(found.normals, "normals");
  add(found.variances, "variances");
  add(found.colors, "colours");
  if (counts.empty()) return;
  tool.note(fmt::format("{}: {} of {} surfels are not finite: kept as they are", shown_name(path),
                        counts, found.surfels));
}

CloudReadOptions PartSettings::options() const {
  CloudReadOptions options{.level = level, .every = every, .columns = columns};
  if (bounds) options.bounds = Bounds{Vec3d(bounds->data()), Vec3d(bounds->data() + 3)};
  return options;
}

void add_part(CommandLine& app, PartSettings& part) {
  app.group("Part of a file");
  add_text(app, "--columns", "NAME,...", "",
           "Names of the columns of a text file, - for one to be left out: x,y,z,r,g,b,-; they win "
           "over what the file says",
           [&part](const std::string& text) {
             part.columns.clear();
             for (std::size_t at = 0; at <= text.size();) {
               const std::size_t end = std::min(text.find(',', at), text.size());
               part.columns.push_back(text.substr(at, end - at));
               at = end + 1;
             }
           });
  app.add_option(
      "--level", part.level,
      "Of a COPC file the points of this level and the coarser ones, 0 = the coarsest; no "
      "more of it is read");
  add_vector(app, "--bounds", part.bounds,
             "Points inside this box alone, its lowest and its highest corner: X,Y,Z,X,Y,Z; of a "
             "COPC file little more is read");
  app.add_option("--every", part.every,
                 "Of the points that are left one in so many, the first one on");
  app.group("Options");
}

void tell_finest(const Tool& tool, const std::string& path, const SurfelCloud& cloud,
                 std::size_t surfels) {
  tell_skipped(tool, path, cloud);
  if (cloud.coarser_skipped > 0) {
    tool.note(fmt::format(
        "{}: has levels of detail; the finest alone is used, {} of {} surfels (run surfel-lod on "
        "the result to have them again)",
        shown_name(path), surfels, surfels + cloud.coarser_skipped));
  }
}

namespace {

/// Bytes of a file; 0 where that is not known.
std::uint64_t bytes_of(const std::string& path) {
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(path, error);
  return error ? 0 : size;
}

[[noreturn]] void refuse_larger(const std::string& path, std::uint64_t needed,
                                std::uint64_t memory) {
  throw_input(
      shown_name(path),
      fmt::format("takes {} MB in memory or more, of which {} MB are allowed (--memory); {}",
                  (needed >> 20) + 1, memory >> 20, range_advice(path)));
}

}  // namespace

bool may_not_fit(const std::string& path, std::uint64_t memory) {
  // A compressed surfel takes three bytes or more, and 350 in memory.
  constexpr std::uint64_t kMostGrowth = 128;
  return bytes_of(path) > memory / kMostGrowth;
}

void require_room(const std::string& path, const CloudReadOptions& options, std::uint64_t memory,
                  FunctionRef<std::uint64_t(std::size_t surfels, const SurfelCloud& first)> bytes) {
  if (!may_not_fit(path, memory)) return;
  const std::uint64_t size = bytes_of(path);
  if (size > memory && !CloudReader::reads_pieces(path)) refuse_larger(path, size, memory);
  const CloudReader reader(path, options);
  const SurfelCloud first = reader.first();
  std::size_t surfels = 0;
  reader.for_each([&](const SurfelCloud& piece) {
    surfels += piece.size();
    const std::uint64_t needed = bytes(surfels, first);
    if (needed > memory) refuse_larger(path, needed, memory);
  });
}

SurfelCloud read_finest(Tool& tool, const std::string& path, const CloudReadOptions& options) {
  const Timer timer;
  SurfelCloud cloud = read_cloud(path, options);
  tool.report()["load_ms"] = timer.milliseconds();
  tell_finest(tool, path, cloud, cloud.size());
  return cloud;
}

void tell_left_out(const Tool& tool, const std::string& name, const UnusableSurfels& left_out) {
  if (left_out.total() == 0) return;
  tool.note(
      fmt::format("{}: {} surfels left out ({} with positions, {} with variances, {} with colours "
                  "that are not usable numbers)",
                  name, left_out.total(), left_out.position, left_out.variance, left_out.color));
}

void tell_lost_columns(const Tool& tool, const SurfelCloud& cloud, const std::string& path) {
  const std::vector<std::string> lost = columns_left_out(cloud, path);
  if (lost.empty()) return;
  tool.note(fmt::format("{}: left out, as the format has no place for them: {}", path,
                        fmt::join(lost, ", ")));
}

void tell_changed_columns(const Tool& tool, const std::string& path,
                          const std::vector<std::string>& changes) {
  for (const std::string& change : changes) tool.note(fmt::format("{}: {}", path, change));
}

void write_result(const Tool& tool, SurfelCloud& cloud, const std::string& path, bool ascii) {
  cloud.provenance.push_back(tool.provenance());
  tell_lost_columns(tool, cloud, path);
  tell_changed_columns(
      tool, path,
      write_cloud(cloud, path, {.no_clobber = tool.common().no_clobber, .ascii = ascii}));
}

void require_piecewise_format(const std::string& output, const std::string& input) {
  const std::string extension = lower_extension(output);
  if (extension != ".las" && extension != ".laz") return;
  throw_usage(
      fmt::format("{}: {} does not fit into memory, and LAS files are not written before all "
                  "surfels are known; "
                  "give a .ply",
                  output, shown_name(input)));
}

CloudSurvey survey_of(const SurfelRanges& ranges, const std::string& output, std::size_t piece) {
  CloudSurvey survey(output);
  for (std::size_t begin = 0; begin < ranges.size(); begin += piece) {
    survey.add(ranges.read(begin, std::min(begin + piece, ranges.size())));
  }
  return survey;
}

void write_picture(const Tool& tool, const Image& image, const std::string& path) {
  ImageWriteOptions options;
  options.no_clobber = tool.common().no_clobber;
  write_image(image, path, options);
  tool.wrote(path, fmt::format("{}x{} pixels", image.width, image.height));
}

}  // namespace surfel::tool
