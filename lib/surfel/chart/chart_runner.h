#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/chart/pareto.h>
#include <surfel/io/camera.h>
#include <surfel/measure/image_error.h>

namespace surfel {

struct ChartOptions {
  std::string input;  ///< Surfels, points, or a mesh to sample.
  std::string image;  ///< Texture of the mesh; empty: its materials' own, if there are any.
  std::string mesh;   ///< Of surfels: the mesh that they stand for, for `truth` = "mesh".
  /// "reference" (the surfels ray cast), "mesh" (ray traced), or a picture's file of the camera's
  /// size. Empty: the mesh where there is one, else the reference.
  std::string truth;
  std::vector<std::string> sweeps;  ///< Names; empty: all that make sense for the input.
  /// Options of the tools for all points, as ToolChain::apply() takes them.
  std::vector<std::string> with;
  std::string scene;  ///< Scene file; empty: the tools' default.
  CameraOptions camera;
  std::size_t count = 100000;  ///< Samples of a mesh, >= 1.
  int repeats = 5;             ///< Runs of which the median time counts, 1..1000.
  int frames = 8;              ///< Of the camera path for flicker, 0 = none, else 2..1000.
  int samples = 8;             ///< Rays along each side of the truth's pixels, 1..64.
  bool quick = false;          ///< Fewer points.
  std::string tools;           ///< Folder of the tools.
  std::string folder;          ///< Where journal, surfels and pictures of the run lie; must exist.
  /// Told what is done, and the share of all that is.
  std::function<void(const std::string&, double)> progress = [](const std::string&, double) {};

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Median, least and largest of repeated measurements, milliseconds.
struct TimeSpread {
  double median = 0, least = 0, most = 0;
};

/// A stage of a tool: "surfel-render raster".
using StageTime = std::pair<std::string, double>;

/// What was measured of one setting.
struct ChartPoint {
  std::string label;
  bool standard = false;              ///< The default.
  std::vector<std::string> commands;  ///< As they ran, a shell line each.
  std::string refused;  ///< Not empty: why a tool does not take this setting; nothing is measured.
  TimeSpread time;      ///< Of the sweep's tool.
  std::vector<StageTime> stages;  ///< Of every tool, in the median run.
  double prepare_ms = 0;          ///< All tools before surfel-render, without reading and writing.
  TimeSpread render;              ///< The picture, without reading and writing.
  std::uint64_t memory = 0;       ///< Largest peak of the tools, bytes.
  std::size_t surfels = 0;
  int groups = 0;
  ImageError error;
  std::optional<double> flicker;
  std::string picture;  ///< File.
  bool front = false;   ///< On the Pareto front of time and error.
};

struct ChartSweep {
  std::string name, title, about;
  std::string time;   ///< What the time is that of.
  std::string truth;  ///< File of the truth's picture.
  std::vector<ChartPoint> points;
  FrontDistance standard;  ///< Of the default.
  std::string verdict;     ///< How the default stands to the front, a sentence.
  bool standard_off =
      false;  ///< It is off by more than 20 %; in time, by more than it spreads, too.
};

struct ChartReport {
  std::vector<std::pair<std::string, std::string>> summary;  ///< Of input, machine and measures.
  std::vector<std::string> truth_commands;
  std::string camera_path;  ///< TOML of the flicker's cameras; empty without.
  std::vector<ChartSweep> sweeps;
};

/// What a recommendation must reach: one of the two.
struct ChartGoal {
  std::optional<double> min_psnr;  ///< dB.
  std::optional<double> max_time;  ///< Milliseconds of the picture, without reading and writing.
};

struct Recommendation {
  ChartPoint point;  ///< As measured again by running its commands.
  int tried = 1;     ///< Settings that were run again, the last of which met the goal.
};

/// Order in which settings are tried for a goal, cheapest first under min_psnr, most accurate first
/// under max_time; those that do not meet it, the time with a margin of a fifth for its noise, are
/// left out, and so are settings that the tools refused.
SURFEL_API std::vector<std::size_t> recommendation_order(const std::vector<ChartPoint>& points,
                                                         const ChartGoal& goal);

/// Share by which a default may be off the Pareto front.
inline constexpr double kFrontTolerance = 0.2;

/// Marks the points on the Pareto front, and judges the default.
SURFEL_API void judge(ChartSweep& sweep);

/// Runs the tools for the points of sweeps, one process at a time, and measures. All runs are kept
/// in a journal in the folder, so that the next one of the same options takes up from there.
class SURFEL_API ChartRunner {
 public:
  /// Looks at the input. Throws Error.
  explicit ChartRunner(ChartOptions options);
  ~ChartRunner();
  ChartRunner(const ChartRunner&) = delete;
  ChartRunner& operator=(const ChartRunner&) = delete;

  /// Throws Error(kUsage) for sweeps that do not fit the input, kInput where a tool fails.
  ChartReport run();

  /// Throws Error(kInput) where no setting meets the goal, telling the best.
  Recommendation recommend(const ChartGoal& goal);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
