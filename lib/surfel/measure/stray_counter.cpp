#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/shell_quote.h>
#include <surfel/measure/stray_counter.h>

namespace surfel {
namespace {

/// A box that holds `box`, of numbers with few digits, as --bounds takes it.
std::string round_box(const Bounds& box) {
  const double side = (box.max - box.min).maxCoeff();
  const double far = std::max(box.min.cwiseAbs().maxCoeff(), box.max.cwiseAbs().maxCoeff());
  // Numbers far from zero have no digits that a small step could round.
  const double exponent = std::floor(portable::log10(std::max({side / 20, far * 1e-12, 1e-300})));
  const double step = portable::pow(10, exponent);
  const int decimals = static_cast<int>(std::max(0.0, -exponent));
  std::string out;
  // Zero is added as minus zero would be printed as such.
  for (const double sign : {-1.0, 1.0}) {
    for (int axis = 0; axis < 3; ++axis) {
      const double corner = sign < 0 ? box.min[axis] : box.max[axis];
      const double outside = (std::floor(sign * corner / step) + 1) * step;
      out += fmt::format("{}{:.{}f}", out.empty() ? "" : ",", sign * outside + 0.0, decimals);
    }
  }
  return out;
}

}  // namespace

void StrayCounter::add(const SurfelCloud& piece) { spread_.add(piece.origin, piece.position); }

const std::optional<Bounds>& StrayCounter::core() {
  if (!chosen_) {
    const Bounds box = spread_.box();
    const Bounds core = spread_.core(box);
    if (core.min != box.min || core.max != box.max) core_ = core;
    chosen_ = true;
  }
  return core_;
}

void StrayCounter::look(const SurfelCloud& piece) {
  if (const std::optional<Bounds>& core = this->core()) {
    for (std::size_t i = 0; i < piece.size(); ++i) {
      // As the spread has it.
      const Vec3d place = piece.origin + piece.position[i].cast<double>();
      if (!place.allFinite() || core->contains(place)) continue;
      if (!strays_) strays_ = StrayPoints{0, looked_at_ + i, piece.world(i)};
      ++strays_->count;
    }
  }
  looked_at_ += piece.size();
}

CloudNeed StrayCounter::need(const std::string& file) const {
  const StrayPoints& s = *strays_;
  return {"strays",
          fmt::format("{} of {} points lie far from all others; the first is point {} (counted "
                      "from 0) at {:.10g}, {:.10g}, {:.10g}",
                      s.count, looked_at_, s.first, s.place.x(), s.place.y(), s.place.z()),
          fmt::format("surfel-convert {} --bounds={} -o OUT", shell_file(file), round_box(*core_))};
}

}  // namespace surfel
