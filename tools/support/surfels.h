#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/usable_surfels.h>

#include "tools/support/tool.h"

namespace surfel::tool {

/// The path of an input as messages name it: "-" is the standard input.
std::string shown_name(const std::string& path);

/// Tells which elements of a file, such as faces, are not used.
void tell_skipped(const Tool& tool, const std::string& path, const SurfelCloud& cloud);
/// How many values of a cloud are NaN or infinite.
struct NotFinite {
  std::size_t surfels = 0;
  std::size_t positions = 0;
  std::size_t normals = 0;
  std::size_t variances = 0;
  std::size_t colors = 0;

  void add(const SurfelCloud& cloud);
};
/// Tells how many values of an input that is kept as it is are not finite.
void tell_not_finite(const Tool& tool, const std::string& path, const NotFinite& found);

/// Which part of a file to read.
struct PartSettings {
  std::vector<std::string> columns;
  std::optional<int> level;
  std::optional<std::array<double, 6>> bounds;
  std::uint64_t every = 1;

  bool whole() const { return columns.empty() && !level && !bounds && every == 1; }
  CloudReadOptions options() const;
};
/// Declares --columns, --level, --bounds and --every.
void add_part(CommandLine& app, PartSettings& part);

/// Tells what of a file is not used by a tool that works on the finest level alone.
/// \param cloud    a part of the file, or all of it
/// \param surfels  of the finest level
void tell_finest(const Tool& tool, const std::string& path, const SurfelCloud& cloud,
                 std::size_t surfels);

/// False for files that fit into the memory whatever is in them, and for standard input.
bool may_not_fit(const std::string& path, std::uint64_t memory);

/// Throws Error(kInput) naming a file that has more surfels than fit into the memory that they may
/// take, and saying how to put it into an order that needs less. What reads piece by piece is
/// counted until there are too many; another file that is larger than the memory is not opened.
/// \param bytes  what so many surfels take, with the columns that the first one has.
void require_room(const std::string& path, const CloudReadOptions& options, std::uint64_t memory,
                  FunctionRef<std::uint64_t(std::size_t surfels, const SurfelCloud& first)> bytes);

/// Reads surfels for a tool that works on the finest level alone, and reports the time that takes
/// (`load_ms`). Tells where a file has levels of detail, as they will be missing in the result.
SurfelCloud read_finest(Tool& tool, const std::string& path, const CloudReadOptions& options = {});

/// Tells how many surfels of an input are left out and why, if there are some.
void tell_left_out(const Tool& tool, const std::string& name, const UnusableSurfels& left_out);

/// Tells which columns of a cloud a file of that name does not get.
void tell_lost_columns(const Tool& tool, const SurfelCloud& cloud, const std::string& path);

/// Tells which columns a file that was written holds otherwise than the cloud.
/// \param changes  what write_cloud() returned
void tell_changed_columns(const Tool& tool, const std::string& path,
                          const std::vector<std::string>& changes);

/// Writes the surfels that a tool made, with its line of provenance; `ascii` makes PLY a text.
void write_result(const Tool& tool, SurfelCloud& cloud, const std::string& path,
                  bool ascii = false);

/// Throws Error(kUsage) for LAS files, which are not written before all surfels are known, where an
/// input does not fit into memory.
void require_piecewise_format(const std::string& output, const std::string& input);

/// The survey of surfels that keep their places.
/// \param piece  surfels that are read at a time
CloudSurvey survey_of(const SurfelRanges& ranges, const std::string& output, std::size_t piece);

/// Writes a picture that a tool made, and tells its size.
void write_picture(const Tool& tool, const Image& image, const std::string& path);

}  // namespace surfel::tool
