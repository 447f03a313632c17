#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/io/image_io.h>
#include <surfel/texture/texture_map.h>

namespace surfel {
namespace {

constexpr std::size_t kTexelGrain = 1 << 16;
/// Texels of a file, and of a chart, that are worked on together.
constexpr int kBandTexels = 1 << 19;
constexpr int kChartBandTexels = 1 << 21;

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
  parallel_for(texels, kTexelGrain, [&](std::size_t begin, std::size_t end, int) {
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
  parallel_for(data.size() / 4, kTexelGrain, [&](std::size_t begin, std::size_t end, int) {
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

/// Highest bit that is set; -1 where none is.
int highest(std::uint32_t bits) { return static_cast<int>(std::bit_width(bits)) - 1; }

/// The level of a file's image before anything is loaded.
PyramidLevel unloaded_level(const ImageReader& reader, std::shared_ptr<const TexelTiles> tiles) {
  PyramidLevel level;
  level.x.count = reader.layout().width;
  level.y.count = reader.layout().height;
  level.tiles = std::move(tiles);
  return level;
}

/// Tiles that hold texels [begin, end) of an axis.
std::vector<int> tiles_between(int begin, int end, int count, WrapMode wrap) {
  const TexelAxis axis{0, count, 1};
  const int last_tile = (count - 1) / TexelTiles::kSize;
  std::vector<int> tiles;
  if (begin >= 0 && end <= count) {
    tiles.resize(
        static_cast<std::size_t>((end - 1) / TexelTiles::kSize - begin / TexelTiles::kSize + 1));
    std::iota(tiles.begin(), tiles.end(), begin / TexelTiles::kSize);
  } else if (std::int64_t{end} - begin >= count) {
    tiles.resize(static_cast<std::size_t>(last_tile) + 1);
    std::iota(tiles.begin(), tiles.end(), 0);
  } else {
    for (int i = begin; i < end; ++i) {
      const int tile = stored_offset(i, axis, wrap) / TexelTiles::kSize;
      if (tiles.empty() || tiles.back() != tile) tiles.push_back(tile);
    }
  }
  return tiles;
}

/// Goes through an image's pixels in bands of rows.
class BandReader {
 public:
  explicit BandReader(ImageReader& reader) : reader_(reader) {
    const ImageReader::Layout& layout = reader.layout();
    const int piece = layout.piece_height;
    height_ = std::max(1, kBandTexels / layout.width / piece) * piece;
  }

  /// Rows of every band except the last.
  int height() const { return height_; }

  void read(const ImageReader::Box& box) {
    box_ = box;
    is_decoded_ = !reader_.layout().coded;
    if (is_decoded_) {
      texels_.resize(box.pixels() * 4);
      reader_.read(box, texels_.data());
      has_alpha_ = premultiply(texels_);
      return;
    }
    coded_.resize(box.pixels() * 4);
    reader_.read(box, coded_.data());
    has_alpha_ = reader_.layout().alpha && is_transparent();
  }

  bool has_alpha() const { return has_alpha_; }

  /// As TexelTiles takes them.
  const std::byte* stored_row(int y) const {
    const std::size_t first = (y - box_.y_begin) * box_.width() * 4;
    return reader_.layout().coded ? reinterpret_cast<const std::byte*>(coded_.data() + first)
                                  : reinterpret_cast<const std::byte*>(texels_.data() + first);
  }

  /// Premultiplied.
  const Array<float>& texels() {
    if (!is_decoded_) {
      texels_.resize(coded_.size());
      const TexelDecoder decode;
      parallel_for(box_.pixels(), kTexelGrain, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t i = begin; i < end; ++i) {
          Eigen::Map<Eigen::Array4f>(texels_.data() + i * 4) = decode(coded_.data() + i * 4);
        }
      });
      is_decoded_ = true;
    }
    return texels_;
  }

 private:
  bool is_transparent() const {
    for (std::size_t i = 3; i < coded_.size(); i += 4) {
      if (coded_[i] != std::numeric_limits<std::uint8_t>::max()) return true;
    }
    return false;
  }

  ImageReader& reader_;
  int height_;
  ImageReader::Box box_{0, 0, 0, 0};
  Array<std::uint8_t> coded_;
  Array<float> texels_;
  bool is_decoded_ = false;
  bool has_alpha_ = false;
};

/// Columns of wanted tiles in these rows; empty where there are none.
std::pair<int, int> wanted_columns(const TexelTiles& tiles, int y_begin, int y_end, int width) {
  int first = width;
  int last = 0;
  for (int row = y_begin / TexelTiles::kSize; row <= (y_end - 1) / TexelTiles::kSize; ++row) {
    for (int column = 0; column < tiles.columns(); ++column) {
      if (!tiles.is_wanted(column, row)) continue;
      first = std::min(first, column * TexelTiles::kSize);
      last = std::max(last, std::min(width, (column + 1) * TexelTiles::kSize));
    }
  }
  return {first, last};
}

/// A level on the raster's texels, which has none yet.
PyramidLevel level_on(const CoverageRaster& raster) {
  return {{raster.first_x, raster.width, 1}, {raster.first_y, raster.height, 1}};
}

/// Covers texels that repeat one of the chart's: where a chart is as wide as the image, the lookup
/// at its border finds its other side.
void cover_repeated(int width, int height, CoverageRaster& raster) {
  if (raster.width <= width && raster.height <= height) return;
  const Array<float> chart = raster.weight;
  const auto covered = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < raster.width && y < raster.height &&
           chart[static_cast<std::size_t>(y) * raster.width + x] == 1;
  };
  for (int y = 0; y < raster.height; ++y) {
    for (int x = 0; x < raster.width; ++x) {
      for (const int v : {y - height, y, y + height}) {
        if (covered(x - width, v) || covered(x, v) || covered(x + width, v)) {
          raster.weight[static_cast<std::size_t>(y) * raster.width + x] = 1;
        }
      }
    }
  }
}

/// A box cut out of the wrapped image, times the coverage.
PyramidLevel masked(const TextureMap& map, const CoverageRaster& raster) {
  const PyramidLevel& image = map.pyramid().image();
  PyramidLevel level = level_on(raster);
  level.texels.resize(raster.weight.size() * 4);
  std::vector<int> columns(static_cast<std::size_t>(raster.width));
  for (int x = 0; x < raster.width; ++x) {
    columns[x] = stored_offset(raster.first_x + x, image.x, map.pyramid().wrap());
  }
  parallel_for(raster.height, 64, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t y = begin; y < end; ++y) {
      const int row =
          stored_offset(raster.first_y + static_cast<int>(y), image.y, map.pyramid().wrap());
      const float* weight = raster.weight.data() + y * raster.width;
      float* out = level.texels.data() + y * raster.width * 4;
      for (int x = 0; x < raster.width; ++x, out += 4) {
        Eigen::Map<Eigen::Array4f> texel(out);
        if (weight[x] > 0) {
          texel = weight[x] * image.texel(columns[x], row);
        } else {
          texel.setZero();
        }
      }
    }
  });
  return level;
}

/// The coverage alone, as every channel of a level.
PyramidLevel coverage_level(const CoverageRaster& raster) {
  PyramidLevel level = level_on(raster);
  level.texels.resize(raster.weight.size() * 4);
  for (std::size_t i = 0; i < raster.weight.size(); ++i) {
    std::fill_n(level.texels.data() + i * 4, 4, raster.weight[i]);
  }
  return level;
}

/// Rows of a level that are part of a larger array of rows, which starts at `first`.
std::vector<TexelRow> rows_of(const PyramidLevel& level, int first) {
  std::vector<TexelRow> rows;
  for (int y = 0; y < level.y.count; ++y) rows.push_back({level.y.first + y - first, level.row(y)});
  return rows;
}

}  // namespace

TextureMap::TextureMap(Image image, WrapMode wrap)
    : pyramid_(make_pyramid(std::move(image), wrap, has_alpha_)) {}

TextureMap::TextureMap(std::shared_ptr<ImageReader> reader, WrapMode wrap)
    : reader_(std::move(reader)),
      tiles_(std::make_shared<TexelTiles>(reader_->layout().width, reader_->layout().height,
                                          reader_->layout().coded)),
      pyramid_(unloaded_level(*reader_, tiles_), wrap) {
  if (width() == 1 && height() == 1) tiles_->want(0, 0);  // There are no coarser levels.
}

TextureMap TextureMap::constant(const Vec3f& color, float alpha) {
  Image image = rgba_image(1, 1);
  image.data = {color.x(), color.y(), color.z(), alpha};
  return {std::move(image), WrapMode::kRepeat};
}

void TextureMap::request(const TexelKernel& kernel, int max_level) {
  const int level =
      std::min(GaussianPyramid::level_for(principal_variances(kernel.variance).minor), max_level);
  const std::uint32_t bit = std::uint32_t{1} << level;
  std::atomic_ref levels(requested_levels_);
  if (!(levels.load(std::memory_order_relaxed) & bit)) levels.fetch_or(bit);
  if (level == 0 && reader_) request(pyramid_.reach(kernel));
}

void TextureMap::request(const GaussianPyramid::Box& texels) {
  if (!reader_) return;
  const std::vector<int> columns =
      tiles_between(texels.x_begin, texels.x_end, width(), pyramid_.wrap());
  for (const int row : tiles_between(texels.y_begin, texels.y_end, height(), pyramid_.wrap())) {
    for (const int column : columns) tiles_->want(column, row);
  }
}

void TextureMap::load() {
  if (!reader_) {
    pyramid_.build(highest(requested_levels_));
    return;
  }
  const std::uint32_t coarser = requested_levels_ & ~std::uint32_t{1};
  const PyramidLevel image = pyramid_.image();
  PyramidStream stream(image.x, image.y, pyramid_.wrap(),
                       {std::countr_zero(coarser), highest(coarser)});
  check_memory(stream);
  read_file(stream, coarser != 0);
  pyramid_ = GaussianPyramid(image, stream.take(), pyramid_.wrap());
}

void TextureMap::check_memory(const PyramidStream& stream) const {
  const double bytes = static_cast<double>(tiles_->wanted_bytes()) + stream.bytes();
  if (bytes > static_cast<double>(available_memory_bytes())) {
    throw_input(reader_->layout().name,
                fmt::format("{:.0f} MB of its {} x {} pixels are needed, which do not fit into "
                            "memory",
                            bytes / 1e6, width(), height()));
  }
}

/// \param levels  the stream makes some, so that it needs the whole image.
void TextureMap::read_file(PyramidStream& stream, bool levels) {
  // Whether a file with an alpha channel is transparent shows at its last pixel.
  const bool whole = levels || reader_->layout().alpha;
  BandReader band(*reader_);
  std::vector<TexelRow> rows;
  for (int begin = 0; begin < height(); begin += band.height()) {
    const int end = std::min(height(), begin + band.height());
    const auto [first, last] =
        whole ? std::pair(0, width()) : wanted_columns(*tiles_, begin, end, width());
    if (first >= last) continue;
    band.read({first, last, begin, end});
    if (band.has_alpha()) has_alpha_ = true;
    for (int y = begin; y < end; ++y) tiles_->store(y, first, last, band.stored_row(y));
    if (!levels) continue;
    rows.clear();
    const float* texels = band.texels().data();
    for (int y = begin; y < end; ++y, texels += static_cast<std::ptrdiff_t>(width()) * 4) {
      rows.push_back({y, texels});
    }
    stream.add(rows);
  }
}

TextureSample TextureMap::sample(const TexelKernel& kernel, int max_level) const {
  const GaussianPyramid::Sum sum = pyramid_.filter(kernel, max_level);
  // Opaque images: the weight is the sum of the alphas, rounded as the colours are.
  return straight(sum.texels, has_alpha_ ? sum.kernel : sum.texels[3]);
}

TextureSample TextureMap::mean() const {
  Eigen::Array4d sum = Eigen::Array4d::Zero();
  const auto add = [&](const Array<float>& texels) {
    for (std::size_t i = 0; i < texels.size(); i += 4) {
      sum += Eigen::Map<const Eigen::Array4f>(texels.data() + i).cast<double>();
    }
  };
  if (reader_) {
    BandReader band(*reader_);
    for (int begin = 0; begin < height(); begin += band.height()) {
      band.read({0, width(), begin, std::min(height(), begin + band.height())});
      add(band.texels());
    }
  } else {
    add(pyramid_.image().texels);
  }
  return straight(sum, static_cast<double>(width()) * height());
}

ChartTexture::ChartTexture(const TextureMap& map, const std::vector<UvCharts::Triangle>& triangles,
                           const CoverageRaster& box, const LevelRange& levels) {
  constexpr WrapMode kWrap = WrapMode::kNothing;
  CoverageRaster band = box;
  if (levels.finest == 0) {
    rasterize_coverage(triangles, map.width(), map.height(), band);
    if (map.pyramid().wrap() == WrapMode::kRepeat) {
      cover_repeated(map.width(), map.height(), band);
    }
    pyramid_.emplace(masked(map, band), kWrap).build(levels.coarsest);
    if (map.has_alpha()) coverage_.emplace(coverage_level(band), kWrap).build(levels.coarsest);
    return;
  }
  const PyramidLevel level = level_on(box);
  PyramidStream texels(level.x, level.y, kWrap, levels);
  PyramidStream coverage(level.x, level.y, kWrap, levels);
  const int band_height = std::max(1, kChartBandTexels / box.width);
  for (int y = 0; y < box.height; y += band_height) {
    band.first_y = box.first_y + y;
    band.height = std::min(band_height, box.height - y);
    rasterize_coverage(triangles, map.width(), map.height(), band);
    const PyramidLevel part = masked(map, band);
    texels.add(rows_of(part, box.first_y));
    if (!map.has_alpha()) continue;
    const PyramidLevel covered = coverage_level(band);
    coverage.add(rows_of(covered, box.first_y));
  }
  pyramid_.emplace(level, texels.take(), kWrap);
  if (map.has_alpha()) coverage_.emplace(level, coverage.take(), kWrap);
}

std::optional<TextureSample> ChartTexture::sample(const TexelKernel& kernel, int max_level) const {
  const Eigen::Array4d sum = pyramid_->filter(kernel, max_level).texels;
  const double covered = coverage_ ? coverage_->filter(kernel, max_level).texels[3] : sum[3];
  if (!(covered > 0)) return std::nullopt;
  return straight(sum, covered);
}

}  // namespace surfel
