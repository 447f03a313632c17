// surfel-simplify: fewer surfels, or fewer Gaussians in space, for the same look.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/progress.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/spooled_writer.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/simplify/simplify.h>
#include <surfel/simplify/simplify_blocks.h>
#include <surfel/simplify/simplify_gaussians.h>

#include "tools/support/gaussians.h"
#include "tools/support/options.h"
#include "tools/support/resume.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  std::optional<double> factor;
  surfel::SimplifyOptions simplify;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  bool resume = false;                  ///< Keep what an interrupted run has made.
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  app.add_option("surfels", s.input,
                 "Surfels with normals (PLY, PCD, LAS, LAZ; - = standard input), or trained splats "
                 "(PLY, .splat, .spz, .ksplat)")
      ->required();
  app.add_option("-o,--output", s.output,
                 "Surfels to write (PLY, PCD, LAS, LAZ; - = standard output); of Gaussians PLY, "
                 ".splat or .usda")
      ->required();

  app.group("How few");
  app.add_option("--max-error", s.simplify.max_error,
                 "As few surfels as this error allows, measured at all surfels of the input: root "
                 "mean square over the surface, seen from near, of the errors of colour (linear "
                 "light, 1 = black against white), of shading (of a surface lit by --light) and "
                 "of shape (in units of --unit-deviation) together");
  app.add_option("--count", s.simplify.count,
                 "Exactly this many surfels, with the least error; more where that many sheets or "
                 "materials have to be told apart; surfels mirrored beyond edges come on top")
      ->range(1.0, 4294967295.0);
  app.add_option("--factor", s.factor,
                 "So many times fewer than there are, instead of --count; >= 1");
  app.group("What counts");
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
  app.group("Options");
  app.add_option("--seed", s.simplify.seed, "Seed of the pattern");
  surfel::tool::add_memory(app, s.memory,
                           "Memory for surfels; a binary PLY file in space-filling order "
                           "(surfel-convert --sort curve) may be larger");
  surfel::tool::add_resume(app, s.resume);
}

void report(surfel::tool::Json& json, const surfel::SimplifyReport& r) {
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

/// How many are left of so many.
std::size_t count_of(const Settings& s, std::size_t before) {
  if (!s.factor) return s.simplify.count.value_or(before);
  return std::max<std::size_t>(
      1, static_cast<std::size_t>(std::ceil(static_cast<double>(before) / *s.factor)));
}

void simplify_gaussians(surfel::tool::Tool& tool, Settings& s) {
  surfel::tool::require_valid(
      surfel::tool::without_effect(tool.app(),
                                   {"--max-error", "--unit-deviation", "--light", "--normal-angle",
                                    "--sheet-weight", "--cutoff", "--seed", "--memory", "--resume"},
                                   "on Gaussians in space"));
  if (!s.factor && !s.simplify.count) {
    surfel::throw_usage("give --count or --factor: how many Gaussians are to be left");
  }
  surfel::tool::require_gaussian_name(s.output, s.input);
  surfel::SimplifyGaussiansReport done;
  surfel::GaussianCloud result;
  std::size_t before = 0;
  {
    const surfel::GaussianCloud cloud = surfel::tool::load_gaussians(tool, {s.input});
    before = cloud.size();
    result = surfel::simplify_gaussians(cloud, {.count = count_of(s, before)}, s.input, &done);
  }
  surfel::tool::Json& json = tool.report();
  json["before"] = before;
  json["unseen"] = done.unseen;
  json["merged"] = done.merged;
  json["blur"] = done.blur;
  surfel::tool::add_stages(json, done.times);
  surfel::tool::write_result(tool, result, s.output);
  tool.wrote(
      s.output,
      fmt::format(
          "{} of {} Gaussians{}, {} of them merged", result.size(), before,
          done.unseen > 0 ? fmt::format(" ({} that nobody can see left out)", done.unseen) : "",
          done.merged));
}

/// What the written file holds.
std::string simplified_surfels(const surfel::SimplifyReport& done) {
  return fmt::format(
      "{} of {} surfels{}, error {:.3g} (colour {:.3g}, shading {:.3g}, "
      "shape {:.3g} of {:.3g} units)",
      done.result, done.surfels,
      done.mirrored > 0 ? fmt::format(" and {} mirrored beyond edges", done.mirrored) : "",
      done.error.total(), done.error.color, done.error.shading, done.error.shape,
      done.unit_deviation);
}

void simplify_in_memory(surfel::tool::Tool& tool, Settings& s) {
  const std::string name = surfel::tool::shown_name(s.input);
  surfel::SimplifyReport done;
  surfel::SurfelCloud result;
  {
    const surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input);
    surfel::ProgressStage stage("simplifying", cloud.size(), "surfels");
    if (s.factor) s.simplify.count = count_of(s, cloud.size());
    s.simplify.progress = [&stage](double share) { stage.set_share(share); };
    result = surfel::simplify_surfels(cloud, s.simplify, &done, name);
  }
  report(tool.report(), done);
  tell(tool, name, s, done);
  surfel::tool::write_result(tool, result, s.output);
  tool.wrote(s.output, simplified_surfels(done));
}

/// Spools the results of blocks.
class SpooledSurfels final : public surfel::SurfelSink {
 public:
  SpooledSurfels(const surfel::tool::Tool& tool, const Settings& s)
      : tool_(tool),
        writer_(s.output, {.no_clobber = tool.common().no_clobber,
                           .job = surfel::tool::job(tool, s.resume, {s.input}, s.output)}) {}

  void begin(const surfel::SurfelCloud& like, std::size_t /*count*/) override {
    surfel::SurfelCloud described = like;
    described.provenance.push_back(tool_.provenance());
    writer_.begin(described);
  }
  void put(surfel::SurfelCloud surfels, std::size_t /*at*/) override { writer_.append(surfels); }
  surfel::SpooledWriter& writer() { return writer_; }

 private:
  const surfel::tool::Tool& tool_;
  surfel::SpooledWriter writer_;
};

/// Simplifies surfels that stay in their file, block by block.
void simplify_file(surfel::tool::Tool& tool, Settings& s, const surfel::CloudRanges& ranges,
                   std::uint64_t bytes, std::uint64_t memory) {
  surfel::tool::tell_finest(tool, s.input, ranges.read(0, 1), ranges.size());
  if (s.factor) s.simplify.count = count_of(s, ranges.size());
  SpooledSurfels spool(tool, s);
  surfel::SimplifyReport done;
  if (!surfel::simplify_by_blocks(ranges, s.simplify, spool, &done, s.input,
                                  {.checkpoints = s.resume ? &spool.writer() : nullptr})) {
    surfel::throw_input(
        s.input, bytes > memory
                     ? fmt::format("takes {} MB in memory, of which {} MB are allowed (--memory), "
                                   "and is not in space-filling order; {}",
                                   (bytes >> 20) + 1, memory >> 20, surfel::range_advice(s.input))
                     : "is not in space-filling order, as --resume needs it; " +
                           surfel::range_advice(s.input));
  }
  surfel::tool::tell_resumed(tool, s.output, spool.writer().kept(), spool.writer().surfels());
  report(tool.report(), done);
  tell(tool, s.input, s, done);
  spool.writer().commit();
  tool.wrote(s.output, simplified_surfels(done));
}

/// Bytes of surfels that are simplified in memory, at once ...
std::uint64_t at_once(std::size_t surfels, const surfel::SurfelCloud& first) {
  return surfel::simplify_bytes(surfels, surfel::row_bytes(first));
}
/// ... and block by block.
std::uint64_t by_blocks(std::size_t surfels, const surfel::SurfelCloud& first) {
  constexpr std::size_t kOrder = sizeof(std::uint32_t) + 2 * sizeof(std::uint64_t);
  const std::uint64_t row = surfel::row_bytes(first);
  return surfels * (2 * row + kOrder) + surfel::simplify_block_bytes(row);
}

/// Simplifies a file that is larger than the memory, or whose blocks are kept for a later run, if
/// that can be done. False if the file fits; unset if that is not known of a file that has to.
std::optional<bool> simplify_larger(surfel::tool::Tool& tool, Settings& s, std::uint64_t memory) {
  surfel::tool::check_resume(s.resume, s.output);
  if (!s.resume && !surfel::tool::may_not_fit(s.input, memory)) return false;
  const auto ranges = s.input == "-" ? nullptr : surfel::CloudRanges::open(s.input);
  if (!ranges && s.resume) surfel::tool::refuse_resume(s.input);
  if (!ranges) return std::nullopt;
  if (ranges->size() == 0) return false;
  const surfel::SurfelCloud first = ranges->read(0, 1);
  const bool blocks = ranges->size() > surfel::kMostAtOnce;
  const std::uint64_t bytes =
      blocks ? by_blocks(ranges->size(), first) : at_once(ranges->size(), first);
  if (bytes <= memory && !(s.resume && blocks)) return false;
  const std::uint64_t least =
      blocks ? surfel::simplify_block_bytes(surfel::row_bytes(first)) : bytes;
  if (least > memory) {
    surfel::throw_input(
        s.input, fmt::format("takes {} MB in memory, of which {} MB are allowed (--memory): give "
                             "as much",
                             (least >> 20) + 1, memory >> 20));
  }
  simplify_file(tool, s, *ranges, bytes, memory);
  return true;
}

void simplify_surfels(surfel::tool::Tool& tool, Settings& s) {
  surfel::tool::require_format(s.output, surfel::tool::Writes::kSurfels);
  if (s.factor) {
    s.simplify.count = 1;  // Until it is known how many surfels there are.
  }
  surfel::tool::require_valid(s.simplify.problems());
  const std::uint64_t memory = surfel::memory_to_use(s.memory);
  const std::optional<bool> done = simplify_larger(tool, s, memory);
  if (done == true) return;
  if (!done) {
    // There may be more surfels than have been counted, which blocks need less for.
    surfel::tool::require_room(
        s.input, {}, memory, [](std::size_t surfels, const surfel::SurfelCloud& first) {
          return std::min(at_once(surfels, first), by_blocks(surfels, first));
        });
  }
  simplify_in_memory(tool, s);
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-simplify",
                          "Merges surfels where the surface is flat and its colours are smooth, "
                          "or Gaussians that look the same from afar.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--count", "--factor", "--max-error", "--light", "--normal-angle",
                 "--cutoff", "--memory"},
                {"surfel-simplify lion.ply --count 20k -o few.ply",
                 "surfel-simplify lion.ply --max-error 0.02 -o few.ply",
                 "surfel-simplify trained.ply --factor 10 -o tenth.ply"});
  tool.files().reads({"surfels"});
  // What may be written depends on the input.
  tool.files().writes("--output", surfel::tool::Writes::kAny);
  return tool.run(argc, argv, [&] {
    if (s.factor) {
      // Not a range() of the option, in which what is no number would be.
      if (!(*s.factor >= 1 && std::isfinite(*s.factor))) {
        surfel::throw_usage(fmt::format("--factor is {:g}; it must be a number >= 1", *s.factor));
      }
      surfel::tool::require_valid(
          surfel::tool::without_effect(tool.app(), {"--count", "--max-error"}, "beside --factor"));
    }
    const auto simplify = surfel::holds_gaussians(s.input) ? simplify_gaussians : simplify_surfels;
    simplify(tool, s);
  });
}
