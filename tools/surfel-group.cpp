// surfel-group: groups in which no two surfels overlap.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/memory.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/sp06/coverage.h>
#include <surfel/sp06/group_blocks.h>
#include <surfel/sp06/grouping.h>

#include "tools/support/block_writer.h"
#include "tools/support/options.h"
#include "tools/support/resume.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  bool print_table = false;
  double max_memory_gb = 0;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  bool resume = false;                  ///< Keep what an interrupted run has made.
  surfel::GroupingOptions grouping;
  std::optional<surfel::CoverMethod> cover;
  surfel::CoverageOptions coverage;
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  using namespace surfel;
  OverlapOptions& overlap = s.grouping.overlap;
  app.add_option("surfels", s.input, "Surfels (PLY, PCD, LAS, LAZ; - = standard input)")
      ->required();
  app.add_option("-o,--output", s.output,
                 "Surfels to write, with their group (- = standard output)");
  app.add_flag("--print-table", s.print_table,
               "Print groups, largest and mean degree for overlaps of 1.0, 0.8, 0.6 and 0.4, a row "
               "of the table in SP06, to standard output");

  app.group("Overlap");
  app.add_option("--cutoff", overlap.cutoff,
                 "c that a splat ends at: its radius is sqrt(2 c variance), 0.01..16");
  app.add_option("--overlap", overlap.overlap,
                 "Splats of a group are no closer than this times the sum of their radii, 0..4");
  app.add_flag("--relax-opposite", overlap.relax_opposite,
               "Let splats overlap whose normals point into opposite directions");
  app.add_flag("--relax-coplanar", overlap.relax_coplanar,
               "Let splats overlap that lie in one plane and look the same");
  app.add_option("--coplanar-angle", overlap.coplanar_angle,
                 "Of --relax-coplanar: how far planes may differ, degrees, 0..45");
  app.add_option("--coplanar-color", overlap.coplanar_color,
                 "Of --relax-coplanar: how far linear colours and alpha may differ");
  app.add_option(
      "--max-memory", s.max_memory_gb,
      "Most that the overlapping pairs may take, GB; 0 = what 256 neighbours of every surfel "
      "take, at most half of what is free");

  app.group("Groups");
  tool::add_choice(
      app, "--order", s.grouping.order,
      {{"largest-first", ColoringOrder::kLargestFirst},
       {"smallest-last", ColoringOrder::kSmallestLast},
       {"dsatur", ColoringOrder::kDsatur}},
      "Order in which splats choose their group: smallest-last and dsatur make fewer groups "
      "and take longer");
  app.add_option("--groups", s.grouping.groups,
                 "So many groups, each splat where it overlaps least; 0 = as few as it takes for "
                 "no two splats of a group to overlap");

  app.group("Coverage of the surface by every group, for transparent rendering");
  tool::add_choice(app, "--cover", s.cover,
                   {{"none", CoverMethod::kNone},
                    {"enlarge", CoverMethod::kEnlarge},
                    {"enlarge-each", CoverMethod::kEnlargeEach},
                    {"duplicate", CoverMethod::kDuplicate}},
                   "none = measure it; enlarge = one factor for a group's radii; enlarge-each = a "
                   "radius for every splat, the least overlap; duplicate = add splats of other "
                   "groups; default: leave out");
  app.add_option(
      "--cover-target", s.coverage.target,
      "Of --cover enlarge: share of the surface's area that a group shall cover, up to 1; "
      "what no radius covers is reported");
  app.add_option("--most-growth", s.coverage.most_growth,
                 "Of --cover enlarge-each: most that a radius grows by, times the median of its "
                 "group, >= 1; discs at creases would stick out of the surface");
  app.add_option("--least-gain", s.coverage.least_gain,
                 "Of --cover duplicate: a splat is added if it newly covers more than this share "
                 "of its disc, between 0 and 1");
  app.add_option("--fixed-point", s.coverage.fixed_point_iterations,
                 "Of --cover enlarge: iterations of the fixed point in SP06, reported beside the "
                 "solution for comparison; 0 = none");
  app.group("Options");
  tool::add_memory(app, s.memory,
                   "Memory for surfels; a binary PLY file in space-filling order (surfel-convert "
                   "--sort curve) may be larger, without --groups and --cover");
  tool::add_resume(app, s.resume);
}

/// Are many splats divided block by block?
bool can_divide(const Settings& s) { return s.grouping.groups == 0 && !s.cover; }

/// Adds a problem for each given option that has no effect beside the others.
void check_effects(const surfel::tool::CommandLine& app, const Settings& s,
                   std::vector<std::string>& problems) {
  using surfel::CoverMethod;
  const auto needs = [&](const char* option, bool in_force, const char* other) {
    if (in_force || app.get_option(option)->count() == 0) return;
    problems.push_back(
        fmt::format("{} has no effect without {}; give that, or leave it out", option, other));
  };
  needs("--coplanar-angle", s.grouping.overlap.relax_coplanar, "--relax-coplanar");
  needs("--coplanar-color", s.grouping.overlap.relax_coplanar, "--relax-coplanar");
  needs("--cover-target", s.cover == CoverMethod::kEnlarge, "--cover enlarge");
  needs("--fixed-point", s.cover == CoverMethod::kEnlarge, "--cover enlarge");
  needs("--most-growth", s.cover == CoverMethod::kEnlargeEach, "--cover enlarge-each");
  needs("--least-gain", s.cover == CoverMethod::kDuplicate, "--cover duplicate");
  needs("--cover", !s.output.empty(), "--output");
  needs("--overlap", !s.output.empty(), "--output");
  needs("--resume", !s.output.empty(), "--output");
}

void check(const surfel::tool::CommandLine& app, Settings& s) {
  std::vector<std::string> problems = s.grouping.problems();
  if (s.output.empty() && !s.print_table) {
    problems.emplace_back("there is neither --output nor --print-table; give one");
  }
  if (s.output == "-" && s.print_table) {
    problems.emplace_back("--print-table and -o - both want standard output; give a file");
  }
  if (s.print_table && s.grouping.groups > 0) {
    problems.emplace_back("--print-table counts the groups that it takes; leave out --groups");
  }
  check_effects(app, s, problems);
  if (s.resume && !can_divide(s)) {
    problems.emplace_back(
        "--groups and --cover need all surfels at once, and cannot be taken up: leave out "
        "--resume");
  }
  if (!(s.max_memory_gb >= 0 && s.max_memory_gb <= 1e6)) {
    problems.push_back(
        fmt::format("--max-memory is {}; it must be 0 to 1000000 GB", s.max_memory_gb));
  }
  if (s.cover) {
    s.coverage.method = *s.cover;
    s.coverage.cutoff = s.grouping.overlap.cutoff;
    surfel::tool::append(problems, s.coverage.problems());
  }
  surfel::tool::require_valid(problems);
  s.grouping.overlap.max_memory = static_cast<std::uint64_t>(s.max_memory_gb * 1e9);
}

void report(surfel::tool::Json& json, const surfel::GroupingReport& r) {
  json["splats"] = r.splats;
  json["unusable"] = r.unusable;
  json["groups"] = r.groups;
  json["max_degree"] = r.max_degree;
  json["mean_degree"] = r.mean_degree;
  json["edges"] = r.edges;
  json["graph_bytes"] = r.graph_bytes;
  json["group_sizes"] = r.sizes;
  surfel::tool::add_stages(json, r.times);
  if (!r.overlap) return;
  json["least_overlap"] = {{"disc_area", r.overlap->disc_area},
                           {"placed_overlap_area", r.overlap->placed_overlap_area},
                           {"overlap_area", r.overlap->overlap_area},
                           {"overlapping_pairs", r.overlap->overlapping_pairs},
                           {"sweeps", r.overlap->sweeps},
                           {"moved_last", r.overlap->moved_last}};
}

surfel::tool::Json to_json(const surfel::Enlargement& e) {
  return {{"factor", e.factor}, {"iterations", e.iterations}, {"converged", e.converged}};
}

void report(surfel::tool::Json& json, const surfel::CoverageReport& r) {
  json["area"] = r.area;
  json["area_from_column"] = r.area_from_column;
  json["covered_area"] = r.covered_area;
  json["uncovered_area"] = r.uncovered_area;
  json["unreachable_area"] = r.unreachable_area;
  json["overlap_area"] = r.overlap_area;
  json["missed_share"] = r.missed_share;
  json["growth_mean"] = r.growth_mean;
  json["growth_max"] = r.growth_max;
  json["points_before"] = r.points_before;
  json["points_added"] = r.points_added;
  json["capped"] = r.capped;
  json["limited"] = r.limited;
  json["hidden"] = r.hidden;
  json["without_disc"] = r.without_disc;
  json["border_splats"] = r.border_splats;
  surfel::tool::add_stages(json, r.times);
  for (const surfel::GroupCoverage& g : r.groups) {
    surfel::tool::Json group = {{"splats", g.splats},
                                {"added", g.added},
                                {"capped", g.capped},
                                {"limited", g.limited},
                                {"cell_area", g.cell_area},
                                {"covered_area", g.covered_area},
                                {"uncovered_area", g.uncovered_area},
                                {"overlap_area", g.overlap_area},
                                {"unreachable_area", g.unreachable_area},
                                {"missed_share", g.missed_share},
                                {"growth_mean", g.growth_mean},
                                {"growth_max", g.growth_max}};
    if (g.enlargement) group["enlargement"] = to_json(*g.enlargement);
    if (g.fixed_point) group["fixed_point"] = to_json(*g.fixed_point);
    json["groups"].push_back(std::move(group));
  }
}

/// Covers the surface as --cover says, and reports and tells the result.
void cover(surfel::SurfelCloud& cloud, const Settings& s, const surfel::tool::Tool& tool,
           surfel::tool::Json& json) {
  const surfel::CoverageReport r = surfel::cover_groups(cloud, s.coverage, s.input);
  report(json, r);
  const auto percent = [&](double area) { return 100 * area / r.area; };
  tool.note(
      fmt::format("{}: a group covers {:.2f} % of the surface, overlap {:.1f} %; radii grew by "
                  "{:.2f}, at most {:.2f}; {} splats added",
                  s.input, 100 * (1 - r.missed_share), percent(r.overlap_area), r.growth_mean,
                  r.growth_max, r.points_added));
  const bool grew =
      s.cover == surfel::CoverMethod::kEnlarge || s.cover == surfel::CoverMethod::kEnlargeEach;
  if (grew && r.capped > 0) {
    tool.note(
        fmt::format("{}: {} splats grow no further than the surface's border", s.input, r.capped));
  }
  if (s.cover == surfel::CoverMethod::kEnlarge && percent(r.unreachable_area) >= 0.01) {
    tool.note(
        fmt::format("{}: {:.2g} % of the surface lies where no one factor for the radii of a group "
                    "reaches: add surfels, or use fewer groups or --cover enlarge-each",
                    s.input, percent(r.unreachable_area)));
  }
  if (r.limited > 0) {
    tool.note(
        fmt::format("{}: {} splats grow no further than --most-growth allows", s.input, r.limited));
  }
  if (r.without_disc > 0) {
    tool.note(
        fmt::format("{}: {} splats have no disc, for want of a normal or a size: they cover "
                    "nothing",
                    s.input, r.without_disc));
  }
}

/// Prints a row of SP06, table 1.
/// \param group  divides the splats by some options
void print_table(
    std::size_t surfels, const Settings& s, surfel::tool::Json& json,
    surfel::FunctionRef<surfel::GroupingReport(const surfel::GroupingOptions&)> group) {
  std::string head = "| surfels | points |";
  std::string row =
      fmt::format("| {} | {} |", std::filesystem::path(s.input).stem().string(), surfels);
  std::string rule = "|---|---|";
  for (const double overlap : {1.0, 0.8, 0.6, 0.4}) {
    surfel::GroupingOptions options = s.grouping;
    options.overlap.overlap = overlap;
    const surfel::GroupingReport r = group(options);
    head += fmt::format(" c = {:.1f} |", overlap);
    rule += "---|";
    row += fmt::format(" {} / {} / {:.1f} |", r.groups, r.max_degree, r.mean_degree);
    surfel::tool::Json entry = {{"overlap", overlap}};
    report(entry, r);
    json["table"].push_back(std::move(entry));
  }
  surfel::tool::print(head + "\n" + rule + "\n" + row + "\n");
}

void tell_groups(const surfel::GroupingReport& grouping, const Settings& s,
                 const surfel::tool::Tool& tool) {
  if (grouping.unusable == 0) return;
  tool.note(
      fmt::format("{}: {} of {} splats have no finite position or no positive variance: "
                  "they are in group 0 and will not be drawn",
                  s.input, grouping.unusable, grouping.splats));
}

/// What the written file holds.
std::string grouped_surfels(std::size_t surfels, const surfel::GroupingReport& grouping) {
  std::string what =
      fmt::format("{} surfels in {} groups, of which each overlaps {:.1f} others, at most {}",
                  surfels, grouping.groups, grouping.mean_degree, grouping.max_degree);
  if (grouping.overlap) {
    what += fmt::format(", and within their groups {:.3g} % of their area",
                        100 * grouping.overlap->overlap_area / grouping.overlap->disc_area);
  }
  return what;
}

void group_in_memory(surfel::tool::Tool& tool, const Settings& s) {
  surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input);
  if (s.print_table) {
    print_table(cloud.size(), s, tool.report(), [&](const surfel::GroupingOptions& options) {
      surfel::GroupingReport r;
      surfel::make_groups(cloud, options, &r, s.input);
      return r;
    });
  }
  if (s.output.empty()) return;
  surfel::GroupingReport grouping;
  surfel::group_splats(cloud, s.grouping, &grouping, s.input);
  report(tool.report(), grouping);
  tell_groups(grouping, s, tool);
  if (s.cover) cover(cloud, s, tool, tool.report()["coverage"]);
  surfel::tool::write_result(tool, cloud, s.output);
  tool.wrote(s.output, grouped_surfels(cloud.size(), grouping));
}

[[noreturn]] void refuse_disorder(const Settings& s, std::uint64_t bytes, std::uint64_t memory) {
  surfel::throw_input(
      s.input, bytes > memory
                   ? fmt::format("takes {} MB in memory, of which {} MB are allowed (--memory), "
                                 "and is not in space-filling order; {}",
                                 (bytes >> 20) + 1, memory >> 20, surfel::range_advice(s.input))
                   : "is not in space-filling order, as --resume needs it; " +
                         surfel::range_advice(s.input));
}

/// Where surfels go of which nothing but the groups' figures are wanted.
class NoSurfels final : public surfel::SurfelSink {
 public:
  void begin(const surfel::SurfelCloud& /*like*/, std::size_t /*count*/) override {}
  void put(surfel::SurfelCloud /*surfels*/, std::size_t /*at*/) override {}
};

/// Groups surfels that stay in their file, block by block.
void group_file(surfel::tool::Tool& tool, const Settings& s, const surfel::CloudRanges& ranges,
                std::uint64_t bytes, std::uint64_t memory) {
  if (!s.output.empty()) surfel::tool::require_piecewise_format(s.output, s.input);
  surfel::tool::tell_finest(tool, s.input, ranges.read(0, 1), ranges.size());
  surfel::GroupingOptions grouping = s.grouping;
  if (grouping.overlap.max_memory == 0) grouping.overlap.max_memory = memory / 2;
  if (s.print_table) {
    print_table(ranges.size(), s, tool.report(), [&](surfel::GroupingOptions options) {
      options.overlap.max_memory = grouping.overlap.max_memory;
      surfel::GroupingReport r;
      NoSurfels none;
      if (!surfel::group_by_blocks(ranges, options, none, &r, s.input)) {
        refuse_disorder(s, bytes, memory);
      }
      return r;
    });
  }
  if (s.output.empty()) return;
  surfel::tool::BlockWriter writer(
      tool, s.output,
      {.job = surfel::tool::job(tool, s.resume, {s.input}, s.output),
       .survey = surfel::tool::survey_of(ranges, s.output, surfel::kGroupBlock)});
  surfel::GroupingReport r;
  if (!surfel::group_by_blocks(ranges, grouping, writer, &r, s.input,
                               {.checkpoints = writer.checkpoints()})) {
    refuse_disorder(s, bytes, memory);
  }
  report(tool.report(), r);
  tell_groups(r, s, tool);
  writer.commit();
  tool.wrote(s.output, grouped_surfels(ranges.size(), r));
}

/// Bytes that splats take while all of them are divided at once ...
std::uint64_t at_once(std::size_t surfels, const surfel::SurfelCloud& first, const Settings& s) {
  // The graph has some 20 ends of edges a splat; coverage some 30 corners of its cell.
  constexpr std::size_t kGraph = 350;
  constexpr std::size_t kCells = 500;
  const std::size_t grouped = s.cover ? kGraph + kCells : kGraph;
  return std::uint64_t{surfels} * (surfel::row_bytes(first) + grouped);
}
/// ... and block by block in memory.
std::uint64_t by_blocks(std::size_t surfels, const surfel::SurfelCloud& first) {
  constexpr std::size_t kOrder = 2 * sizeof(std::uint32_t) + 2 * sizeof(std::uint64_t);
  const std::size_t row = surfel::row_bytes(first);
  return std::uint64_t{surfels} * (row + kOrder) + surfel::group_block_bytes(surfels, row);
}

/// Groups a file that is larger than the memory, or whose blocks are kept for a later run, if that
/// can be done. False if the file fits; unset if that is not known of a file that has to.
std::optional<bool> group_larger(surfel::tool::Tool& tool, const Settings& s,
                                 std::uint64_t memory) {
  surfel::tool::check_resume(s.resume, s.output);
  if (!s.resume && !surfel::tool::may_not_fit(s.input, memory)) return false;
  const auto ranges = s.input == "-" ? nullptr : surfel::CloudRanges::open(s.input);
  if (!ranges && s.resume) surfel::tool::refuse_resume(s.input);
  if (!ranges) return std::nullopt;
  if (ranges->size() == 0) return false;
  const surfel::SurfelCloud first = ranges->read(0, 1);
  const bool blocks = ranges->size() > surfel::kMostGroupedAtOnce && can_divide(s);
  const std::uint64_t bytes =
      blocks ? by_blocks(ranges->size(), first) : at_once(ranges->size(), first, s);
  if (bytes <= memory && !(s.resume && blocks)) return false;
  const auto refuse = [&](const std::string& reason) {
    surfel::throw_input(s.input, fmt::format("takes {} MB in memory, of which {} MB are allowed "
                                             "(--memory); {}",
                                             (bytes >> 20) + 1, memory >> 20, reason));
  };
  if (s.cover) refuse("--cover needs all surfels at once; give more memory, or leave it out");
  if (s.grouping.groups > 0) {
    refuse(
        "--groups needs all surfels at once; give more memory, or leave it out for as few "
        "groups as it takes");
  }
  const std::uint64_t least =
      blocks ? surfel::group_block_bytes(ranges->size(), surfel::row_bytes(first)) : bytes;
  if (least > memory) {
    refuse(fmt::format("give {} MB at least", (least >> 20) + 1));
  }
  group_file(tool, s, *ranges, bytes, memory);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-group",
                          "Divides surfels into groups in which no two overlap (SP06).");
  Settings settings;
  declare_options(tool.app(), settings);
  tool.everyday({"--output", "--groups", "--cover", "--cover-target", "--order", "--overlap",
                 "--cutoff", "--print-table", "--memory"},
                {"surfel-group lion.ply -o grouped.ply",
                 "surfel-group lion.ply --groups 4 --cover enlarge-each -o grouped.ply",
                 "surfel-group lion.ply --print-table"});
  tool.files().reads({"surfels"});
  tool.files().writes("--output", surfel::tool::Writes::kSurfels);
  tool.name_fields({{"target", "--cover-target"}, {"fixed_point_iterations", "--fixed-point"}});
  return tool.run(argc, argv, [&] {
    check(tool.app(), settings);
    const std::uint64_t memory = surfel::memory_to_use(settings.memory);
    const std::optional<bool> done = group_larger(tool, settings, memory);
    if (done == true) return;
    if (!done) {
      // There may be more surfels than have been counted, which blocks need less for.
      surfel::tool::require_room(
          settings.input, {}, memory, [&](std::size_t surfels, const surfel::SurfelCloud& first) {
            const std::uint64_t all = at_once(surfels, first, settings);
            return can_divide(settings) ? std::min(all, by_blocks(surfels, first)) : all;
          });
    }
    group_in_memory(tool, settings);
  });
}
