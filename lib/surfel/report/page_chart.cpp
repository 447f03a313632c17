#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/report/page.h>
#include <surfel/report/page_chart.h>

namespace surfel {
namespace {

// Of charts, in pixels where they are as wide as they are drawn.
constexpr int kWidth = 300;
constexpr int kHeight = 90;  ///< Of bars.
constexpr int kBottom = 16;  ///< Room for the axis' numbers.
constexpr int kTop = 12;     ///< Room for the largest count.
constexpr int kRowHeight = 17;

std::string svg(int height, const std::string& content) {
  return fmt::format("<svg viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\">{2}</svg>", kWidth,
                     height, content);
}

std::string text_at(double x, double y, const char* anchor, const std::string& text) {
  return fmt::format("<text x=\"{:.4g}\" y=\"{:.4g}\" text-anchor=\"{}\">{}</text>", x, y, anchor,
                     escape_html(text));
}

/// The axis below bars, with the values at its ends and in its middle.
std::string axis(const std::string& least, const std::string& middle, const std::string& most) {
  const int y = kTop + kHeight;
  return fmt::format("<line class=\"axis\" x1=\"0\" y1=\"{0}\" x2=\"{1}\" y2=\"{0}\"/>", y,
                     kWidth) +
         text_at(0, y + 11, "start", least) + text_at(kWidth / 2.0, y + 11, "middle", middle) +
         text_at(kWidth, y + 11, "end", most);
}

double height_of(std::size_t count, std::size_t largest, bool logarithmic) {
  if (count == 0 || largest == 0) return 0;
  const auto share = [&](double of, double all) { return kHeight * of / all; };
  if (!logarithmic) return share(static_cast<double>(count), static_cast<double>(largest));
  return share(portable::log10(1 + static_cast<double>(count)),
               portable::log10(1 + static_cast<double>(largest)));
}

std::string hex_color(const Vec3f& linear) {
  return fmt::format("#{:02x}{:02x}{:02x}", linear_to_srgb8(linear.x()),
                     linear_to_srgb8(linear.y()), linear_to_srgb8(linear.z()));
}

}  // namespace

std::string shown_number(double value) { return fmt::format("{:.5g}", value); }

Histogram histogram_of(const std::vector<double>& values, double least, double most,
                       std::size_t bins) {
  Histogram out;
  for (std::size_t i = 0; i <= bins; ++i) {
    out.edges.push_back(least +
                        (most - least) * static_cast<double>(i) / static_cast<double>(bins));
  }
  out.counts.assign(bins, 0);
  const double scale = static_cast<double>(bins) / (most - least);
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    const double bin = std::clamp((value - least) * scale, 0.0, static_cast<double>(bins - 1));
    ++out.counts[static_cast<std::size_t>(bin)];
  }
  return out;
}

std::string histogram_svg(const Histogram& histogram, bool logarithmic) {
  const std::size_t bins = histogram.counts.size();
  if (bins == 0) return svg(kTop + kHeight + kBottom, "");
  const std::size_t largest = *std::max_element(histogram.counts.begin(), histogram.counts.end());
  const double width = static_cast<double>(kWidth) / static_cast<double>(bins);
  std::string content;
  for (std::size_t i = 0; i < bins; ++i) {
    const double height = height_of(histogram.counts[i], largest, logarithmic);
    if (height == 0) continue;
    content += fmt::format(
        "<rect class=\"bar\" x=\"{:.5g}\" y=\"{:.5g}\" width=\"{:.5g}\" height=\"{:.5g}\">"
        "<title>{} to {}: {}</title></rect>",
        static_cast<double>(i) * width, kTop + kHeight - height, 0.9 * width, height,
        shown_number(histogram.edges[i]), shown_number(histogram.edges[i + 1]),
        histogram.counts[i]);
  }
  const auto peak =
      static_cast<std::size_t>(std::max_element(histogram.counts.begin(), histogram.counts.end()) -
                               histogram.counts.begin());
  const double x = std::clamp((static_cast<double>(peak) + 0.5) * width, 30.0, kWidth - 30.0);
  content += text_at(x, kTop - 3, "middle", fmt::format("{}", largest));
  content += axis(shown_number(histogram.edges.front()), shown_number(histogram.edges[bins / 2]),
                  shown_number(histogram.edges.back()));
  return svg(kTop + kHeight + kBottom, content);
}

std::string color_histogram_svg(const std::array<std::vector<std::size_t>, 3>& counts) {
  constexpr std::array<const char*, 3> kFills{"#d33", "#2a2", "#36d"};
  std::size_t largest = 1;
  for (const auto& channel : counts) {
    for (const std::size_t count : channel) largest = std::max(largest, count);
  }
  std::string content;
  for (std::size_t c = 0; c < counts.size(); ++c) {
    const double width = static_cast<double>(kWidth) / static_cast<double>(counts[c].size());
    std::string path = fmt::format("M0 {}", kTop + kHeight);
    for (std::size_t i = 0; i < counts[c].size(); ++i) {
      path += fmt::format("L{:.5g} {:.5g}", (static_cast<double>(i) + 0.5) * width,
                          kTop + kHeight - height_of(counts[c][i], largest, false));
    }
    path += fmt::format("L{} {}Z", kWidth, kTop + kHeight);
    content += fmt::format("<path d=\"{0}\" fill=\"{1}\" fill-opacity=\"0.28\" stroke=\"{1}\"/>",
                           path, kFills[c]);
  }
  return svg(kTop + kHeight + kBottom, content + axis("0", "127", "255"));
}

std::string named_counts_svg(const std::vector<std::pair<std::string, std::size_t>>& counts) {
  std::size_t largest = 1;
  for (const auto& [name, count] : counts) largest = std::max(largest, count);
  constexpr int kNames = 110;  // Width of names.
  constexpr int kCounts = 58;  // Width of numbers.
  std::string content;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const auto& [name, count] = counts[i];
    const int y = static_cast<int>(i) * kRowHeight;
    const double width = static_cast<double>(kWidth - kNames - kCounts) *
                         static_cast<double>(count) / static_cast<double>(largest);
    content += text_at(kNames - 5, y + 12, "end", name) +
               fmt::format("<rect class=\"bar\" x=\"{}\" y=\"{}\" width=\"{:.5g}\" height=\"{}\"/>",
                           kNames, y + 3, std::max(width, 0.5), kRowHeight - 6) +
               text_at(kNames + width + 4, y + 12, "start", fmt::format("{}", count));
  }
  return svg(static_cast<int>(counts.size()) * kRowHeight, content);
}

std::string color_scale_svg(ColorMap map, double least, double most, const std::string& unit) {
  constexpr int kStops = 16;
  constexpr int kTicks = 4;
  constexpr int kBar = 12;
  std::string stops;
  for (int i = 0; i <= kStops; ++i) {
    const double t = static_cast<double>(i) / kStops;
    stops +=
        fmt::format("<stop offset=\"{:.4g}\" stop-color=\"{}\"/>", t, hex_color(map_color(map, t)));
  }
  std::string content = fmt::format(
      "<defs><linearGradient id=\"scale\">{}</linearGradient></defs>"
      "<rect x=\"0\" y=\"0\" width=\"{}\" height=\"{}\" fill=\"url(#scale)\"/>",
      stops, kWidth, kBar);
  for (int i = 0; i <= kTicks; ++i) {
    const double t = static_cast<double>(i) / kTicks;
    const char* anchor = i == 0 ? "start" : i == kTicks ? "end" : "middle";
    const std::string number = shown_number(least + t * (most - least));
    content += text_at(t * kWidth, kBar + 11, anchor,
                       i == kTicks ? fmt::format("{} {}", number, unit) : number);
  }
  return svg(kBar + kBottom, content);
}

}  // namespace surfel
