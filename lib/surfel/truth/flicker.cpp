#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/truth/flicker.h>

namespace surfel {
namespace {

/// R G B of all pixels as a viewer sees them.
std::vector<float> encoded(const Image& image) {
  std::array<std::size_t, 3> channel{};
  for (std::size_t c = 0; c < 3; ++c) {
    const auto found =
        std::find(image.channels.begin(), image.channels.end(), std::string(1, "RGB"[c]));
    if (found == image.channels.end()) throw_input("", "a frame has no R G B");
    channel[c] = static_cast<std::size_t>(found - image.channels.begin());
  }
  std::vector<float> values;
  values.reserve(3 * image.data.size() / image.channels.size());
  for (std::size_t p = 0; p < image.data.size(); p += image.channels.size()) {
    for (const std::size_t c : channel) {
      values.push_back(linear_to_srgb(std::clamp(image.data[p + c], 0.0F, 1.0F)));
    }
  }
  return values;
}

/// A sentence on a frame that is not usable.
std::vector<float> error_of(const Image& tested, const Image& truth) {
  if (tested.width != truth.width || tested.height != truth.height) {
    throw_input("", fmt::format("frames are of {}x{} and {}x{} pixels; they must be of one size",
                                tested.width, tested.height, truth.width, truth.height));
  }
  std::vector<float> error = encoded(tested);
  const std::vector<float> expected = encoded(truth);
  for (std::size_t i = 0; i < error.size(); ++i) error[i] -= expected[i];
  return error;
}

}  // namespace

double flicker(const std::vector<Image>& tested, const std::vector<Image>& truth) {
  if (tested.size() < 2 || tested.size() != truth.size()) {
    throw_input("", fmt::format("{} frames beside {} of the truth; flicker needs as many, two at "
                                "least",
                                tested.size(), truth.size()));
  }
  // (P' - P) - (T' - T) = (P' - T') - (P - T): the change of the error.
  std::vector<float> last = error_of(tested.front(), truth.front());
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t frame = 1; frame < tested.size(); ++frame) {
    std::vector<float> error = error_of(tested[frame], truth[frame]);
    if (error.size() != last.size()) throw_input("", "the frames are of different sizes");
    for (std::size_t i = 0; i < error.size(); ++i) {
      const double change = static_cast<double>(error[i]) - static_cast<double>(last[i]);
      sum += change * change;
    }
    count += error.size();
    last = std::move(error);
  }
  return std::sqrt(sum / static_cast<double>(count));
}

}  // namespace surfel
