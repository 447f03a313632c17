#include <algorithm>
#include <cmath>

#include <surfel/base/parallel.h>
#include <surfel/sample/equal_area_strata.h>

namespace surfel {
namespace {

/// Where the rising piecewise linear function with values[i] at i / (size - 1) takes `value`.
double inverse(const std::vector<double>& values, double value) {
  const auto above = std::upper_bound(values.begin() + 1, values.end() - 1, value);
  const double low = *(above - 1);
  const double rise = *above - low;
  const double fraction = rise > 0 ? std::clamp((value - low) / rise, 0.0, 1.0) : 0.5;
  return (static_cast<double>(above - values.begin()) - 1 + fraction) /
         static_cast<double>(values.size() - 1);
}

double interpolated(const std::vector<double>& values, double at) {
  const double scaled = at * static_cast<double>(values.size() - 1);
  const std::size_t i = std::min(values.size() - 2, static_cast<std::size_t>(scaled));
  return values[i] + (values[i + 1] - values[i]) * (scaled - static_cast<double>(i));
}

/// Running sums with a leading 0, scaled to end at exactly 1.
std::vector<double> cumulative_share(const std::vector<double>& parts) {
  std::vector<double> sums(parts.size() + 1, 0);
  for (std::size_t i = 0; i < parts.size(); ++i) sums[i + 1] = sums[i] + parts[i];
  const double total = sums.back();
  for (double& s : sums) s /= total;
  sums.back() = 1;
  return sums;
}

}  // namespace

EqualAreaStrata::EqualAreaStrata(const ParametricSurface& surface, std::size_t count)
    : table_size_(static_cast<std::size_t>(
          std::clamp(std::sqrt(static_cast<double>(count)), 64.0, 2048.0))) {
  const double step = 1.0 / static_cast<double>(table_size_);
  element_.resize(table_size_ * table_size_);
  std::vector<double> row_area(table_size_);
  std::vector<double> row_height(table_size_);  // Mean length along v.
  parallel_each(table_size_, 8, [&](std::size_t row) {
    double area = 0;
    double height = 0;
    for (std::size_t column = 0; column < table_size_; ++column) {
      const auto point = surface.at((static_cast<double>(column) + 0.5) * step,
                                    (static_cast<double>(row) + 0.5) * step);
      const double element = point.area_element();
      element_[row * table_size_ + column] = static_cast<float>(element);
      area += element;
      height += point.dpdv.norm();
    }
    row_area[row] = area * step * step;
    row_height[row] = height * step * step;
  });
  double height = 0;
  for (std::size_t row = 0; row < table_size_; ++row) {
    area_ += row_area[row];
    height += row_height[row];
  }
  below_ = cumulative_share(row_area);

  // Rows of equal height, then moved a little so that each holds a whole number of cells.
  const double side = std::sqrt(area_ / static_cast<double>(count));
  const double rows = std::max(1.0, std::round(height / side));
  const std::vector<double> height_below = cumulative_share(row_height);
  first_.push_back(0);
  for (double row = 1; row <= rows; ++row) {
    const double share = interpolated(below_, inverse(height_below, row / rows));
    const auto cells = static_cast<std::size_t>(std::llround(share * static_cast<double>(count)));
    const std::size_t bounded = row == rows ? count : std::min(cells, count);
    if (bounded > first_.back()) first_.push_back(bounded);
  }
}

std::vector<double> EqualAreaStrata::row_profile(std::size_t row) const {
  const double table_row = v_at(row, 0.5) * static_cast<double>(table_size_) - 0.5;
  const double clamped = std::clamp(table_row, 0.0, static_cast<double>(table_size_ - 1));
  const std::size_t low = std::min(table_size_ - 2, static_cast<std::size_t>(clamped));
  const double fraction = clamped - static_cast<double>(low);
  const float* below = element_.data() + low * table_size_;
  const float* above = below + table_size_;
  std::vector<double> element(table_size_);
  for (std::size_t i = 0; i < table_size_; ++i) {
    element[i] = (1 - fraction) * below[i] + fraction * above[i];
  }
  return cumulative_share(element);
}

double EqualAreaStrata::u_at(const std::vector<double>& profile, double share) const {
  return inverse(profile, share);
}

double EqualAreaStrata::v_at(std::size_t row, double share) const {
  const double cells = static_cast<double>(first_[row + 1] - first_[row]);
  return inverse(below_, (static_cast<double>(first_[row]) + share * cells) /
                             static_cast<double>(first_.back()));
}

}  // namespace surfel
