#include <fmt/format.h>
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
  const auto check = [&](bool ok, const std::string& message) {
    if (!ok) found.push_back(message);
  };
  check(cutoff >= 0.1 && cutoff <= 16,
        fmt::format("`cutoff` is {}; it must be in 0.1..16", cutoff));
  check(lowpass >= 0.1 && lowpass <= 16,
        fmt::format("`lowpass` is {}; it must be in 0.1..16 pixels", lowpass));
  check(kernel_tolerance > 0 && kernel_tolerance <= 1e6,
        fmt::format("`kernel_tolerance` is {}; it must be in (0, 1e6] pixels", kernel_tolerance));
  check(kernel != Kernel::kPerspective || filter != Filter::kCircular,
        "the circular filter has an affine kernel only; choose another kernel than the perspective "
        "one");
  check(layers >= 1 && layers <= kMostLayers,
        fmt::format("`layers` is {}; it must be in 1..{}", layers, kMostLayers));
  check(depth_epsilon > 0 && depth_epsilon <= 1e6,
        fmt::format("`depth_epsilon` is {}; it must be in (0, 1e6]", depth_epsilon));
  check(!coverage_threshold || (*coverage_threshold > 0 && *coverage_threshold <= 1e6),
        fmt::format("`coverage_threshold` is {}; it must be in (0, 1e6]",
                    coverage_threshold.value_or(0)));
  check(!lod_error || (*lod_error >= 0 && *lod_error <= 1000),
        fmt::format("`lod_error` is {}; it must be in 0..1000 pixels", lod_error.value_or(0)));
  check(batch >= RenderCloud::kClusterSize && batch <= (std::size_t{1} << 27),
        fmt::format("`batch` is {}; it must be in 256..2^27", batch));
  check(std::all_of(background.begin(), background.end(),
                    [](float v) { return std::isfinite(v) && v >= 0; }) &&
            background[3] <= 1,
        "`background` must be four numbers >= 0, alpha at most 1");
  return found;
}

}  // namespace surfel
