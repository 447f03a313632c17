// surfel-estimate: surfels from raw points.

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/estimate/estimate.h>
#include <surfel/estimate/estimate_blocks.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/row_file.h>
#include <surfel/ranks/ranks.h>
#include <surfel/scene/cloud_rows.h>

#include "tools/support/block_writer.h"
#include "tools/support/options.h"
#include "tools/support/resume.h"
#include "tools/support/run_ranks.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  std::string k = "16";
  std::optional<surfel::Vec3d> viewpoint;
  bool remove_outliers = false;
  surfel::OutlierOptions outliers;
  std::string voxel;
  bool smooth = false;
  bool clip = false;
  surfel::CreaseOptions creases;
  surfel::SmoothingOptions smoothing;
  surfel::EstimateOptions estimate;
  surfel::tool::PartSettings part;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  bool resume = false;                  ///< Keep what an interrupted run has made.
};

const std::vector<std::pair<std::string, surfel::Orientation>>& orientations() {
  using surfel::Orientation;
  static const std::vector<std::pair<std::string, Orientation>> names{
      {"auto", Orientation::kAuto},
      {"winding", Orientation::kWinding},
      {"mst", Orientation::kMst},
      {"outward", Orientation::kOutward},
      {"viewpoint", Orientation::kViewpoint},
      {"up", Orientation::kUp},
      {"align", Orientation::kAlign},
      {"none", Orientation::kNone}};
  return names;
}

const std::string& name_of(surfel::Orientation method) {
  const auto& names = orientations();
  return std::find_if(names.begin(), names.end(), [&](const auto& n) { return n.second == method; })
      ->first;
}

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  using namespace surfel;
  using tool::add_choice;
  app.add_option("cloud", s.input,
                 "Points (PLY, PCD, LAS, LAZ, E57, PTX, XYZ, PTS, TXT; - = standard input)")
      ->required();
  app.add_option("-o,--output", s.output, "Surfels to write (- = standard output)")->required();

  tool::add_part(app, s.part);
  app.group("Neighbourhoods");
  app.add_option("-k", s.k,
                 "Points of a neighbourhood, the point itself included, 3..65535; auto = from "
                 "--k-min to --k-max, as noise, curvature and density ask for it");
  app.add_option("--k-min", s.estimate.normals.k_min, "Least points with -k auto");
  app.add_option("--k-max", s.estimate.normals.k_max, "Most points with -k auto");
  app.add_option("--radius", s.estimate.normals.radius,
                 "Above 0: all points within that distance instead, scene units");
  add_choice(
      app, "--noise", s.estimate.normals.grow_in_noise, {{"auto", true}, {"ignore", false}},
      "auto: where noise exceeds the points' spacing, as depth cameras' does, neighbourhoods "
      "as large as it asks for, whatever -k says; ignore: as -k says");
  add_choice(app, "--search", s.estimate.search,
             {{"exact", SearchMethod::kExact},
              {"flann", SearchMethod::kFlann},
              {"flann-approx", SearchMethod::kFlannApproximate}},
             "exact and flann find the same, flann in several times the time; flann-approx misses "
             "about 1 in 100 neighbours: --verbose and --stats tell how many");
  app.add_flag("--remove-outliers", s.remove_outliers,
               "Remove points that are further from their neighbours than most");
  app.add_option("--outlier-k", s.outliers.neighbors, "Neighbours whose mean distance counts");
  app.add_option("--outlier-deviations", s.outliers.deviations,
                 "Standard deviations above the mean of all from which on a point is one");

  app.group("Points, before the normals, in this order");
  tool::add_text(
      app, "--voxel", "SIZE", "",
      "Average the points in each cubic cell of this edge, scene units; auto = twice the "
      "points' spacing",
      [&s](const std::string& text) { s.voxel = text; });
  add_choice(app, "--smooth", s.smooth, {{"none", false}, {"mls", true}},
             "mls: move points onto polynomials fitted to their neighbours (moving least squares); "
             "takes noise away, and rounds edges");
  app.add_option("--smooth-radius", s.smoothing.spacings,
                 "Reach of the fit in spacings, 1..20: more takes away more noise and more detail");
  app.add_option("--smooth-order", s.smoothing.order, "Order of the polynomials, 1..5; 1 = planes");
  add_choice(app, "--smooth-normals", s.smoothing.normals, {{"fit", true}, {"points", false}},
             "Normals of the polynomials, or of the moved points' neighbours as -k says");

  app.group("Orientation");
  add_choice(app, "--orient", s.estimate.orientation.method, orientations(),
             "Side of the normals: towards the viewpoint where the file says it, else winding "
             "(auto); out of what surfaces enclose, by the winding number (winding); consistent "
             "along the surface (mst), its outermost points outward; towards the viewpoint or up; "
             "that of the normals in the file (align); any (none)");
  tool::add_vector(
      app, "--viewpoint", s.viewpoint,
      "Where the scanner stood, world coordinates; default: what the file says, of each scan");
  tool::add_text(
      app, "--up", "DIRECTION", fmt::format("{}", fmt::join(s.estimate.orientation.up, ",")),
      "Direction for --orient up: x, y, z, -x, -y, -z or X,Y,Z", [&s](const std::string& text) {
        s.estimate.orientation.up = tool::parse_direction("--up", text);
      });

  app.group("Splats");
  add_choice(
      app, "--variance", s.estimate.size.rule,
      {{"cover", VarianceRule::kCover}, {"max-distance", VarianceRule::kMaxDistance}},
      "cover: discs at the cutoff just close the surface; max-distance: the largest distance "
      "in a small neighbourhood is the standard deviation");
  add_choice(app, "--anisotropy", s.estimate.size.anisotropy,
             {{"auto", Anisotropy::kAuto}, {"on", Anisotropy::kOn}, {"off", Anisotropy::kOff}},
             "Ellipses instead of discs: auto = where samples lie in lines");
  app.add_option("--cutoff", s.estimate.size.cutoff,
                 "c that --variance cover closes the surface at, 0.1..16");
  app.add_option(
      "--max-radius", s.estimate.size.max_radius,
      "Longest reach of a splat with --variance cover, in local spacings (mean distance of the "
      "four nearest), at least 1: leaves and clutter get no petals; 0 = as far as gaps are");
  app.add_flag("--clip", s.clip,
               "Surfels end at the borders of scans, and at creases, whose points get their own "
               "face's normals, where these are certain");
  app.add_option("--crease-angle", s.creases.crease_angle,
                 "Least angle between faces beside a crease, 10..90 degrees; with --clip");
  app.group("Options");
  tool::add_memory(app, s.memory,
                   "Memory for the points and all that is made of them; a binary PLY file in "
                   "space-filling order (surfel-convert --sort curve) may be larger: its surfels "
                   "are made block by block, and are the same");
  tool::add_resume(app, s.resume);
}

/// Fills in where the scanner stood, which the file may tell; `cloud` are points of it.
void finish(Settings& s, const surfel::SurfelCloud& cloud) {
  s.estimate.orientation.viewpoint = s.viewpoint;
  if (s.viewpoint) {
    s.estimate.normals.sensor = s.viewpoint;
  } else if (cloud.viewpoint) {
    s.estimate.normals.sensor = cloud.viewpoint->position;
  } else if (s.estimate.orientation.method == surfel::Orientation::kViewpoint &&
             cloud.sensors().empty()) {
    surfel::throw_usage(
        fmt::format("{} does not say where the scanner stood; give --viewpoint X,Y,Z", s.input));
  }
}

/// Text as a number, all of it.
template <class T>
bool parse(const std::string& text, T& value) {
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && rest == end;
}

void check_filters(const surfel::tool::CommandLine& app, Settings& s) {
  if (s.remove_outliers) s.estimate.outliers = s.outliers;
  if (s.smooth) {
    s.estimate.smoothing = s.smoothing;
  } else {
    surfel::tool::require_valid(surfel::tool::without_effect(
        app, {"--smooth-radius", "--smooth-order", "--smooth-normals"}, "without --smooth mls"));
  }
  if (s.voxel.empty()) return;
  double& edge = s.estimate.voxels.emplace().edge;
  if (s.voxel != "auto" && !(parse(s.voxel, edge) && edge > 0)) {
    surfel::throw_usage(
        fmt::format("--voxel is '{}'; it must be a length above 0, or auto", s.voxel));
  }
}

/// Refuses options that these settings do not heed.
void check_effect(const surfel::tool::CommandLine& app, const Settings& s) {
  std::vector<std::string> problems;
  const auto refuse = [&](bool unheeded, const std::vector<std::string>& options,
                          const std::string& where) {
    if (unheeded) {
      surfel::tool::append(problems, surfel::tool::without_effect(app, options, where));
    }
  };
  using surfel::Orientation;
  refuse(!s.estimate.normals.adaptive, {"--k-min", "--k-max"}, "without -k auto");
  refuse(!s.remove_outliers, {"--outlier-k", "--outlier-deviations"}, "without --remove-outliers");
  refuse(s.estimate.orientation.method != Orientation::kUp, {"--up"}, "without --orient up");
  refuse(s.estimate.size.rule != surfel::VarianceRule::kCover, {"--cutoff", "--max-radius"},
         "without --variance cover");
  refuse(!s.clip, {"--crease-angle"}, "without --clip");
  surfel::tool::require_valid(problems);
}

void check(const surfel::tool::CommandLine& app, Settings& s) {
  if (s.k == "auto") {
    s.estimate.normals.adaptive = true;
  } else if (!parse(surfel::tool::whole_number(s.k).value_or(s.k), s.estimate.normals.k)) {
    surfel::throw_usage(fmt::format("-k is '{}'; it must be a whole number or auto", s.k));
  }
  check_filters(app, s);
  if (s.clip) s.estimate.edges = s.creases;
  check_effect(app, s);
  std::vector<std::string> problems = s.estimate.problems();
  surfel::tool::append(problems, s.part.options().problems());
  surfel::tool::require_valid(problems);
}

void report(surfel::tool::Json& json, bool edges, const surfel::EstimateReport& r) {
  json["points"] = r.points;
  json["nonfinite"] = r.nonfinite;
  json["without_normal"] = r.without_normal;
  json["outliers"] = r.outliers;
  if (r.voxel_edge > 0) json["voxels"] = {{"edge", r.voxel_edge}, {"fewer_points", r.averaged}};
  if (r.smoothed) {
    json["smoothing"] = {
        {"mean_shift", r.mean_shift}, {"largest_shift", r.largest_shift}, {"stayed", r.stayed}};
  }
  json["flags"] = {{"good", r.flagged[0]},
                   {"thin", r.flagged[1]},
                   {"too_few", r.flagged[2]},
                   {"coincident", r.flagged[3]},
                   {"collinear", r.flagged[4]}};
  json["extended"] = r.extended;
  json["mean_neighbors"] = r.mean_neighbors;
  if (r.remade > 0) json["noise"] = {{"deviation", r.noise}, {"normals", r.remade}};
  if (r.search_recall) json["search_recall"] = *r.search_recall;
  json["orientation"] = name_of(r.orientation.method);
  json["components"] = r.orientation.components;
  json["side_confidence"] = r.side_confidence;
  json["flipped"] = r.orientation.flipped;
  json["unknown_normals"] = r.orientation.unknown;
  json["border"] = r.border;
  json["capped"] = r.capped;
  json["anisotropic"] = r.anisotropic;
  if (edges) {
    json["edges"] = {{"at_creases", r.creases.points},
                     {"unsure_creases", r.creases.unsure},
                     {"at_borders", r.borders.points},
                     {"unsure_borders", r.borders.unsure}};
  }
  surfel::tool::add_stages(json, r.times);
}

void warn(const surfel::tool::Tool& tool, const std::string& input, bool edges,
          const surfel::EstimateReport& r) {
  const auto count = [&](std::size_t points, const char* what) {
    if (points > 0) tool.note(fmt::format("{}: {} of {} points {}", input, points, r.points, what));
  };
  count(r.nonfinite, "are not finite: removed");
  if (r.unusable_colors > 0) {
    tool.note(fmt::format("{}: {} of {} colours are not finite: such surfels will not be drawn",
                          input, r.unusable_colors, r.points));
  }
  count(r.without_normal, "have no usable normal to align with: their side follows the others'");
  count(r.outliers, "are outliers: removed");
  if (r.voxel_edge > 0) {
    tool.note(fmt::format("{}: {} points averaged to {}, in cells of {:.4g}", input,
                          r.points - r.nonfinite - r.outliers,
                          r.points - r.nonfinite - r.outliers - r.averaged, r.voxel_edge));
  }
  if (r.smoothed) {
    tool.note(fmt::format("{}: smoothed, points moved by {:.3g} on average, {:.3g} at most", input,
                          r.mean_shift, r.largest_shift));
  }
  count(r.stayed, "have no smooth surface around them: they stay where they are");
  count(r.flagged[2] + r.flagged[3] + r.flagged[4],
        "have no plane through their neighbours: they look at the eye");
  if (r.remade > 0) {
    tool.note(fmt::format(
        "{}: noise of about {:.3g} hides the surface from single neighbourhoods: normals are made "
        "from {:.0f} points on average; --noise ignore makes them as -k says",
        input, r.noise, r.mean_neighbors));
  }
  if (r.orientation.method != surfel::Orientation::kNone) {
    tool.detail(fmt::format(
        "{}: sides of normals by --orient {}, {} parts, mean side_confidence {:.3f}", input,
        name_of(r.orientation.method), r.orientation.components, r.side_confidence));
  }
  if (edges) {
    tool.detail(fmt::format(
        "{}: {} surfels have their face's normal beside creases, {} are unsure; {} surfels end at "
        "borders, {} are unsure",
        input, r.creases.points, r.creases.unsure, r.borders.points, r.borders.unsure));
  }
  if (r.search_recall) {
    tool.detail(fmt::format("{}: --search flann-approx found {:.2f} % of the nearest neighbours",
                            input, 100 * *r.search_recall));
  }
  count(r.capped, "are far from all others: their splats were cut to the neighbours' spacing");
}

void estimate_in_memory(surfel::tool::Tool& tool, Settings& s) {
  const surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input, s.part.options());
  finish(s, cloud);
  surfel::EstimateReport estimate;
  surfel::SurfelCloud surfels = surfel::estimate_surfels(cloud, s.estimate, &estimate, s.input);
  report(tool.report(), s.clip, estimate);
  warn(tool, s.input, s.clip, estimate);
  surfel::tool::write_result(tool, surfels, s.output);
  tool.report()["surfels"] = surfels.size();
  tool.wrote(s.output, fmt::format("{} surfels", surfels.size()));
}

void estimate_in_blocks(surfel::tool::Tool& tool, Settings& s, const surfel::CloudRanges& cloud,
                        const surfel::SurfelCloud& first, std::uint64_t memory,
                        surfel::Ranks* ranks) {
  const std::string extension = surfel::tool::lower_extension(s.output);
  if (extension == ".las" || extension == ".laz") {
    surfel::throw_usage(fmt::format(
        "{}: {} has more points than fit into memory, and LAS files are not written before all "
        "points are known; give a .ply",
        s.output, surfel::tool::shown_name(s.input)));
  }
  finish(s, first);
  surfel::tool::tell_finest(tool, s.input, first, cloud.size());
  // What a process takes without any points.
  constexpr std::uint64_t kProcess = std::uint64_t{48} << 20;
  surfel::tool::BlockWriter writer(
      tool, s.output,
      {.job = surfel::tool::job(tool, s.resume, {s.input}, s.output, ranks != nullptr),
       .peers = ranks});
  surfel::EstimateReport estimate;
  surfel::estimate_by_blocks(cloud, s.estimate,
                             {.memory = memory - std::min(memory / 2, kProcess),
                              .beside = s.output,
                              .checkpoints = writer.checkpoints(),
                              .peers = ranks},
                             writer, &estimate, s.input);
  report(tool.report(), s.clip, estimate);
  warn(tool, s.input, s.clip, estimate);
  writer.commit();
  tool.report()["surfels"] = writer.surfels();
  tool.wrote(s.output, fmt::format("{} surfels", writer.surfels()));
}

/// Estimates a file that is larger than the memory, or whose blocks are kept for a later run or
/// shared with other processes, if that can be done; false if its points, or the part of them that
/// is asked for, have to fit.
bool estimate_larger(surfel::tool::Tool& tool, Settings& s, std::uint64_t memory,
                     surfel::Ranks* ranks) {
  if (s.resume || ranks) {
    const auto cloud = s.part.whole() ? surfel::CloudRanges::open(s.input) : nullptr;
    if (!cloud || cloud->size() == 0) {
      surfel::CloudReader(s.input, s.part.options()).first();  // Says why no file is read.
      surfel::throw_input(surfel::tool::shown_name(s.input),
                          std::string(ranks ? "several processes share" : "--resume keeps") +
                              " blocks of whole files that are read in parts; " +
                              surfel::range_advice(s.input));
    }
    estimate_in_blocks(tool, s, *cloud, cloud->read(0, 1), memory, ranks);
    return true;
  }
  if (!s.part.whole()) return false;
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(s.input, error);
  // A file of this size fits whatever it holds: a record has three coordinates at least.
  if (error || surfel::estimate_bytes(size / 12 + 1, 12) <= memory) return false;
  const auto cloud = surfel::CloudRanges::open(s.input);
  if (!cloud || cloud->size() == 0) return false;
  const surfel::SurfelCloud first = cloud->read(0, 1);
  if (surfel::estimate_bytes(cloud->size(), surfel::row_bytes(first)) <= memory) return false;
  estimate_in_blocks(tool, s, *cloud, first, memory, ranks);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-estimate",
                          "Makes surfels of raw points: normals, their side, splat sizes.");
  Settings settings;
  declare_options(tool.app(), settings);
  tool.everyday({"--output", "-k", "--orient", "--viewpoint", "--remove-outliers", "--voxel",
                 "--smooth", "--variance"},
                {"surfel-estimate scan.xyz -o scan.ply",
                 "surfel-estimate scan.pcd --orient viewpoint --viewpoint 0,0,2 -o scan.ply",
                 "surfel-estimate scan.ply -k auto --remove-outliers --voxel auto --smooth mls -o "
                 "smooth.ply"});
  tool.files().reads({"cloud"});
  tool.files().writes("--output", surfel::tool::Writes::kSurfels);
  tool.name_fields({{"neighbors", "--outlier-k"},
                    {"deviations", "--outlier-deviations"},
                    {"edge", "--voxel"},
                    {"spacings", "--smooth-radius"},
                    {"order", "--smooth-order"},
                    {"crease_angle", "--crease-angle"},
                    {"grow_in_noise", "--noise"}});
  return surfel::tool::run_ranks(tool, argc, argv, [&](surfel::Ranks* ranks) {
    check(tool.app(), settings);
    const std::uint64_t memory = surfel::memory_to_use(settings.memory);
    if (estimate_larger(tool, settings, memory, ranks)) return;
    surfel::tool::require_room(settings.input, settings.part.options(), memory,
                               [](std::size_t points, const surfel::SurfelCloud& first) {
                                 return surfel::estimate_bytes(points, surfel::row_bytes(first));
                               });
    estimate_in_memory(tool, settings);
  });
}
