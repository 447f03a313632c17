#include <algorithm>
#include <atomic>
#include <cmath>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/texture_map.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 16;

/// Texels of the image, straight alpha, in four channels.
Array<float> four_channels(Image&& image) {
  const std::size_t channels = image.channels.size();
  const std::size_t texels = static_cast<std::size_t>(image.width) * image.height;
  if (image.width < 1 || image.height < 1 || channels < 3 ||
      image.data.size() < texels * channels) {
    throw Error(ErrorKind::kInput, "a texture needs at least one pixel with channels R, G and B");
  }
  if (channels == 4) return std::move(image.data);
  const bool alpha = channels > 4 && image.channels[3] == "A";
  Array<float> data(texels * 4);
  parallel_for(texels, kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const float* from = image.data.data() + i * channels;
      std::copy_n(from, 3, data.data() + i * 4);
      data[i * 4 + 3] = alpha ? from[3] : 1;
    }
  });
  return data;
}

/// Multiplies the colours by alpha, in place; true if some alpha is less than 1.
bool premultiply(Array<float>& data) {
  std::atomic<bool> has_alpha = false;
  parallel_for(data.size() / 4, kGrain, [&](std::size_t begin, std::size_t end, int) {
    bool found = false;
    for (std::size_t i = begin; i < end; ++i) {
      float* texel = data.data() + i * 4;
      for (int channel = 0; channel < 4; ++channel) {
        if (!std::isfinite(texel[channel])) texel[channel] = 0;
      }
      texel[3] = std::clamp(texel[3], 0.0F, 1.0F);
      if (texel[3] == 1) continue;
      found = true;
      for (int channel = 0; channel < 3; ++channel) texel[channel] *= texel[3];
    }
    if (found) has_alpha = true;
  });
  return has_alpha;
}

GaussianPyramid make_pyramid(Image&& image, WrapMode wrap, bool& has_alpha) {
  PyramidLevel level;
  level.x.count = image.width;
  level.y.count = image.height;
  level.texels = four_channels(std::move(image));
  has_alpha = premultiply(level.texels);
  return {std::move(level), wrap};
}

/// The colour of premultiplied sums, `weight` being what alpha = 1 would have summed to.
TextureSample straight(const Eigen::Array4d& sum, double weight) {
  TextureSample sample;
  sample.color = sum[3] > 0 ? Vec3f((sum.head<3>() / sum[3]).cast<float>()) : Vec3f::Zero();
  sample.alpha = std::clamp(static_cast<float>(sum[3] / weight), 0.0F, 1.0F);
  return sample;
}

/// The chart's box cut out of the wrapped image, times the coverage.
PyramidLevel masked(const TextureMap& map, const CoverageRaster& raster) {
  const PyramidLevel& image = map.pyramid().image();
  PyramidLevel level;
  level.x = {raster.first_x, raster.width, 1};
  level.y = {raster.first_y, raster.height, 1};
  level.texels.resize(raster.weight.size() * 4);
  std::vector<int> columns(static_cast<std::size_t>(raster.width));
  for (int x = 0; x < raster.width; ++x) {
    columns[x] = stored_offset(raster.first_x + x, image.x, map.pyramid().wrap());
  }
  parallel_for(raster.height, 64, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t y = begin; y < end; ++y) {
      const float* row = image.row(
          stored_offset(raster.first_y + static_cast<int>(y), image.y, map.pyramid().wrap()));
      const float* weight = raster.weight.data() + y * raster.width;
      float* out = level.texels.data() + y * raster.width * 4;
      for (int x = 0; x < raster.width; ++x, out += 4) {
        for (int c = 0; c < 4; ++c) out[c] = weight[x] * row[columns[x] * 4 + c];
      }
    }
  });
  return level;
}

/// The coverage alone, as every channel of a level.
PyramidLevel coverage_level(const CoverageRaster& raster) {
  PyramidLevel level;
  level.x = {raster.first_x, raster.width, 1};
  level.y = {raster.first_y, raster.height, 1};
  level.texels.resize(raster.weight.size() * 4);
  for (std::size_t i = 0; i < raster.weight.size(); ++i) {
    std::fill_n(level.texels.data() + i * 4, 4, raster.weight[i]);
  }
  return level;
}

}  // namespace

TextureMap::TextureMap(Image image, WrapMode wrap)
    : pyramid_(make_pyramid(std::move(image), wrap, has_alpha_)) {}

TextureMap TextureMap::constant(const Vec3f& color) {
  Image image;
  image.width = image.height = 1;
  image.channels = {"R", "G", "B", "A"};
  image.data = {color.x(), color.y(), color.z(), 1.0F};
  return {std::move(image), WrapMode::kRepeat};
}

TextureSample TextureMap::sample(const TexelKernel& kernel, int max_level) const {
  const GaussianPyramid::Sum sum = pyramid_.filter(kernel, max_level);
  // Opaque images: the weight is the sum of the alphas, rounded as the colours are.
  return straight(sum.texels, has_alpha_ ? sum.kernel : sum.texels[3]);
}

TextureSample TextureMap::mean() const {
  const Array<float>& texels = pyramid_.image().texels;
  Eigen::Array4d sum = Eigen::Array4d::Zero();
  for (std::size_t i = 0; i < texels.size(); i += 4) {
    sum += Eigen::Map<const Eigen::Array4f>(texels.data() + i).cast<double>();
  }
  return straight(sum, static_cast<double>(texels.size()) / 4);
}

ChartTexture::ChartTexture(const TextureMap& map, const CoverageRaster& raster)
    : pyramid_(masked(map, raster), WrapMode::kNothing) {
  if (map.has_alpha()) coverage_.emplace(coverage_level(raster), WrapMode::kNothing);
}

void ChartTexture::build(int level) {
  pyramid_.build(level);
  if (coverage_) coverage_->build(level);
}

std::optional<TextureSample> ChartTexture::sample(const TexelKernel& kernel, int max_level) const {
  const Eigen::Array4d sum = pyramid_.filter(kernel, max_level).texels;
  const double covered = coverage_ ? coverage_->filter(kernel, max_level).texels[3] : sum[3];
  if (!(covered > 0)) return std::nullopt;
  return straight(sum, covered);
}

}  // namespace surfel
