#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/report/info_charts.h>
#include <surfel/report/page_chart.h>
#include <surfel/scene/color_map.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/store/attribute_values.h>

namespace surfel {
namespace {

constexpr std::size_t kBins = 40;
/// Charts of columns, at most.
constexpr std::size_t kMostColumns = 16;
/// Categories of a chart, at most: the most frequent ones.
constexpr std::size_t kMostCategories = 12;

/// The value below which a share of sorted values is.
double value_at(const std::vector<double>& sorted, double share) {
  return sorted[rank_of(share, sorted.size())];
}

/// A chart of numbers; none where there are none.
void add_numbers(std::vector<InfoChart>& charts, const std::string& title,
                 const std::vector<double>& values, const std::string& note) {
  std::vector<double> sorted;
  for (const double value : values) {
    if (std::isfinite(value)) sorted.push_back(value);
  }
  if (sorted.empty()) return;
  std::sort(sorted.begin(), sorted.end());
  constexpr double kStray = 0.01;
  double least = value_at(sorted, kStray);
  double most = value_at(sorted, 1 - kStray);
  if (!(least < most)) {
    least = sorted.front();
    most = sorted.back();
  }
  std::string said = fmt::format("median {}", shown_number(value_at(sorted, 0.5)));
  if (sorted.front() < least || sorted.back() > most) {
    said +=
        fmt::format(", all {} to {}", shown_number(sorted.front()), shown_number(sorted.back()));
  }
  if (sorted.size() < values.size()) {
    said += fmt::format(", {} without a value", values.size() - sorted.size());
  }
  if (!note.empty()) said += "; " + note;
  if (!(least < most)) {
    charts.push_back(
        {title,
         fmt::format("{} everywhere{}{}", shown_number(least), note.empty() ? "" : "; ", note),
         named_counts_svg({{shown_number(least), sorted.size()}})});
    return;
  }
  charts.push_back({title, said, histogram_svg(histogram_of(values, least, most, kBins))});
}

void add_categories(std::vector<InfoChart>& charts, const std::string& title,
                    const std::vector<double>& values, bool las, const std::string& note) {
  std::map<std::int64_t, std::size_t> found;
  for (const double value : values) {
    if (std::isfinite(value)) ++found[static_cast<std::int64_t>(value)];
  }
  if (found.empty()) return;
  std::vector<std::pair<std::string, std::size_t>> counts;
  for (const auto& [number, count] : found) {
    counts.emplace_back(las ? las_class_name(number) : fmt::to_string(number), count);
  }
  std::stable_sort(counts.begin(), counts.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  std::string said = fmt::format("{} values", counts.size());
  if (counts.size() > kMostCategories) {
    counts.resize(kMostCategories);
    said += fmt::format(", the {} most frequent ones", kMostCategories);
  }
  if (!note.empty()) said += "; " + note;
  charts.push_back({title, said, named_counts_svg(counts)});
}

/// A chart of colours, handed on one by one as linear R G B.
template <class ForEach>
void add_colors(std::vector<InfoChart>& charts, const std::string& note, const ForEach& for_each) {
  constexpr std::size_t kLevels = 64;
  std::array<std::vector<std::size_t>, 3> counts;
  for (auto& channel : counts) channel.assign(kLevels, 0);
  for_each([&](const float* linear) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (!std::isfinite(linear[c])) continue;
      ++counts[c][linear_to_srgb8(linear[c]) * kLevels / 256];
    }
  });
  charts.push_back({"colours",
                    fmt::format("red, green, blue as sRGB{}{}", note.empty() ? "" : "; ", note),
                    color_histogram_svg(counts)});
}

}  // namespace

std::vector<InfoChart> cloud_charts(const SurfelCloud& cloud, const Vec3d& up,
                                    const std::string& note) {
  std::vector<InfoChart> charts;
  const std::size_t size = cloud.size();
  if (size == 0) return charts;
  std::vector<double> values(size);
  const auto add = [&](const std::string& title, const auto& value_of) {
    for (std::size_t i = 0; i < size; ++i) values[i] = value_of(i);
    add_numbers(charts, title, values, note);
  };
  if (has_variance(cloud)) {
    add("radius of the disc at cutoff 1", [&](std::size_t i) {
      const double variance = cloud.anisotropic()
                                  ? std::max(cloud.variance_u[i], cloud.variance_v[i])
                                  : cloud.variance[i];
      return std::sqrt(2 * variance);
    });
  }
  if (!cloud.area.empty()) {
    add("spacing (root of the area)",
        [&](std::size_t i) { return std::sqrt(static_cast<double>(cloud.area[i])); });
  }
  if (!cloud.color.empty() || !cloud.coefficient.empty()) {
    const Array<Vec3f>& colors = cloud.coefficient.empty() ? cloud.color : cloud.coefficient;
    add_colors(charts, note, [&](const auto& take) {
      for (const Vec3f& color : colors) take(color.data());
    });
  }
  if (!cloud.alpha.empty()) {
    add("opacity", [&](std::size_t i) { return static_cast<double>(cloud.alpha[i]); });
  }
  add("elevation", [&](std::size_t i) { return cloud.world(i).dot(up); });
  const CloudSource source(cloud, {}, CloudSource::Sizes::kAny);
  const std::vector<std::string> columns = source.columns();
  for (std::size_t c = 0; c < std::min(columns.size(), kMostColumns); ++c) {
    source.fill_column(c, 0, size, values.data());
    const AttributeKind kind = AttributeValues(source, columns[c], up, {}).kind();
    if (kind == AttributeKind::kNumber) {
      add_numbers(charts, columns[c], values, note);
    } else {
      add_categories(charts, columns[c], values, kind == AttributeKind::kLasClass, note);
    }
  }
  return charts;
}

std::vector<InfoChart> image_charts(const Image& image) {
  std::vector<InfoChart> charts;
  add_colors(charts, "", [&](const auto& take) {
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) take(image.pixel(x, y));
    }
  });
  return charts;
}

}  // namespace surfel
