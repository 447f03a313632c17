#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/scene/transfer_function.h>
#include <surfel/scene/volume.h>

namespace surfel {

std::vector<std::string> TransferFunction::problems() const {
  std::vector<std::string> out;
  if (point.empty()) out.emplace_back("a transfer function needs one point at least");
  for (std::size_t i = 0; i < point.size(); ++i) {
    const Point& p = point[i];
    if (!std::isfinite(p.value)) out.push_back(fmt::format("value of point {} is not finite", i));
    if (!(p.density >= 0) || !std::isfinite(p.density)) {
      out.push_back(fmt::format("density of point {} must be 0 or more and finite", i));
    }
    if (!(p.color.minCoeff() >= 0 && p.color.maxCoeff() <= 1)) {
      out.push_back(fmt::format("color of point {} must be in 0..1", i));
    }
    if (i > 0 && p.value < point[i - 1].value) {
      out.push_back(fmt::format("values of points must not descend, as they do at point {}", i));
    }
  }
  return out;
}

TransferFunction::Point TransferFunction::operator()(double value) const {
  const auto above = std::upper_bound(point.begin(), point.end(), value,
                                      [](double v, const Point& p) { return v < p.value; });
  if (above == point.begin()) return point.front();
  if (above == point.end()) return point.back();
  const Point& a = *(above - 1);
  const Point& b = *above;
  const double t = (value - a.value) / (b.value - a.value);
  return {value, a.color + static_cast<float>(t) * (b.color - a.color),
          a.density + t * (b.density - a.density)};
}

std::array<double, 2> TransferFunction::density_range(double low, double high) const {
  const double first = (*this)(low).density;
  const double last = (*this)(high).density;
  double least = std::min(first, last);
  double most = std::max(first, last);
  for (const Point& p : point) {
    if (p.value < low || p.value > high) continue;
    least = std::min(least, p.density);
    most = std::max(most, p.density);
  }
  return {least, most};
}

const std::vector<std::string>& transfer_function_names() {
  static const std::vector<std::string> names{"ct", "ct-bone", "mr"};
  return names;
}

TransferFunction transfer_function(const std::string& name) {
  const Vec3f skin(0.85F, 0.62F, 0.50F);
  const Vec3f muscle(0.75F, 0.33F, 0.25F);
  const Vec3f bone(0.96F, 0.93F, 0.85F);
  if (name == "ct") {
    // Air is at -1000, fat from -120 to -60, soft tissue from 20 to 80, bone from 300 on.
    return {{{-600, skin, 0},
             {-200, skin, 0.06},
             {-20, skin, 0.04},
             {60, muscle, 0.06},
             {180, muscle, 0.15},
             {350, bone, 0.5},
             {1500, bone, 1}},
            false};
  }
  if (name == "ct-bone") {
    return {{{150, bone, 0}, {300, bone, 0.4}, {1500, bone, 1}}, false};
  }
  if (name == "mr") {
    return {{{0.12, skin, 0},
             {0.25, skin, 0.06},
             {0.5, muscle, 0.25},
             {0.8, bone, 0.9},
             {1, bone, 1.5}},
            true};
  }
  throw_usage(fmt::format("transfer function \"{}\" is unknown; known are {}", name,
                          fmt::join(transfer_function_names(), ", ")));
}

TransferFunction absolute(const TransferFunction& function, const Volume& volume) {
  if (!function.relative) return function;
  constexpr double kLow = 0.01;
  constexpr double kHigh = 0.999;
  const auto [low, high] = value_quantiles(volume, {kLow, kHigh});
  TransferFunction result = function;
  result.relative = false;
  for (TransferFunction::Point& p : result.point) p.value = low + p.value * (high - low);
  return result;
}

}  // namespace surfel
