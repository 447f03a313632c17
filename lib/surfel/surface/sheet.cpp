#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <surfel/surface/sheet.h>

namespace surfel {

float SheetRules::least_cosine() const {
  return static_cast<float>(std::cos(normal_angle * std::numbers::pi / 180));
}

std::vector<std::string> SheetRules::problems() const {
  std::vector<std::string> found;
  if (!(normal_angle > 0 && normal_angle <= 90)) {
    found.push_back(
        fmt::format("`normal_angle` is {}; it must be in (0, 90] degrees", normal_angle));
  }
  if (!(sheet_weight >= 1 && sheet_weight <= 1000)) {
    found.push_back(fmt::format("`sheet_weight` is {}; it must be in 1..1000", sheet_weight));
  }
  return found;
}

}  // namespace surfel
