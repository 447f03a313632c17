#include <fmt/format.h>
#include <surfel/base/option_check.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/compositor.h>
#include <surfel/render/render_options.h>

namespace surfel {
namespace {

/// Standard deviation of the low-pass filter that stands for none, pixels: an edge-on disc keeps a
/// width.
constexpr double kNoLowpass = 1e-3;

}  // namespace

const CompositingMethod& RenderOptions::compositing() const {
  return method ? *method : a_buffer_method();
}

double RenderOptions::filter_deviation() const {
  return filter == Filter::kNone ? kNoLowpass : lowpass;
}

std::vector<std::string> RenderOptions::problems() const {
  std::vector<std::string> found = compositing().problems(*this);
  check_option(found, cutoff >= 0.1 && cutoff <= 16, "cutoff", cutoff, "in 0.1..16");
  check_option(found, lowpass >= 0.1 && lowpass <= 16, "lowpass", lowpass, "in 0.1..16 pixels");
  check_option(found, kernel_tolerance > 0 && kernel_tolerance <= 1e6, "kernel_tolerance",
               kernel_tolerance, "in (0, 1e6] pixels");
  check_rule(
      found, kernel != Kernel::kPerspective || filter != Filter::kCircular,
      "the circular filter has an affine kernel only; choose another kernel than the perspective "
      "one");
  check_option(found, layers >= 1 && layers <= kMostLayers, "layers", layers,
               fmt::format("in 1..{}", kMostLayers));
  check_option(found, depth_epsilon >= 1e-6 && depth_epsilon <= 1e6, "depth_epsilon", depth_epsilon,
               "in 1e-6..1e6");
  check_option(found,
               !coverage_threshold || (*coverage_threshold >= 1e-12 && *coverage_threshold <= 1000),
               "coverage_threshold", coverage_threshold.value_or(0), "in 1e-12..1000");
  check_option(found, !lod_error || (*lod_error >= 0 && *lod_error <= 1000), "lod_error",
               lod_error.value_or(0), "in 0..1000 pixels");
  check_option(found, batch >= RenderCloud::kClusterSize && batch <= (std::size_t{1} << 27),
               "batch", batch, "in 256..2^27");
  check_background(found, background);
  return found;
}

}  // namespace surfel
