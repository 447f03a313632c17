#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/shell_quote.h>
#include <surfel/base/timing.h>
#include <surfel/base/version.h>
#include <surfel/chart/chart_runner.h>
#include <surfel/chart/journal.h>
#include <surfel/chart/sweeps.h>
#include <surfel/chart/tool_chain.h>
#include <surfel/chart/tool_run.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/scene_file.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/store/render_cloud.h>
#include <surfel/truth/flicker.h>

namespace surfel {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Words = std::vector<std::string>;

/// Step of the turn along which flicker is measured: the frames of a slow turn differ little.
constexpr double kTurnDegrees = 0.25;

TimeSpread spread_of(std::vector<double> times) {
  std::sort(times.begin(), times.end());
  const std::size_t n = times.size();
  return {(times[(n - 1) / 2] + times[n / 2]) / 2, times.front(), times.back()};
}

std::string numbers(const Vec3d& v) {
  return fmt::format("{:.12g},{:.12g},{:.12g}", v.x(), v.y(), v.z());
}

/// Name, size and time of a file: entries of a journal hold while they stay.
std::string identity(const std::string& path) {
  if (path.empty()) return "-";
  std::error_code error;
  const auto size = fs::file_size(path, error);
  const auto time = fs::last_write_time(path, error).time_since_epoch().count();
  return fmt::format("{} {} {}", path, error ? 0 : size, error ? 0 : time);
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown processor";
}

/// Options of surfel-render that its --reference and --mesh heed, too.
std::vector<ToolOption> truth_options(const ToolChain& chain, bool reference) {
  static const std::set<std::string> kBoth = {"--scene",      "--shading", "--lowpass",
                                              "--background", "--cull",    "--refraction"};
  static const std::set<std::string> kReference = {"--cutoff", "--depth-epsilon",
                                                   "--coverage-threshold"};
  static const std::set<std::string> kMesh = {"--relief"};
  std::vector<ToolOption> kept;
  for (const ToolOption& option : chain.options(Stage::kRender)) {
    if (kBoth.count(option.name) > 0 || (reference ? kReference : kMesh).count(option.name) > 0) {
      kept.push_back(option);
    }
  }
  return kept;
}

Words operator+(Words a, const Words& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

}  // namespace

std::vector<std::string> ChartOptions::problems() const {
  std::vector<std::string> problems = camera.problems();
  check_option(problems, count >= 1, "count", count, "at least 1");
  check_option(problems, repeats >= 1 && repeats <= 1000, "repeats", repeats, "in 1..1000");
  check_option(problems, frames == 0 || (frames >= 2 && frames <= 1000), "frames", frames,
               "0 or in 2..1000");
  check_option(problems, samples >= 1 && samples <= 64, "samples", samples, "in 1..64");
  return problems;
}

struct ChartRunner::Impl {
  explicit Impl(ChartOptions given);

  ChartOptions options;
  std::unique_ptr<Journal> journal;
  std::optional<ToolRunner> tools;  ///< Refers to the journal.
  ToolChain user;                   ///< The options that were asked for.
  ToolChain base;                   ///< All tools from the input to a picture, with these options.
  SweepContext context;
  Words camera;
  std::string path_toml;
  std::vector<std::pair<std::string, std::string>> summary;
  Words truth_commands;

  /// A truth's picture, and its frames along the path (empty without).
  struct Truth {
    std::string file;
    Image image;
    std::vector<Image> frames;
  };
  std::map<std::string, Truth> truths;
  std::vector<Image> standard_frames;  ///< Frames of the base chain, where the truth has none.

  Timer timer;
  double runs_done = 0;
  double runs_expected = 1;

  std::string path(const std::string& file) const { return options.folder + "/" + file; }
  bool mesh_truth() const { return options.truth == "mesh"; }
  bool file_truth() const { return options.truth != "mesh" && options.truth != "reference"; }

  void describe(const std::string& key, const std::string& value) {
    summary.emplace_back(key, value);
  }
  void look_at_input(FileKind kind);
  void choose_truth(bool with_mesh);
  void make_base();
  void open_journal();
  void look_at_surfels();
  void describe_measures();
  void aim(const SurfelCloud& cloud);
  void write_path(const Camera& view, const Vec3d& target);

  void prepare(const ToolChain& chain);
  std::string prepared(const ToolChain& chain) const;
  const Truth& truth_of(const Sweep& sweep);
  std::vector<Image> path_frames(const Words& words, const std::string& name,
                                 const std::string& extension);
  Words render_words(const ToolChain& chain, const std::string& output) const;
  ToolChain chain_of(const Sweep& sweep, const SweepPoint* point) const;
  void complete(ToolChain& chain) const;
  std::vector<std::pair<ToolChain, ChartPoint>> points_of(const Sweep& sweep) const;
  std::optional<double> flicker_of(const ToolChain& chain, const std::string& name,
                                   const Truth& truth);
  void measure(const Sweep& sweep, std::vector<std::pair<ToolChain, ChartPoint>>& points,
               const std::string& what, bool with_flicker, int first_repeat);
  ChartSweep run_sweep(const Sweep& sweep);
  void expect(const std::vector<Sweep>& sweeps);
  void step(const std::string& what);
};

ChartRunner::Impl::Impl(ChartOptions given) : options(std::move(given)) {
  std::vector<std::string> problems = options.problems();
  if (!problems.empty()) throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
  // Before names are made absolute, so that messages have them as they were given.
  const FileKind kind = file_kind(options.input);
  if (kind == FileKind::kImage) {
    throw_input(options.input, "is a picture; give surfels, points or a mesh");
  }
  if (kind == FileKind::kGaussians) refuse_gaussians(options.input);
  if (kind == FileKind::kVolume) refuse_volume(options.input);
  // The tools run in another folder. A name that is no file's may be a procedural texture's.
  for (std::string* file :
       {&options.input, &options.image, &options.mesh, &options.scene, &options.folder}) {
    if (fs::exists(*file)) *file = fs::absolute(*file).lexically_normal().string();
  }
  look_at_input(kind);
}

/// The kind of the input decides on the tools that lead to a picture.
void ChartRunner::Impl::look_at_input(FileKind kind) {
  for (const std::string& changes : options.with) user.apply(changes);
  if (user.value(Stage::kSample, "--spacing")) {
    throw_usage("surfel-from-mesh --spacing: give the number of samples as `count` instead");
  }
  context.mesh = kind == FileKind::kMesh;
  if (context.mesh && !options.mesh.empty()) {
    throw_usage("`mesh` is for surfels, and the input is a mesh");
  }
  std::optional<TriangleMesh> mesh;
  const std::string& mesh_file = context.mesh ? options.input : options.mesh;
  if (!mesh_file.empty()) mesh = read_mesh(mesh_file);
  choose_truth(mesh.has_value());
  const bool named = mesh && std::any_of(mesh->material.begin(), mesh->material.end(),
                                         [](const auto& m) { return !m.texture.empty(); });
  context.texture = named || !options.image.empty();

  describe("Input", options.input);
  if (context.mesh) {
    describe("Mesh", fmt::format("{} vertices, {} faces{}", mesh->position.size(),
                                 mesh->face.size(), context.texture ? ", textured" : ""));
  }
  make_base();
  open_journal();
  look_at_surfels();
  describe_measures();
}

void ChartRunner::Impl::choose_truth(bool with_mesh) {
  if (options.truth.empty()) options.truth = with_mesh ? "mesh" : "reference";
  if (mesh_truth() && !with_mesh) {
    throw_usage("`truth` is mesh, but there is none; name it as `mesh`");
  }
  if (file_truth()) {
    options.truth = fs::absolute(options.truth).lexically_normal().string();
    if (!fs::exists(options.truth)) {
      throw_usage(options.truth +
                  ": `truth` is reference, mesh, or a picture that is there; this is none");
    }
  }
  context.outside_truth = options.truth != "reference";
}

/// The tools that all points run, with their options.
void ChartRunner::Impl::make_base() {
  if (context.mesh) base.run(Stage::kSample);
  if (context.mesh && context.texture) base.run(Stage::kTexture);
  base.run(Stage::kRender);
  if (!options.scene.empty()) base.set(Stage::kRender, {"--scene", options.scene});
  if (!context.mesh) {
    const SurfelCloud cloud = read_cloud(options.input, {.levels = true});
    if (cloud.empty()) throw_input(options.input, "holds no surfel");
    if (cloud.normal.empty() || !has_variance(cloud)) {
      base.run(Stage::kEstimate);
    }
  }
  for (const std::string& changes : options.with) base.apply(changes);
  complete(base);
  context.cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  if (const std::string* cutoff = base.value(Stage::kRender, "--cutoff")) {
    // A value that is no number stays for surfel-render to refuse.
    std::from_chars(cutoff->data(), cutoff->data() + cutoff->size(), context.cutoff);
  }
}

void ChartRunner::Impl::open_journal() {
  const std::string run = fmt::format(
      "surfel-chart {} {} {} {} {} {}", version(), identity(options.input), identity(options.image),
      identity(options.mesh), identity(options.scene), identity(options.tools + "/surfel-render"));
  journal = std::make_unique<Journal>(path("journal.jsonl"), run);
  tools.emplace(options.tools, options.folder, *journal);
}

/// Makes the surfels of the base chain, and aims at them.
void ChartRunner::Impl::look_at_surfels() {
  prepare(base);
  const std::string surfels = prepared(base);
  const SurfelCloud cloud =
      read_cloud(fs::path(surfels).is_absolute() ? surfels : path(surfels), {.levels = true});
  aim(cloud);
  context.surfels = cloud.size();
  describe("Surfels",
           fmt::format("{}{}{}{}", cloud.size(), cloud.anisotropic() ? ", elliptical" : ", round",
                       cloud.tree.empty() ? "" : ", with levels of detail",
                       context.transparent ? ", transparent" : ""));
}

/// Tells in the summary how errors and times are measured.
void ChartRunner::Impl::describe_measures() {
  if (!options.with.empty()) {
    describe("Options for all points", fmt::format("{}", fmt::join(options.with, "; ")));
  }
  describe("Pictures",
           fmt::format("{} x {} pixels, 8 bits: errors below an RMSE of {:.4f} are those "
                       "of rounding",
                       options.camera.width, options.camera.height, kRoundingError));
  describe("Truth", mesh_truth() ? fmt::format("the mesh, ray traced with {0} x {0} rays a "
                                               "pixel and filtered by the same Gaussian",
                                               options.samples)
                    : file_truth()
                        ? options.truth
                        : fmt::format("the surfels, ray cast with {0} x {0} rays a pixel "
                                      "(surfel-render --reference)",
                                      options.samples));
  describe("Times", fmt::format("medians of {} runs of the whole tool, in turn with those of the "
                                "sweep's other points; reading and writing are not counted",
                                options.repeats));
  if (options.frames > 0) {
    describe("Flicker",
             fmt::format("{} frames of a turn by {} degrees each: root of the mean square of what "
                         "changes from frame to frame less what changes in {}, of full scale",
                         options.frames, kTurnDegrees,
                         file_truth() ? "the pictures of the default" : "the truth"));
  }
  describe("Machine",
           fmt::format("{}, {} cores, {} threads", processor(), context.cores, thread_count()));
}

/// Makes the camera that sees the base surfels the camera of all points, in numbers.
void ChartRunner::Impl::aim(const SurfelCloud& cloud) {
  const RenderCloud surfels(cloud);
  context.transparent = surfels.transparent();
  if (!options.scene.empty()) {
    for (const Material& m : read_scene(options.scene).materials) {
      context.transparent = context.transparent || m.opacity < 1 || m.ior > 0;
    }
  }
  if (options.view.needs_guess(options.camera)) {
    const std::optional<Vec3d>& up = options.camera.up ? options.camera.up : cloud.up;
    aim_camera(options.camera, options.view,
               guess_view(sample_surface(cloud), {.up = up, .viewpoint = cloud.viewpoint}));
  }
  const SceneExtent extent = surfels.extent();
  const Camera view = make_camera(options.camera, extent);
  const Vec3d target = view_target(options.camera, extent);
  camera = {"--eye=" + numbers(view.eye), "--target=" + numbers(target),
            "--up=" + numbers(options.camera.up_or_y()), "--size",
            fmt::format("{}x{}", view.width, view.height)};
  const auto add = [&](const char* option, double value) {
    camera = camera + Words{option, fmt::format("{:.12g}", value)};
  };
  if (view.orthographic) {
    add("--ortho", view.height / view.focal_y * options.camera.zoom);
  } else {
    add("--fov", options.camera.fov);
  }
  if (options.camera.zoom != 1) add("--zoom", options.camera.zoom);
  if (options.camera.near > 0) add("--near", options.camera.near);
  if (options.frames > 0) write_path(view, target);
}

void ChartRunner::Impl::write_path(const Camera& view, const Vec3d& target) {
  CameraOptions start = options.camera;
  start.eye = view.eye;
  start.from.reset();
  start.target = target;
  start.frame_all = false;
  const auto circle = static_cast<int>(std::lround(360 / kTurnDegrees));
  const std::vector<Camera> views = turntable(start, SceneExtent{}, circle);
  for (int i = 0; i < options.frames; ++i) {
    const Vec3d& eye = views[static_cast<std::size_t>(i) % views.size()].eye;
    path_toml +=
        fmt::format("[[camera]]\neye = [{:.12g}, {:.12g}, {:.12g}]\n", eye.x(), eye.y(), eye.z());
  }
  OutputFile file(path("path.toml"));
  file.write(path_toml);
  file.commit();
}

void ChartRunner::Impl::step(const std::string& what) {
  runs_done += 1;
  const double share = std::min(1.0, runs_done / runs_expected);
  const double left = timer.milliseconds() / 1000 * (1 - share) / share;
  options.progress(fmt::format("{}, {}:{:02} left", what, static_cast<int>(left) / 60,
                               static_cast<int>(left) % 60),
                   share);
}

void ChartRunner::Impl::prepare(const ToolChain& chain) {
  for (const ChainCommand& c : preparing_commands(chain, options.input)) {
    tools->run(c.words, c.output, "").require_success();
  }
}

/// The surfels that a chain renders.
std::string ChartRunner::Impl::prepared(const ToolChain& chain) const {
  const auto commands = preparing_commands(chain, options.input);
  return commands.empty() ? options.input : commands.back().output;
}

Words ChartRunner::Impl::render_words(const ToolChain& chain, const std::string& output) const {
  return Words{tool_name(Stage::kRender), prepared(chain)} +
         words_of(chain.options(Stage::kRender)) + camera + Words{"-o", output};
}

/// Renders the path and reads its frames.
std::vector<Image> ChartRunner::Impl::path_frames(const Words& words, const std::string& name,
                                                  const std::string& extension) {
  const std::string pattern = name + "-%d" + extension;
  const auto file = [&](int i) { return fmt::format("{}-{}{}", name, i, extension); };
  tools
      ->run(words + camera + Words{"--camera", "path.toml", "-o", pattern},
            file(options.frames - 1), "")
      .require_success();
  std::vector<Image> frames;
  for (int i = 0; i < options.frames; ++i)
    frames.push_back(read_premultiplied_image(path(file(i))));
  return frames;
}

const ChartRunner::Impl::Truth& ChartRunner::Impl::truth_of(const Sweep& sweep) {
  const bool own = options.truth == "reference" && !sweep.truth.empty();
  const auto [place, is_new] = truths.try_emplace(own ? sweep.truth : "");
  Truth& truth = place->second;
  if (!is_new) return truth;
  options.progress("the truth", std::min(1.0, runs_done / runs_expected));
  if (file_truth()) {
    truth.file = options.truth;
    truth.image = read_premultiplied_image(truth.file);
    return truth;
  }
  ToolChain chain = base;
  if (own) chain.apply(sweep.truth);
  Words words{tool_name(Stage::kRender)};
  if (mesh_truth()) {
    words = words + Words{"--mesh", context.mesh ? options.input : options.mesh};
    if (!options.image.empty()) words = words + Words{"--image", options.image};
    words = words + words_of(truth_options(chain, false));
  } else {
    words = words + Words{prepared(base), "--reference"} + words_of(truth_options(chain, true));
  }
  words = words + Words{"--samples", std::to_string(options.samples)};
  const std::string name = "truth-" + text_hash(shell_command(words)).substr(0, 8);
  const Words picture = words + camera + Words{"-o", name + ".exr"};
  tools->run(picture, name + ".exr", "").require_success();
  truth_commands.push_back(shell_command(picture));
  truth.file = path(name + ".exr");
  truth.image = read_premultiplied_image(truth.file);
  if (options.frames > 0) truth.frames = path_frames(words, name, ".exr");
  return truth;
}

ToolChain ChartRunner::Impl::chain_of(const Sweep& sweep, const SweepPoint* point) const {
  ToolChain chain = base;
  // A point is its own setting: options of the sweep that the user gave are for the default alone.
  if (point) {
    for (const SweepPoint& p : sweep.points) chain.remove_options(p.changes);
  }
  chain.apply(sweep.base);
  if (point) chain.apply(point->changes);
  complete(chain);
  return chain;
}

/// Adds the facts about the files that the tools need.
void ChartRunner::Impl::complete(ToolChain& chain) const {
  if (context.mesh && !chain.value(Stage::kSample, "--count")) {
    chain.set(Stage::kSample, {"--count", std::to_string(options.count)});
  }
  if (!chain.runs(Stage::kTexture)) return;
  const std::string& mesh = context.mesh ? options.input : options.mesh;
  if (!mesh.empty()) chain.set(Stage::kTexture, {"--mesh", mesh});
  if (!options.image.empty()) chain.set(Stage::kTexture, {"--image", options.image});
}

std::vector<std::pair<ToolChain, ChartPoint>> ChartRunner::Impl::points_of(
    const Sweep& sweep) const {
  std::vector<std::pair<ToolChain, ChartPoint>> points(1);
  points[0].first = chain_of(sweep, nullptr);
  points[0].second.standard = true;
  points[0].second.label = sweep.standard;
  ToolChain without = user;
  for (const SweepPoint& p : sweep.points) without.remove_options(p.changes);
  if (!(without == user)) points[0].second.label = "as given";
  for (const SweepPoint& p : sweep.points) {
    if (options.quick && !p.quick) continue;
    ToolChain chain = chain_of(sweep, &p);
    const bool known = std::any_of(points.begin(), points.end(),
                                   [&](const auto& other) { return other.first == chain; });
    if (known) continue;
    points.emplace_back(std::move(chain), ChartPoint{});
    points.back().second.label = p.label;
  }
  return points;
}

std::optional<double> ChartRunner::Impl::flicker_of(const ToolChain& chain, const std::string& name,
                                                    const Truth& truth) {
  if (options.frames == 0) return std::nullopt;
  const auto frames_of = [&](const ToolChain& c, const std::string& stem) {
    return path_frames(
        Words{tool_name(Stage::kRender), prepared(c)} + words_of(c.options(Stage::kRender)), stem,
        ".png");
  };
  const std::string key =
      fmt::format("flicker of {} along {} beside {}", shell_command(render_words(chain, name)),
                  text_hash(path_toml), truth.file);
  if (const std::string* known = journal->find(key)) return Json::parse(*known).get<double>();
  if (truth.frames.empty() && standard_frames.empty()) {
    standard_frames = frames_of(base, "standard");
  }
  const double found =
      flicker(frames_of(chain, name), truth.frames.empty() ? standard_frames : truth.frames);
  journal->add(key, Json(found).dump());
  return found;
}

/// Runs all points, the repeats in turn so that a slow spell of the machine meets all alike.
void ChartRunner::Impl::measure(const Sweep& sweep,
                                std::vector<std::pair<ToolChain, ChartPoint>>& points,
                                const std::string& what, bool with_flicker, int first_repeat) {
  struct Runs {
    std::vector<ChainCommand> commands;
    std::vector<std::vector<ToolRun>> of;  ///< The runs of each command.
  };
  std::vector<Runs> all(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    Runs& runs = all[i];
    const ToolChain& chain = points[i].first;
    runs.commands = preparing_commands(chain, options.input);
    const Words hashed = render_words(chain, "");
    const std::string picture = "picture-" + text_hash(shell_command(hashed)).substr(0, 8) + ".png";
    runs.commands.push_back({Stage::kRender, render_words(chain, picture), picture});
    runs.of.resize(runs.commands.size());
    for (const ChainCommand& c : runs.commands) {
      points[i].second.commands.push_back(shell_command(c.words));
    }
    points[i].second.picture = path(picture);
  }
  for (int repeat = first_repeat; repeat < first_repeat + options.repeats; ++repeat) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      ChartPoint& point = points[i].second;
      step(what);
      for (std::size_t c = 0; c < all[i].commands.size() && point.refused.empty(); ++c) {
        const ChainCommand& command = all[i].commands[c];
        const bool repeated = command.stage == Stage::kRender || command.stage == sweep.timed;
        if (repeat > first_repeat && !repeated) continue;
        // Times are compared within a sweep: its points take turns, also those that others share.
        const ToolRun run =
            tools->run(command.words, command.output,
                       repeated ? fmt::format("{} {}", sweep.name, repeat) : std::string());
        if (run.exit_code != 0) {
          // The default must work; other settings need not for every input.
          if (point.standard) run.require_success();
          point.refused = run.message;
          continue;
        }
        all[i].of[c].push_back(run);
      }
    }
  }

  const Truth& truth = truth_of(sweep);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ChartPoint& point = points[i].second;
    if (!point.refused.empty()) continue;
    for (std::size_t c = 0; c < all[i].commands.size(); ++c) {
      const std::vector<ToolRun>& runs = all[i].of[c];
      const Stage stage = all[i].commands[c].stage;
      std::vector<double> times;
      for (const ToolRun& run : runs) times.push_back(run.ms);
      const TimeSpread spread = spread_of(times);
      const ToolRun& median =
          *std::min_element(runs.begin(), runs.end(), [&](const ToolRun& a, const ToolRun& b) {
            return std::abs(a.ms - spread.median) < std::abs(b.ms - spread.median);
          });
      point.stages.insert(point.stages.end(), median.stages.begin(), median.stages.end());
      for (const ToolRun& run : runs) point.memory = std::max(point.memory, run.memory);
      if (stage == Stage::kRender) {
        point.render = spread;
        point.surfels = median.surfels;
        point.groups = median.groups;
      } else {
        point.prepare_ms += spread.median;
      }
      if (stage == sweep.timed) point.time = spread;
    }
    point.error = image_error(read_premultiplied_image(point.picture), truth.image);
    if (with_flicker) {
      step(what + ", flicker");
      const std::string stem = fs::path(point.picture).stem().string();
      point.flicker = flicker_of(points[i].first, stem, truth);
    }
  }
}

ChartSweep ChartRunner::Impl::run_sweep(const Sweep& sweep) {
  ChartSweep result;
  result.name = sweep.name;
  result.title = sweep.title;
  result.about = sweep.about;
  result.time = sweep.timed == Stage::kRender ? "time of the picture"
                                              : std::string("time of ") + tool_name(sweep.timed);
  auto points = points_of(sweep);
  measure(sweep, points, sweep.name, options.frames > 0, 0);
  result.truth = truth_of(sweep).file;
  for (auto& [chain, point] : points) result.points.push_back(std::move(point));
  judge(result);
  return result;
}

void ChartRunner::Impl::expect(const std::vector<Sweep>& sweeps) {
  runs_done = 0;
  runs_expected = 0;
  timer.restart();
  for (const Sweep& sweep : sweeps) {
    runs_expected += static_cast<double>(points_of(sweep).size()) *
                     (options.repeats + (options.frames > 0 ? 1 : 0));
  }
}

ChartRunner::ChartRunner(ChartOptions options)
    : impl_(std::make_unique<Impl>(std::move(options))) {}
ChartRunner::~ChartRunner() = default;

ChartReport ChartRunner::run() {
  const std::vector<Sweep> sweeps = choose_sweeps(impl_->options.sweeps, impl_->context);
  impl_->expect(sweeps);
  ChartReport report;
  for (const Sweep& sweep : sweeps) report.sweeps.push_back(impl_->run_sweep(sweep));
  report.summary = impl_->summary;
  report.truth_commands = impl_->truth_commands;
  report.camera_path = impl_->path_toml;
  return report;
}

Recommendation ChartRunner::recommend(const ChartGoal& goal) {
  require_usable(goal);
  Impl& run = *impl_;
  Sweep candidates;
  candidates.name = "recommend";
  candidates.standard = "default";
  candidates.points = recommendation_candidates(run.context);
  run.expect({candidates});
  auto points = run.points_of(candidates);
  run.measure(candidates, points, "looking for the cheapest setting", false, 0);
  std::vector<ChartPoint> measured;
  for (const auto& [chain, point] : points) measured.push_back(point);
  Recommendation result;
  result.tried = 0;
  for (const std::size_t i : recommendation_order(measured, goal)) {
    ++result.tried;
    // Once more, and not from the journal: what is recommended must hold when it is run.
    std::vector<std::pair<ToolChain, ChartPoint>> again{{points[i].first, ChartPoint{}}};
    again[0].second.label = measured[i].label;
    const int fresh = static_cast<int>(1 + run.journal->size());
    run.measure(candidates, again, "running it again", false, fresh);
    const ChartPoint& p = again[0].second;
    if (goal.max_time && p.render.most > *goal.max_time) continue;
    if (goal.min_psnr && p.error.psnr < *goal.min_psnr) continue;
    result.point = p;
    return result;
  }
  const auto best = std::min_element(
      measured.begin(), measured.end(), [&](const ChartPoint& a, const ChartPoint& b) {
        if (a.refused.empty() != b.refused.empty()) return a.refused.empty();
        return goal.max_time ? a.render.median < b.render.median : a.error.psnr > b.error.psnr;
      });
  throw_input("",
              fmt::format("no setting reaches that; the best, \"{}\", takes {:.3g} ms at {:.4g} "
                          "dB",
                          best->label, best->render.median, best->error.psnr));
}

}  // namespace surfel
