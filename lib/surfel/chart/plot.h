#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

struct PlotPoint {
  std::string label;
  double time_ms = 0;     ///< > 0.
  double psnr = 0;        ///< dB, finite.
  bool front = false;     ///< On the Pareto front.
  bool standard = false;  ///< The default.
};

/// Error against time.
struct Plot {
  std::string time;  ///< Title of the time's axis, without its unit.
  std::vector<PlotPoint> points;
};

/// An area of a picture, pixels from its top left.
struct PlotArea {
  double left = 0, top = 0, right = 0, bottom = 0;
};

struct LabelPlace {
  double x = 0, y = 0;  ///< Left end of the text's middle line, pixels from the top left.
  bool leader = false;  ///< So far from its point that a line must lead there.
};

/// Where the labels of points go: beside their points, inside the area, and, as long as there is
/// room, over no other label, point or obstacle. `widths` are the widths of the labels, pixels.
SURFEL_API std::vector<LabelPlace> place_labels(const std::vector<LabelPlace>& points,
                                                const std::vector<double>& widths,
                                                const std::vector<LabelPlace>& obstacles,
                                                const PlotArea& area);

/// The plot as SVG of 800 x 480 pixels. Gnuplot draws it, runs in `folder` and leaves files there.
/// The time's axis is logarithmic where the times are far apart. Throws Error(kIo) where gnuplot
/// cannot be run or fails; kUsage without points.
SURFEL_API std::string plot_svg(const Plot& plot, const std::string& folder);

/// Throws Error(kIo), telling which package to install, where there is no gnuplot.
SURFEL_API void require_gnuplot();

}  // namespace surfel
