// surfel-simplify: fewer surfels for the same look.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>
#include <surfel/base/progress.h>
#include <surfel/simplify/simplify.h>

#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  surfel::SimplifyOptions simplify;
};

void declare_options(CLI::App& app, Settings& s) {
  app.add_option("surfels", s.input,
                 "Surfels with normals (PLY, PCD, LAS, LAZ; - = standard input)")
      ->required();
  app.add_option("-o,--output", s.output,
                 "Surfels to write (PLY, PCD, LAS, LAZ; - = standard output)")
      ->required();

  app.option_defaults()->group("How few");
  app.add_option("--max-error", s.simplify.max_error,
                 "As few surfels as this error allows, measured at all surfels of the input: root "
                 "mean square over the surface, seen from near, of the errors of colour (linear "
                 "light, 1 = black against white), of shading (of a surface lit by --light) and "
                 "of shape (in units of --unit-deviation) together");
  app.add_option("--count", s.simplify.count,
                 "Exactly this many surfels, with the least error; more where that many sheets or "
                 "materials have to be told apart; surfels mirrored beyond edges come on top")
      ->check(CLI::Range(1.0, 4294967295.0).description(""));
  app.option_defaults()->group("What counts");
  app.add_option("--unit-deviation", s.simplify.unit_deviation,
                 "Distance between the surfaces that counts as much as black against white, scene "
                 "units; default: 1/30 of the bounding box's diagonal");
  app.add_option("--light", s.simplify.light,
                 "Strength of the light of the pictures to come, 0..100: what errors of the "
                 "normals count for; 0 = unlit pictures");
  app.add_option("--normal-angle", s.simplify.sheets.normal_angle,
                 "Surfels whose normals differ by more are not merged, degrees, in (0, 90]");
  app.add_option("--sheet-weight", s.simplify.sheets.sheet_weight,
                 "How much more distances across the surface count than along it, 1..1000");
  app.add_option("--cutoff", s.simplify.cutoff,
                 "The --cutoff that surfel-render is going to use, 0.1..16: the surface closes, "
                 "and colours fit, there");
  app.option_defaults()->group("Options");
  app.add_option("--seed", s.simplify.seed, "Seed of the pattern");
}

void report(nlohmann::json& json, const surfel::SimplifyReport& r) {
  json["dropped"] = r.dropped.total();
  json["surfels"] = r.surfels;
  json["result"] = r.result;
  json["mirrored"] = r.mirrored;
  json["merged"] = r.merged;
  json["no_normal"] = r.no_normal;
  json["unit_deviation"] = r.unit_deviation;
  json["error"] = r.error.total();
  json["color_error"] = r.error.color;
  json["shading_error"] = r.error.shading;
  json["shape_error"] = r.error.shape;
  json["max_distance"] = r.error.max_distance;
  json["uncovered"] = r.uncovered;
  json["reached"] = r.reached;
  json["rounds"] = r.rounds;
  json["left_out"] = r.left_out;
  surfel::tool::add_stages(json, r.times);
}

/// Tells what was left out, and where the goal was not reached.
void tell(const surfel::tool::Tool& tool, const std::string& name, const Settings& s,
          const surfel::SimplifyReport& r) {
  surfel::tool::tell_left_out(tool, name, r.dropped);
  if (r.no_normal > 0) {
    tool.note(
        fmt::format("{}: {} of {} surfels have no normal: kept as they are; surfel-estimate "
                    "gives them one",
                    name, r.no_normal, r.surfels));
  }
  if (!r.left_out.empty()) {
    tool.note(
        fmt::format("{}: {} left out, as groups do not outlast merging; surfel-group makes "
                    "them anew",
                    name, fmt::join(r.left_out, ", ")));
  }
  if (r.reached) return;
  if (s.simplify.max_error) {
    tool.note(fmt::format("{}: nothing can be merged with an error of {:.3g}: all surfels kept",
                          name, *s.simplify.max_error));
  } else if (*s.simplify.count > r.surfels) {
    tool.note(fmt::format("{}: has no more than {} surfels: all kept", name, r.surfels));
  } else {
    tool.note(
        fmt::format("{}: {} surfels instead of {}: what faces differently is not merged; a "
                    "larger --normal-angle leaves fewer",
                    name, r.result, *s.simplify.count));
  }
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-simplify",
                          "Merges surfels where the surface is flat and its colours are smooth.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--count", "--max-error", "--light", "--normal-angle", "--cutoff"},
                {"surfel-simplify lion.ply --count 20k -o few.ply",
                 "surfel-simplify lion.ply --max-error 0.02 -o few.ply",
                 "surfel-simplify lion.ply --max-error 0.02 --light 0 -o unlit.ply"});
  tool.files().reads({"surfels"});
  tool.files().writes("--output", surfel::tool::Writes::kSurfels);
  return tool.run(argc, argv, [&] {
    surfel::tool::require_valid(s.simplify.problems());
    const std::string name = surfel::tool::shown_name(s.input);
    surfel::SimplifyReport done;
    surfel::SurfelCloud result;
    {
      const surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input);
      surfel::ProgressStage stage("simplifying", cloud.size(), "surfels");
      s.simplify.progress = [&stage](double share) { stage.set_share(share); };
      result = surfel::simplify_surfels(cloud, s.simplify, &done, name);
    }
    report(tool.report(), done);
    tell(tool, name, s, done);
    surfel::tool::write_result(tool, result, s.output);
    tool.wrote(
        s.output,
        fmt::format(
            "{} of {} surfels{}, error {:.3g} (colour {:.3g}, shading {:.3g}, "
            "shape {:.3g} of {:.3g} units)",
            done.result, done.surfels,
            done.mirrored > 0 ? fmt::format(" and {} mirrored beyond edges", done.mirrored) : "",
            done.error.total(), done.error.color, done.error.shading, done.error.shape,
            done.unit_deviation));
  });
}
