#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/truth/supersample.h>

namespace surfel {
namespace {

/// Rows of samples, filtered along x, that are kept at once; bytes. One row is always kept.
constexpr std::size_t kRowsBytes = std::size_t{1} << 26;
/// Where the Gaussian ends, standard deviations.
constexpr double kFilterReach = 4;

/// The pixel filter along one axis. Samples are numbered from the picture's edge on, sample s at
/// coordinate (s + 1/2) / n; pixel p sees the samples n p - margin .. n p + n + margin - 1.
struct FilterTaps {
  int n;       ///< Samples per pixel.
  int margin;  ///< Samples beyond the pixel's own on either side; negative if the filter is narrow.
  std::vector<double> weight;  ///< n + 2 margin, sum 1.

  explicit FilterTaps(const SupersampleOptions& options) : n(options.samples), margin(0) {
    if (options.lowpass > 0) {
      // The last sample within reach of the pixel's centre; at least the nearest of them.
      margin = static_cast<int>(std::floor(n * (kFilterReach * options.lowpass - 0.5) + 0.5));
      margin = std::max(margin, -((n - 1) / 2));
    }
    double sum = 0;
    for (int i = 0; i < n + 2 * margin; ++i) {
      const double offset = (i - margin + 0.5) / n - 0.5;
      weight.push_back(options.lowpass > 0
                           ? portable::exp(-0.5 * portable::squared(offset / options.lowpass))
                           : 1);
      sum += weight.back();
    }
    for (double& w : weight) w /= sum;
  }

  /// Samples that some of `pixels` pixels see: first_sample() .. end_sample(pixels) - 1.
  int first_sample() const { return -margin; }
  int end_sample(int pixels) const { return n * pixels + margin; }
  /// Pixels of 0 .. pixels - 1 that see one of the samples `first` .. `last`: [begin, end).
  int begin_pixel(int first) const { return std::max(0, floor_div(first - n - margin, n) + 1); }
  int end_pixel(int last, int pixels) const {
    return std::min(pixels, floor_div(last + margin, n) + 1);
  }
  double at(int pixel, int sample) const {
    return weight[static_cast<std::size_t>(sample - n * pixel + margin)];
  }

 private:
  static int floor_div(int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }
};

/// Traces one row of samples and adds each to the pixels that see it.
void trace_row(const Camera& camera, const FilterTaps& taps, int row,
               FunctionRef<Rgba(double x, double y, int worker)> trace, int worker,
               Eigen::Array4d* out) {
  std::fill_n(out, camera.width, Eigen::Array4d::Zero());
  const double y = (row + 0.5) / taps.n;
  for (int s = taps.first_sample(); s < taps.end_sample(camera.width); ++s) {
    const int begin = taps.begin_pixel(s);
    const int end = taps.end_pixel(s, camera.width);
    if (begin >= end) continue;
    const Rgba color = trace((s + 0.5) / taps.n, y, worker);
    const Eigen::Array4d value(color.red, color.green, color.blue, color.alpha);
    for (int x = begin; x < end; ++x) out[x] += taps.at(x, s) * value;
  }
}

}  // namespace

ViewRay view_ray(const Camera& camera, double x, double y) {
  const double px = (x - camera.center_x) / camera.focal_x;
  const double py = (y - camera.center_y) / camera.focal_y;
  const Eigen::Matrix3d world_from_camera = camera.camera_from_world.transpose();
  if (camera.orthographic) {
    return {world_from_camera * Vec3d(px, py, 0), world_from_camera * Vec3d(0, 0, 1)};
  }
  return {Vec3d(0, 0, 0), world_from_camera * Vec3d(px, py, 1)};
}

Image supersample(const Camera& camera, const SupersampleOptions& options,
                  FunctionRef<Rgba(double x, double y, int worker)> trace,
                  const std::function<void(double)>& progress) {
  if (options.samples < 1 || options.samples > 64) {
    throw_usage(fmt::format("`samples` is {}; it must be in 1..64", options.samples));
  }
  if (!(options.lowpass >= 0 && options.lowpass <= 16)) {
    throw_usage(fmt::format("`lowpass` is {}; it must be in 0..16 pixels", options.lowpass));
  }
  const FilterTaps taps(options);
  const auto width = static_cast<std::size_t>(camera.width);
  Image image = rgba_image(camera.width, camera.height);
  const RowRange drawn = camera.drawn_rows();
  std::fill(image.pixel(0, drawn.begin), image.pixel(0, drawn.end), 0.0F);

  // A band of sample rows at a time, whose height does not depend on the number of threads or on
  // the rows that are drawn: so does then the order of the sums.
  const int first_row = taps.first_sample();
  const int end_row = taps.end_sample(camera.height);
  const int band_rows =
      static_cast<int>(std::clamp<std::size_t>(kRowsBytes / (width * sizeof(Eigen::Array4d)), 1,
                                               static_cast<std::size_t>(end_row - first_row)));
  std::vector<Eigen::Array4d> rows(width * static_cast<std::size_t>(band_rows));
  const int first_seen = taps.n * drawn.begin - taps.margin;
  const int end_seen = taps.n * drawn.end + taps.margin;
  std::atomic<int> rows_done{0};
  for (int band = first_row; band < end_row; band += band_rows) {
    const int count = std::min(band_rows, end_row - band);
    const int begin = std::max(drawn.begin, taps.begin_pixel(band));
    const int end = std::min(drawn.end, taps.end_pixel(band + count - 1, camera.height));
    if (begin >= end) continue;
    const int from_row = std::max(band, first_seen);
    const int seen = std::min(band + count, end_seen) - from_row;
    parallel_for(static_cast<std::size_t>(seen), 1, [&](std::size_t i, std::size_t, int worker) {
      const int row = from_row + static_cast<int>(i);
      trace_row(camera, taps, row, trace, worker,
                rows.data() + static_cast<std::size_t>(row - band) * width);
      if (progress) progress(static_cast<double>(++rows_done) / (end_seen - first_seen));
    });
    parallel_for(static_cast<std::size_t>(end - begin), 1, [&](std::size_t i, std::size_t, int) {
      const int y = begin + static_cast<int>(i);
      const int from = std::max(band, taps.n * y - taps.margin);
      const int to = std::min(band + count, taps.n * y + taps.n + taps.margin);
      for (int x = 0; x < camera.width; ++x) {
        Eigen::Array4d sum = Eigen::Array4d::Zero();
        for (int row = from; row < to; ++row) {
          sum += taps.at(y, row) *
                 rows[static_cast<std::size_t>(row - band) * width + static_cast<std::size_t>(x)];
        }
        Eigen::Map<Eigen::Array4f>(image.pixel(x, y)) += sum.cast<float>();
      }
    });
  }
  return image;
}

void composite_over(Image& image, const RowRange& rows, const std::array<float, 4>& background) {
  const Rgba back{background[0] * background[3], background[1] * background[3],
                  background[2] * background[3], background[3]};
  for (int y = rows.begin; y < rows.end; ++y) {
    for (int x = 0; x < image.width; ++x) {
      float* pixel = image.pixel(x, y);
      Rgba color{pixel[0], pixel[1], pixel[2], pixel[3]};
      color.composite(back);
      pixel[0] = color.red;
      pixel[1] = color.green;
      pixel[2] = color.blue;
      pixel[3] = color.alpha;
    }
  }
}

}  // namespace surfel
