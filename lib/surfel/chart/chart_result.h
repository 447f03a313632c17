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

}  // namespace surfel
