#include <fmt/format.h>
#include <surfel/base/option_check.h>
#include <surfel/gaussian/gaussian_options.h>

namespace surfel {

std::vector<std::string> GaussianOptions::problems() const {
  std::vector<std::string> out;
  check_positive(out, "lowpass", lowpass);
  if (samples < 0 || samples > kMostSamples) {
    out.push_back(fmt::format("`samples` must be in 0..{}", kMostSamples));
  }
  check_background(out, background);
  return out;
}

GaussianProfile profile_of(const GaussianCloud& cloud) {
  if (cloud.rule == AmplitudeRule::kDensity) return GaussianProfile::kExact;
  if (cloud.rule == AmplitudeRule::kSurfel) return GaussianProfile::kSurfel;
  switch (cloud.trained_with) {
    case TrainedWith::kMip:
      return GaussianProfile::kMip;
    case TrainedWith::k2dgs:
      return GaussianProfile::k2dgs;
    case TrainedWith::kInria:
    case TrainedWith::kUnknown:
      break;
  }
  return GaussianProfile::kInria;
}

}  // namespace surfel
