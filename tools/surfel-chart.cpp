// surfel-chart: speed against accuracy of the tools' settings, on the user's own data.

#include <filesystem>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/progress.h>
#include <surfel/base/shell_quote.h>
#include <surfel/chart/chart_report.h>
#include <surfel/chart/chart_runner.h>
#include <surfel/chart/plot.h>
#include <surfel/chart/sweeps.h>

#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace {

namespace fs = std::filesystem;
using surfel::tool::Tool;

/// File of the work folder by which a run is taken up.
constexpr const char* kJournal = "journal.jsonl";

struct Settings {
  std::string output;
  std::string sweeps;
  bool recommend = false;
  surfel::ChartGoal goal;
  surfel::ChartOptions chart;
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  using namespace surfel::tool;
  surfel::ChartOptions& c = s.chart;
  app.add_option("input", c.input,
                 "Surfels or points (PLY, PCD, LAS, LAZ, E57), or a mesh to sample (OBJ, PLY, STL, "
                 "OFF, glTF)")
      ->required();
  app.add_option("-o,--output", s.output,
                 "Folder for report.html, report.csv and report.json; an interrupted run is taken "
                 "up from what lies there");
  app.add_option("--sweep", s.sweeps,
                 "Settings to vary, parted by commas: cutoff, layers, filter, kernel, "
                 "depth-epsilon, sigma, fit, neighbours, groups, method, lod, spacing, "
                 "threads; default: all that make sense for the input");
  app.add_flag("--quick", c.quick,
               "Few points, pictures of 256x256, 3 repeats, 4 frames, 4 rays, 20000 samples, "
               "unless given");

  app.group("Input");
  app.add_option("--image", c.image, "Texture of the mesh; default: its materials' own");
  app.add_option("--mesh", c.mesh, "Of surfels: the mesh that they stand for, for --truth mesh");
  app.add_option("--count", c.count, "Samples of a mesh");
  app.add_option("--scene", c.scene, "Lights, materials, environment (TOML)");
  app.add_option("--with", c.with,
                 "Options of a tool for all points, such as \"surfel-estimate --orient align\"; "
                 "may be given again for another tool")
      ->expected(1)
      ->take_all();

  app.group("Truth and measures");
  app.add_option("--truth", c.truth,
                 "reference (the surfels, ray cast), mesh (ray traced), or a picture of the "
                 "camera's view; default: the mesh where there is one, else the reference");
  app.add_option("--samples", c.samples, "Rays along each side of the truth's pixels, 1..64");
  app.add_option("--repeats", c.repeats, "Runs of which the median time counts, 1..1000");
  app.add_option("--frames", c.frames,
                 "Frames of a turn by 0.25 degrees each, for flicker, 2..1000; 0 = none");

  app.group("Camera");
  c.camera.width = c.camera.height = 400;
  add_view(app, c.camera, c.view);

  app.group("Recommendation");
  app.add_flag("--recommend", s.recommend,
               "Print the commands of the cheapest setting that meets a goal, run and found to "
               "meet it, instead of a report");
  surfel::tool::Option* error = app.add_option(
      "--max-error", s.goal.min_psnr, "The goal: an error no larger than this PSNR stands for, dB");
  app.add_option("--max-time", s.goal.max_time,
                 "The goal: a picture in this time, without reading and writing, ms, > 0")
      ->excludes(error);
  app.group("Options");
}

/// Changes options for --quick, unless they are given.
void make_quick(const surfel::tool::CommandLine& app, surfel::ChartOptions& c) {
  const auto unless_given = [&](const char* option, auto& value, auto quick) {
    if (app.get_option(option)->count() == 0) value = quick;
  };
  unless_given("--repeats", c.repeats, 3);
  unless_given("--frames", c.frames, 4);
  unless_given("--samples", c.samples, 4);
  unless_given("--count", c.count, std::size_t{20000});
  unless_given("--size", c.camera.width, 256);
  unless_given("--size", c.camera.height, 256);
}

void check(const Settings& s) {
  std::vector<std::string> problems = s.chart.problems();
  const bool goal = s.goal.min_psnr || s.goal.max_time;
  if (s.recommend != goal) {
    problems.emplace_back("--recommend needs --max-error or --max-time, and they need it");
  } else if (goal) {
    surfel::tool::append(problems, s.goal.problems());
  }
  if (s.recommend && !s.sweeps.empty()) {
    problems.emplace_back("--recommend has settings of its own; leave out --sweep");
  }
  if (!s.recommend && s.output.empty()) problems.emplace_back("give a folder for the report: -o");
  surfel::tool::require_valid(problems);
}

/// The folder where a run works: beside the report, to be found again, or a temporary one.
class WorkFolder {
 public:
  explicit WorkFolder(const std::string& output) : temporary_(output.empty()) {
    std::string pattern = (fs::temp_directory_path() / "surfel-chart-XXXXXX").string();
    path_ = temporary_ ? pattern : (fs::path(output) / "work").string();
    std::error_code error;
    if (temporary_ && !mkdtemp(pattern.data())) surfel::throw_io(pattern, "cannot be made");
    if (temporary_) path_ = pattern;
    resumed_ = fs::exists(path_, error);
    // It is removed in the end, with all that is in it.
    if (!temporary_ && resumed_ && !fs::exists(fs::path(path_) / kJournal, error) &&
        !fs::is_empty(path_, error)) {
      surfel::throw_usage(path_ +
                          ": is there already and is no interrupted run's; give --output another "
                          "folder");
    }
    made_outer_ = !temporary_ && !fs::exists(output, error);
    if (!temporary_) fs::create_directories(path_, error);
    if (error) surfel::throw_io(output, "cannot be made a folder: " + error.message());
  }
  ~WorkFolder() {
    if (temporary_) remove();
  }
  /// Runs a function that works in the folder. Where wrong usage ends it, or an error before there
  /// is anything that a later run could take up, a folder that this object made is removed.
  template <class Function>
  auto run(const Function& function) const {
    try {
      return function();
    } catch (const surfel::Error& error) {
      std::error_code ignored;
      const bool useless = error.kind() == surfel::ErrorKind::kUsage ||
                           !fs::exists(fs::path(path_) / kJournal, ignored);
      if (useless && !resumed_) {
        remove();
        if (made_outer_) fs::remove(fs::path(path_).parent_path(), ignored);
      }
      throw;
    }
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const std::string& path() const { return path_; }
  void remove() const {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }

 private:
  bool temporary_;
  bool resumed_ = false;  ///< The folder is an earlier run's, which may go on.
  bool made_outer_ = false;
  std::string path_;
};

void make_report(Tool& tool, const Settings& s, const std::string& command) {
  surfel::require_gnuplot();
  for (const char* file : {"report.html", "report.csv", "report.json"}) {
    const fs::path path = fs::path(s.output) / file;
    tool.files().write_also("--output", path.string());
    if (tool.common().no_clobber && fs::exists(path)) {
      surfel::throw_io(path.string(),
                       "exists already and --no-clobber is set; name another folder");
    }
  }
  surfel::require_known_sweeps(s.chart.sweeps);
  const WorkFolder work(s.output);
  surfel::ChartOptions options = s.chart;
  options.folder = work.path();
  const surfel::ChartReport report = work.run([&] { return surfel::ChartRunner(options).run(); });
  surfel::write_report(report, command, work.path(), s.output, tool.common().no_clobber);
  work.remove();
  tool.report()["chart"] = surfel::tool::Json::parse(surfel::report_json(report));
  for (const surfel::ChartSweep& sweep : report.sweeps) {
    if (sweep.standard_off) tool.note(sweep.name + ": " + sweep.verdict);
  }
  tool.wrote((fs::path(s.output) / "report.html").string(),
             fmt::format("{} sweeps", report.sweeps.size()));
}

void recommend(Tool& tool, const Settings& s) {
  const WorkFolder work(s.output);
  surfel::ChartOptions options = s.chart;
  options.folder = work.path();
  options.frames = 0;
  const surfel::Recommendation found =
      work.run([&] { return surfel::ChartRunner(options).recommend(s.goal); });
  const surfel::ChartPoint& p = found.point;
  surfel::tool::print(fmt::format("{}\n", fmt::join(p.commands, " && ")));
  tool.report()["recommend"] = {
      {"setting", p.label},           {"commands", p.commands},          {"psnr", p.error.psnr},
      {"render_ms", p.render.median}, {"render_most_ms", p.render.most}, {"tried", found.tried}};
  tool.note(fmt::format("\"{}\" run again: PSNR {:.2f} dB, {:.3g} ms a picture (at most {:.3g})",
                        p.label, p.error.psnr, p.render.median, p.render.most));
}

}  // namespace

int main(int argc, char** argv) {
  Tool tool("surfel-chart",
            "Charts speed against accuracy of the tools' settings on your own data, and recommends "
            "one.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--quick", "--sweep", "--recommend", "--max-error", "--max-time",
                 "--image", "--truth", "--count", "--size"},
                {"surfel-chart lion.obj --quick -o report",
                 "surfel-chart lion.ply --sweep cutoff,layers -o report",
                 "surfel-chart lion.obj --quick --recommend --max-error 35"});
  tool.reads_images();
  tool.reads_named_files();
  tool.files().reads({"input", "--image", "--mesh", "--scene", "--truth"});
  tool.files().writes("--output", surfel::tool::Writes::kAny);
  tool.name_fields({{"sweeps", "--sweep"}, {"min_psnr", "--max-error"}});
  return tool.run(argc, argv, [&] {
    check(s);
    if (s.chart.quick) make_quick(tool.app(), s.chart);
    if (!s.sweeps.empty()) s.chart.sweeps = surfel::tool::split(s.sweeps, ',');
    s.chart.tools = fs::read_symlink("/proc/self/exe").parent_path().string();
    // What is measured changes its name with every point.
    std::optional<surfel::ProgressStage> stage;
    s.chart.progress = [&](const std::string& what, double share) {
      if (!stage || stage->name() != what) stage.emplace(what, 100, "%");
      stage->set_share(share);
    };
    if (s.recommend) {
      recommend(tool, s);
    } else {
      std::vector<std::string> words(argv, argv + argc);
      words[0] = "surfel-chart";
      make_report(tool, s, surfel::shell_command(words));
    }
  });
}
