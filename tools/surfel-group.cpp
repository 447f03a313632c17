#include <filesystem>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/timing.h>
#include <surfel/group/grouping.h>
#include <surfel/io/cloud_io.h>

#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  bool print_table = false;
  double max_memory_gb = 0;
  surfel::GroupingOptions grouping;
};

void declare_options(CLI::App& app, Settings& s) {
  using namespace surfel;
  OverlapOptions& overlap = s.grouping.overlap;
  app.add_option("surfels", s.input, "Surfels (PLY, PCD; - = standard input)")->required();
  app.add_option("-o,--output", s.output,
                 "Surfels to write, with their group (- = standard output)");
  app.add_flag("--print-table", s.print_table,
               "Print groups, largest and mean degree for overlaps of 1.0, 0.8, 0.6 and 0.4, a row "
               "of the table in SP06, to standard output");

  app.option_defaults()->group("Overlap");
  app.add_option("--cutoff", overlap.cutoff,
                 "c that a splat ends at: its radius is sqrt(2 c variance), 0.01..16")
      ->capture_default_str();
  app.add_option("--overlap", overlap.overlap,
                 "Splats of a group are no closer than this times the sum of their radii, 0..4")
      ->capture_default_str();
  app.add_flag("--relax-opposite", overlap.relax_opposite,
               "Let splats overlap whose normals point into opposite directions");
  app.add_flag("--relax-coplanar", overlap.relax_coplanar,
               "Let splats overlap that lie in one plane and look the same");
  app.add_option("--coplanar-angle", overlap.coplanar_angle,
                 "Of --relax-coplanar: how far planes may differ, degrees, 0..45")
      ->capture_default_str();
  app.add_option("--coplanar-color", overlap.coplanar_color,
                 "Of --relax-coplanar: how far linear colours and alpha may differ")
      ->capture_default_str();
  app.add_option("--max-memory", s.max_memory_gb,
                 "Most that the overlapping pairs may take, GB; 0 = half of what is free")
      ->capture_default_str();

  app.option_defaults()->group("Groups");
  tool::add_choice(app, "--order", s.grouping.order,
                   {{"largest-first", ColoringOrder::kLargestFirst},
                    {"smallest-last", ColoringOrder::kSmallestLast},
                    {"dsatur", ColoringOrder::kDsatur}},
                   "Order in which splats choose their group: dsatur makes the fewest groups and "
                   "takes longest");
  app.add_option("--groups", s.grouping.groups,
                 "So many groups, each splat where it overlaps least; 0 = as few as it takes for "
                 "no two splats of a group to overlap")
      ->capture_default_str();
  app.option_defaults()->group("Options");
}

void check(const CLI::App& app, Settings& s) {
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
  for (const char* option : {"--coplanar-angle", "--coplanar-color"}) {
    if (s.grouping.overlap.relax_coplanar || app.get_option(option)->count() == 0) continue;
    problems.push_back(fmt::format("{} has no effect without --relax-coplanar", option));
  }
  if (!(s.max_memory_gb >= 0 && s.max_memory_gb <= 1e6)) {
    problems.push_back(
        fmt::format("--max-memory is {}; it must be 0 to 1000000 GB", s.max_memory_gb));
  }
  surfel::tool::require_valid(problems);
  s.grouping.overlap.max_memory = static_cast<std::uint64_t>(s.max_memory_gb * 1e9);
}

void report(nlohmann::json& json, const surfel::GroupingReport& r) {
  json["splats"] = r.splats;
  json["unusable"] = r.unusable;
  json["groups"] = r.groups;
  json["max_degree"] = r.max_degree;
  json["mean_degree"] = r.mean_degree;
  json["edges"] = r.edges;
  json["graph_bytes"] = r.graph_bytes;
  json["group_sizes"] = r.sizes;
  for (const auto& [stage, ms] : r.times.stages()) json["stages"][stage] = ms;
  if (!r.overlap) return;
  json["least_overlap"] = {{"placed_overlap", r.overlap->placed_overlap},
                           {"overlap", r.overlap->overlap},
                           {"overlapping_pairs", r.overlap->overlapping_pairs},
                           {"sweeps", r.overlap->sweeps},
                           {"moved_last", r.overlap->moved_last}};
}

/// SP06 table 1: a row for the cloud.
void print_table(const surfel::SurfelCloud& cloud, const Settings& s, nlohmann::json& json) {
  std::string head = "| surfels | points |";
  std::string row =
      fmt::format("| {} | {} |", std::filesystem::path(s.input).stem().string(), cloud.size());
  std::string rule = "|---|---|";
  for (const double overlap : {1.0, 0.8, 0.6, 0.4}) {
    surfel::GroupingOptions options = s.grouping;
    options.overlap.overlap = overlap;
    surfel::GroupingReport r;
    surfel::make_groups(cloud, options, &r, s.input);
    head += fmt::format(" c = {:.1f} |", overlap);
    rule += "---|";
    row += fmt::format(" {} / {} / {:.1f} |", r.groups, r.max_degree, r.mean_degree);
    nlohmann::json entry = {{"overlap", overlap}};
    report(entry, r);
    json["table"].push_back(std::move(entry));
  }
  surfel::tool::print(head + "\n" + rule + "\n" + row + "\n");
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-group",
                          "Divides surfels into groups in which no two overlap (SP06).");
  Settings settings;
  declare_options(tool.app(), settings);
  return tool.run(argc, argv, [&] {
    check(tool.app(), settings);
    const surfel::Timer timer;
    surfel::SurfelCloud cloud = surfel::read_cloud(settings.input);
    tool.report()["load_ms"] = timer.milliseconds();
    if (settings.print_table) print_table(cloud, settings, tool.report());
    if (settings.output.empty()) return;

    surfel::GroupingReport grouping;
    surfel::group_splats(cloud, settings.grouping, &grouping, settings.input);
    report(tool.report(), grouping);
    if (grouping.unusable > 0) {
      tool.note(
          fmt::format("{}: {} of {} splats have no finite position or no positive variance: "
                      "they are in group 0 and will not be drawn",
                      settings.input, grouping.unusable, grouping.splats));
    }

    cloud.provenance.push_back(tool.provenance());
    surfel::write_cloud(cloud, settings.output, {.no_clobber = tool.common().no_clobber});
    tool.note(fmt::format("{}: {} splats in {} groups; each overlaps {:.1f} others, at most {}",
                          settings.output, grouping.splats, grouping.groups, grouping.mean_degree,
                          grouping.max_degree));
  });
}
