#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/surface/sheet.h>

namespace surfel {

float SheetRules::least_cosine() const {
  return static_cast<float>(portable::cos(normal_angle * std::numbers::pi / 180));
}

std::vector<std::string> SheetRules::problems() const {
  std::vector<std::string> found;
  check_option(found, normal_angle > 0 && normal_angle <= 90, "normal_angle", normal_angle,
               "in (0, 90] degrees");
  check_option(found, sheet_weight >= 1 && sheet_weight <= 1000, "sheet_weight", sheet_weight,
               "in 1..1000");
  return found;
}

}  // namespace surfel
