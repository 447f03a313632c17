#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/chart/pareto.h>
#include <surfel/truth/image_error.h>

namespace surfel {

/// Median, least and largest of repeated measurements, milliseconds.
struct TimeSpread {
  double median = 0, least = 0, most = 0;
};

/// A stage of a tool: "surfel-render raster".
using StageTime = std::pair<std::string, double>;

/// One setting, and what was measured of it.
struct ChartPoint {
  std::string label;
  bool standard = false;              ///< The setting is the tools' default.
  std::vector<std::string> commands;  ///< The commands that ran, for a shell.
  std::string refused;  ///< Not empty: why a tool refuses the setting; nothing is measured then.
  TimeSpread time;      ///< Time of the tool that the sweep is about.
  std::vector<StageTime> stages;  ///< Stages of every tool in the median run.
  double prepare_ms = 0;  ///< Time of all tools before surfel-render, without reading and writing.
  TimeSpread render;      ///< Time of the picture, without reading and writing.
  std::uint64_t memory = 0;  ///< Largest peak of the tools, bytes.
  std::size_t surfels = 0;
  int groups = 0;
  ImageError error;
  std::optional<double> flicker;
  std::string picture;  ///< The picture's file.
  bool front = false;   ///< The point is on the Pareto front of time and error.
};

/// A family of settings of one kind, and how the default stands among them.
struct ChartSweep {
  std::string name, title, about;
  std::string time;   ///< Title of the times: "time of the picture".
  std::string truth;  ///< File of the truth's picture.
  std::vector<ChartPoint> points;
  FrontDistance standard;  ///< Distance of the default from the front.
  std::string verdict;     ///< How the default stands to the front, a sentence.
  /// The default is off the front by more than kFrontTolerance; in time, also by more than its
  /// times spread.
  bool standard_off = false;
};

struct ChartReport {
  std::vector<std::pair<std::string, std::string>> summary;  ///< Input, machine and measures.
  std::vector<std::string> truth_commands;                   ///< Commands for a shell.
  std::string camera_path;  ///< TOML of the cameras that flicker is measured with; empty without.
  std::vector<ChartSweep> sweeps;
};

}  // namespace surfel
