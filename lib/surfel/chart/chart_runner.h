#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/chart/chart_judge.h>
#include <surfel/chart/chart_result.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>

namespace surfel {

struct ChartOptions {
  std::string input;  ///< Surfels, points, or a mesh to sample.
  std::string image;  ///< Texture of the mesh; empty: its materials' own, if there are any.
  std::string mesh;   ///< Mesh that input surfels stand for, for `truth` = "mesh".
  /// "reference" (the surfels ray cast), "mesh" (ray traced), or a picture's file of the camera's
  /// size. Empty: the mesh where there is one, else the reference.
  std::string truth;
  std::vector<std::string> sweeps;  ///< Names; empty: all that make sense for the input.
  /// Options of the tools for all points, as ToolChain::apply() takes them.
  std::vector<std::string> with;
  std::string scene;  ///< Scene file; empty: the tools' default scene.
  CameraOptions camera;
  ViewChoice view;             ///< What `camera` leaves open is guessed for the surfels.
  std::size_t count = 100000;  ///< Samples of a mesh, >= 1.
  int repeats = 5;             ///< Runs of which the median time counts, 1..1000.
  int frames = 8;              ///< Frames of the camera path for flicker, 0 = none, else 2..1000.
  int samples = 8;             ///< Rays along each side of the truth's pixels, 1..64.
  bool quick = false;          ///< Only points that are marked as quick are measured.
  std::string tools;           ///< Folder of the tools.
  std::string folder;          ///< Where journal, surfels and pictures of the run lie; must exist.
  /// Is called with the work at hand and the share of all work that is done.
  std::function<void(const std::string&, double)> progress = [](const std::string&, double) {};

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

struct Recommendation {
  ChartPoint point;  ///< The setting, measured again by running its commands.
  int tried = 1;     ///< Settings that were run again, the last of which met the goal.
};

/// Runs the tools for the points of sweeps, one process at a time, and measures. All runs are kept
/// in a journal in the folder, so that a later ChartRunner with equal options goes on from there.
class SURFEL_API ChartRunner {
 public:
  /// Reads the input and makes the surfels of the default. Throws Error.
  explicit ChartRunner(ChartOptions options);
  ~ChartRunner();
  ChartRunner(const ChartRunner&) = delete;
  ChartRunner& operator=(const ChartRunner&) = delete;

  /// Throws Error(kUsage) for sweeps that do not fit the input, kInput where a tool fails.
  ChartReport run();

  /// Throws Error(kUsage) for a goal with problems(), kInput where no setting meets the goal: the
  /// message tells the best.
  Recommendation recommend(const ChartGoal& goal);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
