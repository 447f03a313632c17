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
  std::string time;  ///< What the time is that of, for the axis.
  std::vector<PlotPoint> points;
};

struct LabelPlace {
  double x = 0, y = 0;  ///< Left end of the text's middle line, pixels from the top left.
  bool leader = false;  ///< So far from its point that a line must lead there.
};

/// Where the labels of points go: beside their point, inside width x height less the margins, not
/// over one another, over points nor over `obstacles`, as long as there is room. `widths` are the
/// texts' in pixels.
SURFEL_API std::vector<LabelPlace> place_labels(const std::vector<LabelPlace>& points,
                                                const std::vector<double>& widths,
                                                const std::vector<LabelPlace>& obstacles,
                                                double left, double top, double right,
                                                double bottom);

/// The plot as SVG of 800 x 480 pixels, drawn by gnuplot, which is started in `folder` and leaves
/// files there. The time's axis is logarithmic where the times are far apart. Throws Error(kIo)
/// where gnuplot cannot be run or fails; kUsage without points.
SURFEL_API std::string plot_svg(const Plot& plot, const std::string& folder);

/// Throws Error(kIo), telling which package to install, where there is no gnuplot.
SURFEL_API void require_gnuplot();

}  // namespace surfel
