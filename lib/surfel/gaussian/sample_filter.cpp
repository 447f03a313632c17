#include <algorithm>
#include <array>
#include <cmath>

#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/gaussian/sample_filter.h>

namespace surfel {
namespace {

constexpr std::size_t kColors = 4;  ///< R G B A.

/// The taps of a pixel's filter that are within a picture.
struct Taps {
  int begin, end;  ///< Samples.
  int weight;      ///< Number of the first one's weight.

  Taps(int pixel, int samples, int reach, int size)
      : begin(std::max(0, pixel * samples - reach)),
        end(std::min(size, (pixel + 1) * samples + reach)),
        weight(begin - (pixel * samples - reach)) {}
};

}  // namespace

SampleFilter::SampleFilter(int samples, double deviation) : samples_(samples) {
  constexpr double kFilterReach = 3;  // Standard deviations, beyond which 0.3 % of the filter lie.
  reach_ = static_cast<int>(std::ceil(std::max(0.0, kFilterReach * deviation - 0.5) * samples));
  for (int i = -reach_; i < samples + reach_; ++i) {
    const double from_center = ((i + 0.5) / samples - 0.5) / deviation;
    weight_.push_back(portable::exp(static_cast<float>(-from_center * from_center / 2)));
  }
}

void SampleFilter::write_row(const SampleRows& from, int y, const GaussianOutput& out,
                             std::vector<float>& columns) const {
  const auto channels = static_cast<std::size_t>(from.channels);
  const auto width = static_cast<std::size_t>(from.width);
  columns.assign(kColors * width, 0);
  const Taps down(y, samples_, reach_, from.height);
  float total = 0;
  for (int sample = down.begin; sample < down.end; ++sample) {
    const float weight = weight_[static_cast<std::size_t>(down.weight + sample - down.begin)];
    const float* row = from.row(sample);
    total += weight;
    for (std::size_t x = 0; x < width; ++x) {
      for (std::size_t c = 0; c < kColors; ++c) {
        columns[kColors * x + c] += weight * row[channels * x + c];
      }
    }
  }
  for (int x = 0; x < out.width; ++x) {
    const Taps across(x, samples_, reach_, from.width);
    std::array<float, kColors> sum{};
    float weights = 0;
    for (int sample = across.begin; sample < across.end; ++sample) {
      const float weight = weight_[static_cast<std::size_t>(across.weight + sample - across.begin)];
      const float* column = columns.data() + kColors * static_cast<std::size_t>(sample);
      weights += weight;
      for (std::size_t c = 0; c < kColors; ++c) sum[c] += weight * column[c];
    }
    for (float& value : sum) value /= weights * total;
    float* to = out.pixels + (static_cast<std::size_t>(y) * static_cast<std::size_t>(out.width) +
                              static_cast<std::size_t>(x)) *
                                 channels;
    write_color(sum.data(), out, to);
    if (channels > kColors) write_depths(from, x, y, to + kColors);
  }
}

void SampleFilter::write_color(const float* sum, const GaussianOutput& out, float* to) const {
  const float left = 1 - sum[3];
  const float alpha = sum[3] + left * out.background[3];
  for (std::size_t c = 0; c < 3; ++c) {
    to[c] = sum[c] + left * out.background[c];
    if (!out.display) to[c] = alpha > 0 ? srgb_to_linear(to[c] / alpha) * alpha : 0;
  }
  to[3] = alpha;
}

void SampleFilter::write_depths(const SampleRows& from, int x, int y, float* to) const {
  std::array<float, std::size_t{kMostSamples} * kMostSamples> depth;
  std::size_t count = 0;
  float sum = 0;
  float alpha = 0;
  for (int j = 0; j < samples_; ++j) {
    const float* row = from.row(y * samples_ + j);
    for (int i = 0; i < samples_; ++i) {
      const float* sample = row + static_cast<std::size_t>(x * samples_ + i) *
                                      static_cast<std::size_t>(from.channels);
      depth[count++] = sample[4];
      if (!(sample[3] > 0)) continue;
      sum += sample[3] * sample[5];
      alpha += sample[3];
    }
  }
  float* const middle = depth.data() + (count - 1) / 2;
  std::nth_element(depth.data(), middle, depth.data() + count);
  to[0] = *middle;
  to[1] = alpha > 0 ? sum / alpha : __builtin_inff();
}

}  // namespace surfel
