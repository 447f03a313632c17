// surfel-lod: levels of detail, so that pictures cost what their pixels cost.

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/levels_writer.h>
#include <surfel/lod/gaussian_hierarchy.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/scene/cloud_rows.h>

#include "tools/support/gaussians.h"
#include "tools/support/options.h"
#include "tools/support/resume.h"
#include "tools/support/run_ranks.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  surfel::HierarchyOptions hierarchy;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  bool resume = false;                  ///< Keep what an interrupted run has made.
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  app.add_option(
         "surfels", s.input,
         "Surfels (PLY, PCD, LAS, LAZ; - = standard input), or trained splats (PLY, .splat, .spz, "
         ".ksplat)")
      ->required();
  app.add_option("-o,--output", s.output,
                 "Surfels or Gaussians of all levels to write (PLY; - = standard output)")
      ->required();
  app.group("Levels");
  app.add_option("--reduction", s.hierarchy.reduction,
                 "Surfels of a level for one of the next coarser level, 2..16: less comes closer "
                 "to what a picture needs, and makes a larger file");
  app.add_option("--normal-angle", s.hierarchy.sheets.normal_angle,
                 "Normals this far from the mean of what is merged are of another sheet, degrees, "
                 "in (0, 90]");
  app.add_option("--sheet-weight", s.hierarchy.sheets.sheet_weight,
                 "How much more distances across the surface count than along it, 1..1000");
  app.group("Options");
  surfel::tool::add_memory(
      app, s.memory,
      "Memory for surfels and their levels; a binary PLY file in space-filling "
      "order (surfel-convert --sort curve) may be larger");
  surfel::tool::add_resume(app, s.resume);
}

void report(surfel::tool::Json& json, const surfel::HierarchyReport& r) {
  json["dropped"] = r.dropped.total();
  json["levels"] = r.levels;
  json["spacing"] = r.spacing;
  json["clusters"] = r.clusters;
  surfel::tool::add_stages(json, r.stages);
}

void report(surfel::tool::Json& json, const surfel::GaussianHierarchyReport& r) {
  json["dropped"] = r.unseen;
  json["levels"] = r.levels;
  json["spacing"] = r.spacing;
  json["clusters"] = r.clusters;
  surfel::tool::add_stages(json, r.stages);
}

void add_levels_of_gaussians(surfel::tool::Tool& tool, const Settings& s) {
  surfel::tool::require_valid(surfel::tool::without_effect(
      tool.app(), {"--normal-angle", "--sheet-weight", "--memory", "--resume"},
      "on Gaussians in space"));
  surfel::GaussianHierarchyReport levels;
  surfel::GaussianCloud result;
  {
    const surfel::GaussianCloud cloud = surfel::tool::load_gaussians(tool, {s.input});
    result = surfel::build_gaussian_hierarchy(cloud, {.reduction = s.hierarchy.reduction}, s.input,
                                              &levels);
  }
  if (levels.unseen > 0) {
    tool.note(fmt::format("{}: {} Gaussians left out, which no trained renderer shows", s.input,
                          levels.unseen));
  }
  report(tool.report(), levels);
  surfel::tool::write_result(tool, result, s.output);
  tool.wrote(s.output,
             fmt::format("{} Gaussians in {} levels of {} down to {}", result.size(),
                         levels.levels.size(), levels.levels.front(), levels.levels.back()));
}

/// Makes levels of the surfels of a file without loading it; false if that cannot be done.
bool make_levels_of_file(surfel::tool::Tool& tool, const Settings& s,
                         const surfel::HierarchyOptions& options, surfel::LevelsWriter& writer,
                         surfel::HierarchyReport& levels) {
  if (s.input == "-") return false;
  const auto ranges = surfel::CloudRanges::open(s.input);
  if (!ranges) return false;
  if (!surfel::build_hierarchy(*ranges, options, writer, &levels, s.input)) return false;
  surfel::tool::tell_finest(tool, s.input, ranges->read(0, 1), ranges->size());
  return true;
}

/// Bytes of surfels that have been loaded, of their order, and of two copies of the keys that it is
/// sorted by.
std::uint64_t bytes_in_memory(std::size_t surfels, const surfel::SurfelCloud& first) {
  constexpr std::size_t kOrder = sizeof(std::uint32_t) + 2 * sizeof(std::uint64_t);
  return std::uint64_t{surfels} * (surfel::row_bytes(first) + kOrder);
}

void make_levels_in_memory(surfel::tool::Tool& tool, const Settings& s,
                           surfel::HierarchyOptions options, surfel::LevelsWriter& writer,
                           surfel::HierarchyReport& levels) {
  surfel::tool::require_room(s.input, {}, options.memory,
                             [](std::size_t surfels, const surfel::SurfelCloud& first) {
                               return bytes_in_memory(surfels, first);
                             });
  const surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input);
  const std::uint64_t taken = bytes_in_memory(cloud.size(), cloud);
  options.memory = std::max<std::uint64_t>(1, options.memory - std::min(options.memory, taken));
  surfel::build_hierarchy(surfel::OrderedCloud(cloud), options, writer, &levels,
                          surfel::tool::shown_name(s.input));
}

void add_levels_of_surfels(surfel::tool::Tool& tool, const Settings& s, surfel::Ranks* ranks) {
  surfel::HierarchyOptions options = s.hierarchy;
  options.memory = surfel::memory_to_use(s.memory);
  surfel::LevelsWriter writer(
      s.output, tool.provenance(),
      {tool.common().no_clobber,
       surfel::tool::job(tool, s.resume, {s.input}, s.output, ranks != nullptr), ranks});
  if (s.resume) options.checkpoints = &writer.file();
  options.peers = ranks;
  surfel::HierarchyReport levels;
  if (!make_levels_of_file(tool, s, options, writer, levels)) {
    make_levels_in_memory(tool, s, options, writer, levels);
  }
  surfel::tool::tell_resumed(tool, s.output, writer.file().rows_kept(), levels.surfels);
  writer.commit();
  if (ranks && ranks->rank() > 0) return;
  surfel::tool::tell_left_out(tool, surfel::tool::shown_name(s.input), levels.dropped);
  report(tool.report(), levels);
  tool.report()["blocks"] = levels.blocks;
  tool.report()["blocks_at_once"] = levels.blocks_at_once;
  tool.wrote(s.output,
             fmt::format("{} surfels in {} levels of {} down to {}", levels.surfels,
                         levels.levels.size(), levels.levels.front(), levels.levels.back()));
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool(
      "surfel-lod", "Adds levels of detail: fewer, larger surfels or Gaussians for distant views.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday(
      {"--output", "--reduction", "--normal-angle", "--memory"},
      {"surfel-lod city.ply -o levels.ply", "surfel-lod city.ply --reduction 2 -o levels.ply",
       "surfel-lod trained.splat -o levels.ply"});
  tool.files().reads({"surfels"});
  tool.files().writes("--output", surfel::tool::Writes::kLevels);
  return surfel::tool::run_ranks(tool, argc, argv, [&](surfel::Ranks* ranks) {
    surfel::tool::require_valid(s.hierarchy.problems());
    if (!surfel::holds_gaussians(s.input)) return add_levels_of_surfels(tool, s, ranks);
    if (ranks) {
      surfel::throw_usage(
          "levels of Gaussians are made by one process; start surfel-lod without "
          "mpirun");
    }
    add_levels_of_gaussians(tool, s);
  });
}
