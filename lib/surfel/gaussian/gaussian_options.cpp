#include <surfel/base/option_check.h>
#include <surfel/gaussian/gaussian_options.h>

namespace surfel {

std::vector<std::string> GaussianOptions::problems() const {
  std::vector<std::string> out;
  check_option(out, lowpass >= 0.1 && lowpass <= 16, "lowpass", lowpass, "in 0.1..16 pixels");
  check_option(out, samples >= 0 && samples <= kMostSamples, "samples", samples, "in 0..4");
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
