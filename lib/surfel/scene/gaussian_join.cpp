#include <algorithm>
#include <cstddef>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/bounds.h>
#include <surfel/base/error.h>
#include <surfel/scene/gaussian_join.h>

namespace surfel {
namespace {

const char* meaning(AmplitudeRule rule) {
  switch (rule) {
    case AmplitudeRule::kSurfel:
      return "samples of surfaces";
    case AmplitudeRule::kCompensated:
      return "compensated opacities";
    case AmplitudeRule::kDensity:
      return "densities";
    case AmplitudeRule::kOpacity:
      break;
  }
  return "opacities";
}

/// Appends the harmonics of a cloud to columns of at least its degree.
void append_harmonics(const GaussianCloud& cloud, GaussianCloud& out) {
  const std::size_t from = cloud.harmonics_stride();
  const std::size_t to = out.harmonics_stride();
  const std::size_t begin = out.harmonics.size();
  out.harmonics.resize(begin + cloud.size() * to);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    float* const at = out.harmonics.data() + begin + i * to;
    std::copy_n(cloud.harmonics.data() + i * from, from, at);
    std::fill(at + from, at + to, 0.0F);
  }
}

}  // namespace

GaussianCloud join_gaussians(std::vector<GaussianCloud> clouds,
                             std::span<const std::string> names) {
  if (clouds.empty()) throw_input("", "there are no Gaussians to join");
  if (clouds.size() == 1) return std::move(clouds.front());
  const GaussianCloud& first = clouds.front();
  GaussianCloud out;
  out.rule = first.rule;
  out.trained_with = first.trained_with;
  out.up = first.up;
  Bounds box;
  std::size_t total = 0;
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    const GaussianCloud& cloud = clouds[k];
    if (cloud.rule != first.rule) {
      throw_input(names[k], fmt::format("has {}, {} has {}; they are not drawn together",
                                        meaning(cloud.rule), names[0], meaning(first.rule)));
    }
    if (cloud.trained_with != first.trained_with) out.trained_with = TrainedWith::kUnknown;
    if (cloud.up != first.up) out.up.reset();
    out.degree = std::max(out.degree, cloud.degree);
    out.unusable_skipped += cloud.unusable_skipped;
    out.coarser_skipped += cloud.coarser_skipped;
    total += cloud.size();
    for (const Vec3f& p : cloud.position) box.add(cloud.origin + p.cast<double>());
  }
  out.origin = float_origin(box);
  out.position.reserve(total);
  out.harmonics.reserve(total * out.harmonics_stride());
  for (const GaussianCloud& cloud : clouds) {
    const Vec3d shift = cloud.origin - out.origin;
    for (const Vec3f& p : cloud.position) {
      out.position.push_back((shift + p.cast<double>()).cast<float>());
    }
    out.scale.insert(out.scale.end(), cloud.scale.begin(), cloud.scale.end());
    out.rotation.insert(out.rotation.end(), cloud.rotation.begin(), cloud.rotation.end());
    out.amplitude.insert(out.amplitude.end(), cloud.amplitude.begin(), cloud.amplitude.end());
    append_harmonics(cloud, out);
  }
  return out;
}

}  // namespace surfel
