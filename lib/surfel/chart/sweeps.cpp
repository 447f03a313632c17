#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/chart/sweeps.h>
#include <surfel/sample/mesh_sampler.h>

namespace surfel {
namespace {

constexpr bool kQuick = true;
/// Fewer surfels than this have no level of detail that a picture could use.
constexpr std::size_t kLeastForLevels = 2000;
/// More surfels than this take Ceres minutes.
constexpr std::size_t kMostForCeres = 30000;

/// Points of one option: value, label, and whether a quick run measures it.
struct Value {
  const char* value;
  bool quick = false;
};
std::vector<SweepPoint> values_of(const std::string& option, const std::vector<Value>& values) {
  std::vector<SweepPoint> points;
  for (const Value& v : values) {
    points.push_back({v.value, fmt::format("{} {}", option, v.value), v.quick});
  }
  return points;
}

Sweep cutoff(const SweepContext& c) {
  return {.name = "cutoff",
          .title = "Cutoff c at which kernels end",
          .about = c.outside_truth ? "Small cutoffs are fast, large ones smooth."
                                   : "The reference's kernels end at c = 4, so that what "
                                     "truncation does shows as an error.",
          .standard = "1",
          .truth = "surfel-render --cutoff 4",
          .points =
              values_of("surfel-render --cutoff",
                        {{"0.5", kQuick}, {"0.7"}, {"1.5"}, {"2", kQuick}, {"3"}, {"4", kQuick}})};
}

Sweep layers(const SweepContext& c) {
  Sweep sweep{
      .name = "layers",
      .title = "Fragments per pixel of the A-buffer",
      .about = "Surfaces behind one another that a pixel can tell apart.",
      .standard = "3",
      .points = values_of("surfel-render --layers",
                          {{"1", kQuick}, {"2", kQuick}, {"4"}, {"6"}, {"8", kQuick}, {"16"}})};
  if (c.transparent) sweep.points.push_back({"32", "surfel-render --layers 32", false});
  return sweep;
}

Sweep filter() {
  return {.name = "filter",
          .title = "Filter of the kernels",
          .about =
              "ewa-source filters in the surfels' planes, slowly; circular and none are there "
              "to compare with.",
          .standard = "ewa",
          .points = values_of("surfel-render --filter",
                              {{"circular", kQuick}, {"none", kQuick}, {"ewa-source", kQuick}})};
}

Sweep kernel() {
  return {.name = "kernel",
          .title = "Projection of the kernels",
          .about =
              "Affine about each surfel's centre, exact, or exact where affine may be off by "
              "more than the tolerance in pixels.",
          .standard = "auto, 0.1 px",
          .points = {{"affine", "surfel-render --kernel affine", kQuick},
                     {"exact", "surfel-render --kernel perspective", kQuick},
                     {"auto, 0.01 px", "surfel-render --kernel-tolerance 0.01"},
                     {"auto, 0.03 px", "surfel-render --kernel-tolerance 0.03"},
                     {"auto, 0.3 px", "surfel-render --kernel-tolerance 0.3"},
                     {"auto, 1 px", "surfel-render --kernel-tolerance 1"}}};
}

Sweep depth_epsilon() {
  return {.name = "depth-epsilon",
          .title = "Depth within which contributions are of one surface",
          .about = "In footprints of the splat.",
          .standard = "1",
          .points = values_of("surfel-render --depth-epsilon",
                              {{"0.25", kQuick}, {"0.5"}, {"0.7"}, {"1.4"}, {"2"}, {"4", kQuick}})};
}

Sweep sigma(const SweepContext& c) {
  Sweep sweep{.name = "sigma",
              .title = "Standard deviation of the kernels by the spacing",
              .about = "Narrow kernels are sharp and leave holes, wide ones blur and cost time.",
              .standard = fmt::format("{:g}", MeshSampleOptions::kVarianceScale),
              .points = values_of(
                  "surfel-from-mesh --variance-scale",
                  {{"0.5", kQuick}, {"0.6"}, {"0.85"}, {"1", kQuick}, {"1.2"}, {"1.5", kQuick}})};
  if (!c.mesh) sweep.needs = "a mesh to sample, as the kernels of given surfels are what they are";
  return sweep;
}

Sweep fit(const SweepContext& c) {
  const std::string render = fmt::format("surfel-texture --fit render --cutoff {:g}", c.cutoff);
  Sweep sweep{.name = "fit",
              .title = "Fit of the texture's coefficients",
              .about =
                  "ewa filters the texture, gram solves SS01 (11), render is least squares in "
                  "the renderer's own basis; with solver, tolerance and lambda. The cost is "
                  "that of the fit.",
              .standard = "ewa",
              .timed = Stage::kTexture,
              .base = "surfel-texture",
              .points = {{"gram", "surfel-texture --fit gram", kQuick},
                         {"gram, lambda 0.1", "surfel-texture --fit gram --lambda 0.1"},
                         {"render", render, kQuick},
                         {"render, tolerance 1e-2", render + " --tolerance 0.01"},
                         {"render, tolerance 1e-8", render + " --tolerance 1e-8"},
                         {"render, lambda 0.003", render + " --lambda 0.003"},
                         {"render, lambda 0.3", render + " --lambda 0.3", kQuick}}};
  if (c.surfels <= kMostForCeres) {
    sweep.points.push_back({"render, ceres", render + " --solver ceres"});
  }
  if (!c.texture) {
    sweep.needs = "a texture: a mesh with one, or `image`";
  } else if (!c.outside_truth) {
    sweep.needs = "another truth than the surfels' own coefficients: `truth` mesh, or a picture";
  }
  return sweep;
}

Sweep neighbours(const SweepContext& c) {
  Sweep sweep{.name = "neighbours",
              .title = "Neighbourhoods of surfel-estimate: k, and the search",
              .about = "The cost is that of the estimate.",
              .standard = "k = 16, exact",
              .timed = Stage::kEstimate,
              .base = "surfel-estimate",
              .points = {{"k = 6", "surfel-estimate -k 6", kQuick},
                         {"k = 8", "surfel-estimate -k 8"},
                         {"k = 12", "surfel-estimate -k 12"},
                         {"k = 24", "surfel-estimate -k 24", kQuick},
                         {"k = 32", "surfel-estimate -k 32"},
                         {"k auto", "surfel-estimate -k auto"},
                         {"k = 16, flann", "surfel-estimate --search flann", kQuick},
                         {"k = 16, approximate", "surfel-estimate --search flann-approx", kQuick}}};
  if (!c.outside_truth) {
    sweep.about +=
        " The reference is made of the input's own normals and sizes; where it is raw "
        "points, of the default's: then other settings show how far they are from the "
        "default, not which is right.";
  }
  return sweep;
}

Sweep groups(const SweepContext& c) {
  Sweep sweep{.name = "groups",
              .title = "Groups of surfels that do not overlap (SP06)",
              .about =
                  "Order of the colouring, overlap, number of groups K, coverage by every "
                  "group, Voronoi rasterisation. The cost is the picture's; the table has "
                  "that of the grouping.",
              .standard = "largest-first",
              .base = "surfel-group; surfel-render --method deferred",
              .points = {{"smallest-last", "surfel-group --order smallest-last"},
                         {"dsatur", "surfel-group --order dsatur", kQuick},
                         {"overlap 0.8", "surfel-group --overlap 0.8"},
                         {"overlap 0.6", "surfel-group --overlap 0.6", kQuick},
                         {"overlap 0.4", "surfel-group --overlap 0.4"},
                         {"K = 4", "surfel-group --groups 4"},
                         {"K = 8", "surfel-group --groups 8", kQuick},
                         {"K = 4, enlarge", "surfel-group --groups 4 --cover enlarge"},
                         {"Voronoi off", "surfel-render --voronoi off"},
                         {"Voronoi quantised", "surfel-render --voronoi quantised", kQuick}}};
  if (!c.transparent) return sweep;
  sweep.base =
      "surfel-group --groups 4 --cover enlarge-each; surfel-render --method "
      "transparent-high";
  sweep.standard = "K = 4, enlarge each";
  sweep.points = {{"K = 2", "surfel-group --groups 2", kQuick},
                  {"K = 8", "surfel-group --groups 8"},
                  {"enlarge", "surfel-group --cover enlarge", kQuick},
                  {"duplicate", "surfel-group --cover duplicate"},
                  {"not covered", "surfel-group --cover none", kQuick},
                  {"largest-first", "surfel-group --groups 0"},
                  {"smallest-last", "surfel-group --groups 0 --order smallest-last"},
                  {"dsatur", "surfel-group --groups 0 --order dsatur"},
                  {"overlap 0.6", "surfel-group --groups 0 --overlap 0.6"},
                  {"layers by group", "surfel-render --layers-by group"},
                  {"layers by group, Voronoi off", "surfel-render --layers-by group --voronoi off"},
                  {"layers by group, Voronoi quantised",
                   "surfel-render --layers-by group --voronoi quantised"}};
  return sweep;
}

Sweep method(const SweepContext& c) {
  const std::string covered = "surfel-group --groups 4 --cover enlarge-each; surfel-render ";
  Sweep sweep{.name = "method",
              .title = "What becomes of the splats of a pixel",
              .about = "The A-buffer, SP06's methods with groups, and its baselines.",
              .standard = "A-buffer",
              .points = {{"transparent", covered + "--method transparent", kQuick},
                         {"transparent-high", covered + "--method transparent-high", kQuick},
                         {"depth-peel", "surfel-render --method depth-peel", kQuick}}};
  if (c.transparent) {
    sweep.points.push_back({"A-buffer, 8 layers", "surfel-render --layers 8", kQuick});
    sweep.points.push_back({"A-buffer, 16 layers", "surfel-render --layers 16"});
    sweep.points.push_back({"depth-peel, 16", "surfel-render --method depth-peel --peel 16"});
  } else {
    sweep.points.push_back({"deferred", "surfel-group; surfel-render --method deferred", kQuick});
    sweep.points.push_back({"two-pass", "surfel-render --method two-pass"});
  }
  return sweep;
}

Sweep lod(const SweepContext& c) {
  Sweep sweep{.name = "lod",
              .title = "Level of detail: piece of surface that one surfel may stand for",
              .about = "In pixels.",
              .standard = "1.4 px",
              .base = "surfel-lod",
              .points = {{"off", "surfel-render --lod off", kQuick},
                         {"0.7 px", "surfel-render --lod-error 0.7"},
                         {"1 px", "surfel-render --lod-error 1"},
                         {"2 px", "surfel-render --lod-error 2", kQuick},
                         {"4 px", "surfel-render --lod-error 4"},
                         {"8 px", "surfel-render --lod-error 8", kQuick}}};
  if (c.surfels < kLeastForLevels) {
    sweep.needs = fmt::format("{} surfels at least; there are {}", kLeastForLevels, c.surfels);
  }
  return sweep;
}

SweepPoint count_point(const SweepContext& c, double factor, bool quick) {
  const auto count = std::max(1LL, std::llround(static_cast<double>(c.surfels) * factor));
  return {fmt::format("{}", count), fmt::format("surfel-from-mesh --count {}", count), quick};
}

Sweep spacing(const SweepContext& c) {
  Sweep sweep{.name = "spacing",
              .title = "Number of surfels",
              .about = "That many samples of the mesh.",
              .standard = fmt::format("{}", c.surfels)};
  for (const auto& [factor, quick] : {std::pair{1.0 / 16, false},
                                      {1.0 / 8, false},
                                      {1.0 / 4, true},
                                      {1.0 / 2, false},
                                      {2.0, true},
                                      {4.0, false}}) {
    sweep.points.push_back(count_point(c, factor, quick));
  }
  if (!c.mesh) sweep.needs = "a mesh to sample; this input is surfels or points";
  return sweep;
}

Sweep threads(const SweepContext& c) {
  Sweep sweep{.name = "threads",
              .title = "Threads",
              .about = "The picture is the same for any number of them.",
              .standard = fmt::format("{}, one a core", c.cores)};
  for (int n = 1; n < c.cores; n *= 2) {
    sweep.points.push_back(
        {fmt::format("{}", n), fmt::format("surfel-render --threads {}", n), kQuick});
  }
  if (c.cores < 2) sweep.needs = "a machine with two cores at least";
  return sweep;
}

}  // namespace

std::vector<Sweep> all_sweeps(const SweepContext& c) {
  return {cutoff(c),     layers(c), filter(),  kernel(), depth_epsilon(), sigma(c),  fit(c),
          neighbours(c), groups(c), method(c), lod(c),   spacing(c),      threads(c)};
}

void require_known_sweeps(const std::vector<std::string>& names) {
  std::vector<std::string> known;
  for (const Sweep& sweep : all_sweeps({})) known.push_back(sweep.name);
  for (const std::string& name : names) {
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      throw_usage(fmt::format("`sweeps`: '{}' is not one of {}{}", name, fmt::join(known, ", "),
                              did_you_mean(name, known)));
    }
  }
}

std::vector<Sweep> choose_sweeps(const std::vector<std::string>& names,
                                 const SweepContext& context) {
  require_known_sweeps(names);
  std::vector<Sweep> all = all_sweeps(context);
  for (const std::string& name : names) {
    const auto found = std::find_if(all.begin(), all.end(),
                                    [&](const Sweep& sweep) { return sweep.name == name; });
    if (!found->needs.empty()) {
      throw_usage(fmt::format("`sweeps` has {}, which needs {}", name, found->needs));
    }
  }
  std::erase_if(all, [&](const Sweep& sweep) {
    return !sweep.needs.empty() ||
           (!names.empty() && std::find(names.begin(), names.end(), sweep.name) == names.end());
  });
  return all;
}

std::vector<SweepPoint> recommendation_candidates(const SweepContext& c) {
  // These trade time for accuracy: the number of surfels, the fit, the cutoff of kernels, and the
  // layers where surfaces are see-through.
  std::vector<SweepPoint> sources;
  if (c.mesh) {
    for (const auto& [factor, quick] :
         {std::pair{1.0 / 16, false}, {1.0 / 4, true}, {1.0, true}, {4.0, false}}) {
      sources.push_back(count_point(c, factor, quick));
    }
  } else {
    sources.push_back({"", "", kQuick});
    if (c.surfels >= kLeastForLevels) {
      for (const auto& [error, quick] : {std::pair{"1.4", true}, {"3", false}}) {
        sources.push_back({fmt::format("levels of {} px", error),
                           fmt::format("surfel-lod; surfel-render --lod-error {}", error), quick});
      }
    }
  }
  std::vector<SweepPoint> all;
  for (const SweepPoint& source : sources) {
    for (const auto& [cutoff, often] : {std::pair{1, true}, {2, true}, {4, false}}) {
      for (const bool fitted : {false, true}) {
        if (fitted && !(c.texture && c.outside_truth)) continue;
        for (const int layers : {3, 16}) {
          if (layers != 3 && !c.transparent) continue;
          SweepPoint p{source.label, source.changes, source.quick && often};
          p.label += fmt::format("{}cutoff {}{}{}", p.label.empty() ? "" : ", ", cutoff,
                                 fitted ? ", render fit" : "",
                                 layers == 3 ? "" : fmt::format(", {} layers", layers));
          p.changes += fmt::format("; surfel-render --cutoff {} --layers {}", cutoff, layers);
          if (fitted) {
            p.changes += fmt::format("; surfel-texture --fit render --cutoff {}", cutoff);
          }
          all.push_back(std::move(p));
        }
      }
    }
  }
  return all;
}

}  // namespace surfel
