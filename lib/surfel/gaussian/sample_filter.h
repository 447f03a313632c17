#pragma once

#include <cstddef>
#include <vector>

#include <surfel/gaussian/gaussian_options.h>
#include <surfel/gaussian/gaussian_raster.h>

namespace surfel {

/// The last rows of a picture that has several samples a pixel along each axis: row y is at
/// y % rows.
struct SampleRows {
  std::vector<float> samples;  ///< Channels as the picture's, colours as displays take them.
  int width = 0;               ///< Samples in a row.
  int height = 0;              ///< Sample rows of the whole picture.
  int rows = 0;
  int channels = 0;

  const float* row(int y) const {
    return samples.data() + static_cast<std::size_t>(y % rows) * static_cast<std::size_t>(width) *
                                static_cast<std::size_t>(channels);
  }
};

/// A Gaussian pixel filter over samples.
class SampleFilter {
 public:
  /// \param samples    in a pixel along each axis.
  /// \param deviation  pixels, > 0.
  SampleFilter(int samples, double deviation);

  /// Sample rows before a pixel's first one, and after its last one, that its filter reaches.
  int reach() const { return reach_; }
  /// Writes row y of the picture. Of the depths, which are not filtered, Z is the median of the
  /// pixel's own samples, the nearer one of two, and Z.mean their mean by alpha.
  /// \param columns  room that a worker keeps between rows.
  void write_row(const SampleRows& from, int y, const GaussianOutput& out,
                 std::vector<float>& columns) const;

 private:
  void write_color(const float* sum, const GaussianOutput& out, float* to) const;
  void write_depths(const SampleRows& from, int x, int y, float* to) const;

  int samples_;
  int reach_;
  std::vector<float> weight_;  ///< Of the samples from -reach to samples + reach - 1.
};

}  // namespace surfel
