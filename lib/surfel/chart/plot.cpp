#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/process.h>
#include <surfel/base/whole_file.h>
#include <surfel/chart/plot.h>

namespace surfel {
namespace {

/// Pixels: a page of text is about as wide.
constexpr double kWidth = 800;
constexpr double kHeight = 480;
// The area between the axes, pixels from the top left: it leaves room for their numbers and titles.
constexpr double kLeft = 82;
constexpr double kRight = 785;
constexpr double kTop = 40;
constexpr double kBottom = 425;
constexpr double kGlyphWidth = 6.8;  ///< A generous mean for the labels' 12 px sans-serif.
constexpr double kLineHeight = 14;   ///< The labels' 12 px, and a gap.
constexpr double kMarker = 9;        ///< Half the side of the square that a marker takes.
constexpr double kLineReach = 2;     ///< Half the side of the square that a point of a line takes.
/// From here on the slowest point is so much slower than the fastest that a linear axis would crowd
/// the fast ones.
constexpr double kLogarithmicFrom = 4;

/// The area that two areas share, pixels squared.
double overlap(const PlotArea& a, const PlotArea& b) {
  const double width = std::min(a.right, b.right) - std::max(a.left, b.left);
  const double height = std::min(a.bottom, b.bottom) - std::max(a.top, b.top);
  return width > 0 && height > 0 ? width * height : 0;
}

/// A square around a place, of this half side.
PlotArea square(const LabelPlace& place, double reach) {
  return {place.x - reach, place.y - reach, place.x + reach, place.y + reach};
}

/// A label of this width, with some space beside it.
PlotArea label_area(const LabelPlace& place, double width) {
  return {place.x - 2, place.y - kLineHeight / 2, place.x + width + 2, place.y + kLineHeight / 2};
}

/// One axis: the values at its ends, and where others are on it, 0..1.
struct Axis {
  double low = 0, high = 1;
  bool logarithmic = false;
  double place(double value) const {
    return logarithmic ? portable::log(value / low) / portable::log(high / low)
                       : (value - low) / (high - low);
  }
};

Axis time_axis(const Plot& plot) {
  const auto [least, most] =
      std::minmax_element(plot.points.begin(), plot.points.end(),
                          [](const auto& a, const auto& b) { return a.time_ms < b.time_ms; });
  Axis axis;
  axis.logarithmic = most->time_ms > kLogarithmicFrom * least->time_ms;
  if (axis.logarithmic) {
    const double margin = portable::pow(most->time_ms / least->time_ms, 0.08);
    axis.low = least->time_ms / margin;
    axis.high = most->time_ms * margin;
  } else {
    const double margin = std::max(0.15 * (most->time_ms - least->time_ms), 0.06 * most->time_ms);
    axis.low = std::max(0.0, least->time_ms - margin);
    axis.high = most->time_ms + margin;
  }
  return axis;
}

Axis psnr_axis(const Plot& plot) {
  Axis axis{plot.points.front().psnr, plot.points.front().psnr, false};
  for (const PlotPoint& p : plot.points) {
    axis.low = std::min(axis.low, p.psnr);
    axis.high = std::max(axis.high, p.psnr);
  }
  // Differences below half a decibel are not worth filling the height with.
  const double margin = std::max(0.12 * (axis.high - axis.low), 0.5);
  axis.low -= margin;
  axis.high += margin;
  return axis;
}

/// Ticks 1, 2, 5 of each decade; where these are fewer than four, more of them.
std::string logarithmic_ticks(const Axis& axis) {
  for (const std::vector<double>& steps :
       {std::vector<double>{1, 2, 5}, std::vector<double>{1, 1.5, 2, 3, 4, 5, 7}}) {
    std::vector<double> ticks;
    for (double decade = portable::pow(10, std::floor(portable::log10(axis.low)));
         decade < axis.high; decade *= 10) {
      for (const double step : steps) {
        if (step * decade >= axis.low && step * decade <= axis.high) {
          ticks.push_back(step * decade);
        }
      }
    }
    if (ticks.size() < 4 && steps.size() == 3) continue;
    std::string list;
    for (const double tick : ticks) {
      list += fmt::format("{}'{:g}' {:g}", list.empty() ? "" : ", ", tick, tick);
    }
    return list;
  }
  return "";
}

/// A text of gnuplot's language, which knows no escape but the doubled quote.
std::string quoted(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  for (std::size_t at = 0; (at = text.find('\'', at)) != std::string::npos; at += 2) {
    text.insert(at, 1, '\'');
  }
  return "'" + text + "'";
}

/// Places along the line through the points on the front, which no label should hide.
std::vector<LabelPlace> front_line(const Plot& plot, const std::vector<LabelPlace>& at) {
  std::vector<LabelPlace> front;
  for (std::size_t i = 0; i < at.size(); ++i) {
    if (plot.points[i].front) front.push_back(at[i]);
  }
  std::sort(front.begin(), front.end(), [](const auto& a, const auto& b) { return a.x < b.x; });
  std::vector<LabelPlace> line;
  for (std::size_t i = 1; i < front.size(); ++i) {
    const double dx = front[i].x - front[i - 1].x;
    const double dy = front[i].y - front[i - 1].y;
    const double steps = std::ceil(portable::hypot(dx, dy) / (2 * kLineReach));
    for (double s = 0; s < steps; ++s) {
      line.push_back({front[i - 1].x + dx * s / steps, front[i - 1].y + dy * s / steps});
    }
  }
  return line;
}

std::string script(const Plot& plot) {
  const Axis x = time_axis(plot);
  const Axis y = psnr_axis(plot);
  std::string out = fmt::format(
      "set terminal svg size {0:g},{1:g} font 'Helvetica,Arial,sans-serif,13' background "
      "'#ffffff'\n"
      "set output 'plot.svg'\nset encoding utf8\n"
      "set lmargin at screen {2}\nset rmargin at screen {3}\n"
      "set tmargin at screen {4}\nset bmargin at screen {5}\n"
      "set border 3 lc rgb '#444444'\nset grid lc rgb '#e4e4e4' lt 1\n"
      "set tics nomirror textcolor rgb '#333333'\n"
      "set key at screen 0.98,0.985 right top horizontal samplen 1.5 textcolor rgb '#333333'\n"
      "set ylabel 'error: PSNR against the truth, dB (higher is better)' noenhanced\n"
      "set xlabel {6} noenhanced\nset xrange [{7}:{8}]\nset yrange [{9}:{10}]\n",
      kWidth, kHeight, kLeft / kWidth, kRight / kWidth, 1 - kTop / kHeight, 1 - kBottom / kHeight,
      quoted(plot.time + ", ms" + (x.logarithmic ? " (logarithmic)" : "")), x.low, x.high, y.low,
      y.high);
  if (x.logarithmic) out += "set logscale x\nset xtics (" + logarithmic_ticks(x) + ")\n";

  std::vector<LabelPlace> at;
  std::vector<double> widths;
  for (const PlotPoint& p : plot.points) {
    at.push_back({kLeft + (kRight - kLeft) * x.place(p.time_ms),
                  kBottom - (kBottom - kTop) * y.place(p.psnr)});
    widths.push_back(kGlyphWidth * static_cast<double>(p.label.size()));
  }
  const auto labels =
      place_labels(at, widths, front_line(plot, at), {kLeft + 2, kTop + 2, kRight, kBottom - 2});
  const auto screen = [](double px, double py) {
    return fmt::format("screen {:.5f},{:.5f}", px / kWidth, 1 - py / kHeight);
  };
  for (std::size_t i = 0; i < labels.size(); ++i) {
    out += fmt::format("set label {} at {} left noenhanced font ',12' front\n",
                       quoted(plot.points[i].label), screen(labels[i].x, labels[i].y));
    if (!labels[i].leader) continue;
    const bool right = labels[i].x > at[i].x;
    const double end = right ? labels[i].x - 2 : std::min(labels[i].x + widths[i], at[i].x);
    out += fmt::format("set arrow from {} to {} nohead lc rgb '#999999' lw 0.7 front\n",
                       screen(at[i].x, at[i].y), screen(end, labels[i].y));
  }

  const auto rows = [&](const char* name, auto wanted) {
    std::vector<const PlotPoint*> points;
    for (const PlotPoint& p : plot.points) {
      if (wanted(p)) points.push_back(&p);
    }
    std::sort(points.begin(), points.end(),
              [](const auto* a, const auto* b) { return a->time_ms < b->time_ms; });
    out += fmt::format("${} << EOD\n", name);
    for (const PlotPoint* p : points) out += fmt::format("{:.6g} {:.6g}\n", p->time_ms, p->psnr);
    out += "EOD\n";
    return !points.empty();
  };
  std::string curves;
  if (rows("front", [](const PlotPoint& p) { return p.front; })) {
    curves += "$front with linespoints lc rgb '#1f6fb4' lw 1.5 pt 7 ps 0.7 title 'Pareto front'";
  }
  if (rows("rest", [](const PlotPoint& p) { return !p.front; })) {
    curves += ", $rest with points lc rgb '#777777' pt 6 ps 0.7 title 'off the front'";
  }
  if (rows("standard", [](const PlotPoint& p) { return p.standard; })) {
    curves += ", $standard with points lc rgb '#d1491b' lw 2 pt 6 ps 1.5 title 'default'";
  }
  return out + "plot " + curves + "\n";
}

}  // namespace

std::vector<LabelPlace> place_labels(const std::vector<LabelPlace>& points,
                                     const std::vector<double>& widths,
                                     const std::vector<LabelPlace>& obstacles,
                                     const PlotArea& area) {
  std::vector<PlotArea> taken;
  for (const LabelPlace& o : obstacles) taken.push_back(square(o, kLineReach));
  for (const LabelPlace& p : points) taken.push_back(square(p, kMarker));
  std::vector<LabelPlace> places;
  for (std::size_t i = 0; i < points.size(); ++i) {
    LabelPlace best;
    double least = std::numeric_limits<double>::infinity();
    // Rings about the point, nearest first; on a ring: right, left, above, below, between these.
    for (double ring = 0; ring <= 12 && least > 0; ++ring) {
      const double out = kMarker + 3 + kLineHeight * ring;
      static constexpr std::array<std::array<double, 2>, 8> kSides{
          {{1, 0}, {-1, 0}, {0, -1}, {0, 1}, {1, -1}, {1, 1}, {-1, -1}, {-1, 1}}};
      for (const auto& [dx, dy] : kSides) {
        LabelPlace place;
        const double shift = dx > 0 ? out : dx < 0 ? -out - widths[i] : -widths[i] / 2;
        place.x =
            std::clamp(points[i].x + shift, area.left, std::max(area.left, area.right - widths[i]));
        place.y = std::clamp(points[i].y + dy * (out + kLineHeight / 2), area.top + kLineHeight / 2,
                             area.bottom - kLineHeight / 2);
        place.leader = ring > 0;
        double cost = 0;
        for (const PlotArea& other : taken) cost += overlap(label_area(place, widths[i]), other);
        if (cost < least) {
          least = cost;
          best = place;
        }
      }
    }
    taken.push_back(label_area(best, widths[i]));
    places.push_back(best);
  }
  return places;
}

void require_gnuplot() {
  if (!find_program("gnuplot").empty()) return;
  throw_io("gnuplot",
           "is not installed, and draws the plots; on Debian: apt-get install "
           "gnuplot-nox");
}

std::string plot_svg(const Plot& plot, const std::string& folder) {
  if (plot.points.empty()) throw_usage("there is no point to plot");
  require_gnuplot();
  {
    OutputFile file(folder + "/plot.gp");
    file.write(script(plot));
    file.commit();
  }
  const ProcessResult result = run_process({"gnuplot", "plot.gp"}, folder);
  if (result.exit_code != 0) throw_io("gnuplot", "failed: " + result.errors);
  return whole_file(folder + "/plot.svg");
}

}  // namespace surfel
