#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/bounds.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/io/gaussian_columns.h>

namespace surfel {
namespace {

/// Makes the quaternion unit; of zero length it becomes the identity. False if it is not finite.
bool make_unit(std::array<float, 4>& q) {
  double squares = 0;
  for (const float component : q) squares += portable::squared(static_cast<double>(component));
  if (!std::isfinite(squares)) return false;
  if (squares == 0) {
    q = {1, 0, 0, 0};
    return true;
  }
  const double length = std::sqrt(squares);
  for (float& component : q) {
    component = static_cast<float>(static_cast<double>(component) / length);
  }
  return true;
}

/// Repairs Gaussian i as far as may be; false if it cannot be drawn.
bool make_usable(GaussianCloud& cloud, std::size_t i) {
  cloud.scale[i] = cloud.scale[i].cwiseAbs();
  if (!cloud.position[i].allFinite()) return false;
  // The comparison is false for NaN, too.
  if (!(cloud.scale[i].array() <= static_cast<float>(kLargestExtent)).all()) return false;
  if (!std::isfinite(cloud.amplitude[i])) return false;
  const std::size_t stride = cloud.harmonics_stride();
  const float* const harmonics = cloud.harmonics.data() + i * stride;
  return make_unit(cloud.rotation[i]) &&
         std::all_of(harmonics, harmonics + stride,
                     [](float value) { return std::isfinite(value); });
}

/// Leaves out the Gaussians that are not usable.
void compact(GaussianCloud& cloud, const Array<std::uint8_t>& usable) {
  std::size_t to = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (usable[i] != 0) cloud.assign(to++, cloud, i);
  }
  cloud.resize(to);
}

}  // namespace

float opacity_of_logit(float x) {
  return static_cast<float>(1 / (1 + portable::exp(-static_cast<double>(x))));
}

float logit_of_opacity(float opacity) {
  constexpr double kLeast = 1e-6;
  const double o = std::clamp(static_cast<double>(opacity), kLeast, 1 - kLeast);
  return static_cast<float>(portable::log(o / (1 - o)));
}

int degree_of_coefficients(std::size_t numbers, const std::string& file) {
  for (int degree = 0; degree <= GaussianCloud::kMostDegree; ++degree) {
    if (numbers == static_cast<std::size_t>(3 * degree * (degree + 2))) return degree;
  }
  throw_input(file, fmt::format("has {} numbers of spherical harmonics a Gaussian; degrees 0 to {} "
                                "have 0, 9, 24, 45 or 72",
                                numbers, GaussianCloud::kMostDegree));
}

void allocate_gaussians(GaussianCloud& cloud, std::size_t count, const std::string& file,
                        const GaussianReadOptions& options) {
  if (options.accept) options.accept(count, cloud);
  const std::size_t stride = cloud.harmonics_stride();
  const std::uint64_t bytes_each = sizeof(float) * (3 + 3 + 4 + 1 + stride);
  // More Gaussians than any memory holds, so that their bytes can be counted.
  constexpr std::uint64_t kMany = std::uint64_t{1} << 40;
  const std::uint64_t bytes = std::min<std::uint64_t>(count, kMany) * bytes_each;
  const std::uint64_t available = available_memory_for(bytes);
  if (bytes > available) {
    throw_input(file, fmt::format("{} Gaussians need more than the {} MB of memory that are free",
                                  count, available >> 20));
  }
  cloud.resize(count);
}

void finish_gaussians(GaussianCloud& cloud, const std::string& file) {
  if (cloud.size() == 0) throw_input(file, "holds no Gaussians");
  Array<std::uint8_t> usable(cloud.size());
  parallel_each(cloud.size(), kGaussianGrain,
                [&](std::size_t i) { usable[i] = make_usable(cloud, i) ? 1 : 0; });
  const auto bad = static_cast<std::size_t>(std::count(usable.begin(), usable.end(), 0));
  if (bad == 0) return;
  if (bad == cloud.size()) {
    throw_input(file, fmt::format("none of its {} Gaussians can be drawn: positions, scales, "
                                  "opacities, rotations or colours are not finite",
                                  bad));
  }
  compact(cloud, usable);
  cloud.unusable_skipped += bad;
}

}  // namespace surfel
