#include <numbers>
#include <set>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/texture/texture_map.h>

#include "support/test_data.h"
#include "texture_support.h"

namespace surfel {
namespace {

using test::brute_force;
using test::difference;
using test::make_image;
using test::noise_image;
using test::turned_kernel;

constexpr WrapMode kWraps[] = {WrapMode::kRepeat, WrapMode::kMirror, WrapMode::kClamp};

/// A map with all levels that the kernel asks for.
TextureSample filtered(const Image& image, WrapMode wrap, const TexelKernel& kernel) {
  TextureMap map(image, wrap);
  map.request(kernel);
  map.load();
  return map.sample(kernel);
}

TEST(TextureMap, ConstantImageStaysConstantAtEveryLevelAndPlace) {
  const Image image = make_image(37, 53, [](int, int) { return Eigen::Vector4f(0.3F, 2, 0, 1); });
  for (const WrapMode wrap : kWraps) {
    for (const double sigma : {0.5, 1.0, 3.0, 11.0, 60.0, 5000.0}) {
      for (const Vec2d& center : {Vec2d(18, 20), Vec2d(0, 53), Vec2d(-4000, 1e9)}) {
        const TextureSample sample =
            filtered(image, wrap, turned_kernel(center, 3 * sigma, sigma, 1));
        EXPECT_NEAR(sample.color.x(), 0.3, 3e-6);
        EXPECT_NEAR(sample.color.y(), 2, 2e-5);
        EXPECT_EQ(sample.color.z(), 0);
        EXPECT_EQ(sample.alpha, 1);
      }
    }
  }
}

TEST(TextureMap, LinearRampGivesTheValueAtTheCentre) {
  // Far enough from the borders, at several levels.
  const Image image = make_image(400, 300, [](int x, int y) {
    return Eigen::Vector4f(static_cast<float>(x + 0.5) / 400, static_cast<float>(y + 0.5) / 300, 0,
                           1);
  });
  for (const double sigma : {1.0, 4.0, 9.0, 20.0}) {
    const Vec2d center(201.3, 148.6);
    const TextureSample sample =
        filtered(image, WrapMode::kClamp, turned_kernel(center, 1.4 * sigma, sigma, 0.4));
    EXPECT_NEAR(sample.color.x(), center.x() / 400, 2e-5) << sigma;
    EXPECT_NEAR(sample.color.y(), center.y() / 300, 2e-5) << sigma;
  }
}

TEST(TextureMap, OneBrightTexelGivesTheGaussianItself) {
  const Image image = make_image(64, 64, [](int x, int y) {
    return Eigen::Vector4f(x == 30 && y == 33 ? 1.0F : 0.0F, 0, 0, 1);
  });
  const TextureMap map(image, WrapMode::kRepeat);
  for (const double aspect : {1.0, 2.5}) {
    for (const double angle : {0.0, 0.7, 2.1}) {
      for (int step = 0; step < 60; ++step) {
        const Vec2d offset(0.37 + 0.11 * step, 2.9 - 0.17 * step);
        const TexelKernel kernel = turned_kernel(Vec2d(30.5, 33.5) + offset, aspect, 1, angle);
        const double peak = 1 / (2 * std::numbers::pi * aspect);
        const double exact = peak * std::exp(-offset.dot(kernel.variance.inverse() * offset) / 2);
        EXPECT_NEAR(map.sample(kernel).color.x(), exact, 1e-4 * peak);
      }
    }
  }
}

TEST(TextureMap, AgreesWithTheDoubleSumInsideAndAcrossBordersForEveryWrap) {
  for (const bool alpha : {false, true}) {
    const Image image = noise_image(41, 27, 7, alpha);
    for (const WrapMode wrap : kWraps) {
      for (const Vec2d& center :
           {Vec2d(20, 13), Vec2d(0.2, 0.1), Vec2d(40.9, 13), Vec2d(41, 27), Vec2d(-95.3, 260.4)}) {
        const TexelKernel kernel = turned_kernel(center, 2.1, 1.2, 0.6);
        EXPECT_LT(difference(filtered(image, wrap, kernel), brute_force(image, wrap, kernel)), 1e-4)
            << center.transpose();
      }
    }
  }
}

TEST(TextureMap, PyramidAgreesWithTheDoubleSum) {
  // White noise and a checkerboard whose period beats with the levels' pitch.
  const Image images[] = {noise_image(256, 256, 3), noise_image(201, 117, 4, true),
                          make_image(190, 190, [](int x, int y) {
                            const float value = (x / 19 + y / 19) % 2 ? 1.0F : 0.0F;
                            return Eigen::Vector4f(value, 1 - value, value, 1);
                          })};
  double worst = 0;
  double sum = 0;
  int count = 0;
  for (const Image& image : images) {
    for (const WrapMode wrap : kWraps) {
      for (const double sigma : {2.3, 2.4, 4.0, 4.8, 7.0, 13.0, 27.0}) {
        for (const double aspect : {1.0, 3.0}) {
          for (const Vec2d& center : {Vec2d(0.5, 0.45), Vec2d(0.03, 0.99), Vec2d(1.2, -0.1)}) {
            const TexelKernel kernel =
                turned_kernel(center.cwiseProduct(Vec2d(image.width, image.height)), aspect * sigma,
                              sigma, 0.3 + sigma);
            const double error =
                difference(filtered(image, wrap, kernel), brute_force(image, wrap, kernel));
            worst = std::max(worst, error);
            sum += error;
            ++count;
          }
        }
      }
    }
  }
  RecordProperty("worst", std::to_string(worst));
  RecordProperty("mean", std::to_string(sum / count));
  EXPECT_LT(worst, 2e-3);
  EXPECT_LT(sum / count, 2e-4);
}

TEST(TextureMap, WorstSineWavesStayWithinTheBoundOfTheHeader) {
  // Waves near a level's sampling frequency, seen by the narrowest kernel that the level gets.
  double worst = 0;
  for (const int level : {1, 2, 3}) {
    const double pitch = 1 << level;
    for (const double frequency : {0.3, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 1.0}) {
      const Image image = make_image(256, 4, [&](int x, int) {
        const double phase = 2 * std::numbers::pi * frequency * (x + 0.5) / pitch;
        return Eigen::Vector4f(static_cast<float>(0.5 + 0.5 * std::cos(phase)), 0, 0, 1);
      });
      const double sigma = std::sqrt(1.4001) * pitch;
      for (int step = 0; step < 16; ++step) {
        const TexelKernel kernel = turned_kernel({128 + 0.37 * step, 2}, sigma, sigma, 0);
        worst = std::max(worst, difference(filtered(image, WrapMode::kRepeat, kernel),
                                           brute_force(image, WrapMode::kRepeat, kernel)));
      }
    }
  }
  RecordProperty("worst", std::to_string(worst));
  EXPECT_LT(worst, 1.5e-3);
}

TEST(TextureMap, HugeKernelsSeeTheMeanOrTheBorder) {
  const Image image = make_image(96, 64, [](int x, int) {
    return Eigen::Vector4f(x < 32 ? 1.0F : 0.0F, x == 0 ? 1.0F : 0.0F, 0, 1);
  });
  const TexelKernel kernel = turned_kernel({48, 32}, 3000, 1000, 0);
  for (const WrapMode wrap : {WrapMode::kRepeat, WrapMode::kMirror}) {
    const TextureSample sample = filtered(image, wrap, kernel);
    EXPECT_NEAR(sample.color.x(), 1.0 / 3, 1e-3);
    EXPECT_NEAR(sample.color.y(), 1.0 / 96, 1e-3);
  }
  // Clamped: all that lies to the left of the image's first column has its colour.
  const auto left_of = [&](double x) { return std::erfc((48 - x) / 3000 / std::sqrt(2)) / 2; };
  const TextureSample sample = filtered(image, WrapMode::kClamp, kernel);
  EXPECT_NEAR(sample.color.x(), left_of(32), 2e-3);
  EXPECT_NEAR(sample.color.y(), left_of(1), 2e-3);
}

TEST(TextureMap, ColoursOfTransparentTexelsDoNotBleed) {
  const Image image = make_image(32, 32, [](int x, int) {
    return x < 16 ? Eigen::Vector4f(1, 0, 0, 1) : Eigen::Vector4f(0, 1, 0, 0);
  });
  const TextureMap map(image, WrapMode::kClamp);
  EXPECT_TRUE(map.has_alpha());
  const TextureSample edge = map.sample(turned_kernel({16, 16}, 2, 2, 0));
  EXPECT_EQ(edge.color, Vec3f(1, 0, 0));
  EXPECT_NEAR(edge.alpha, 0.5, 1e-5);
  const TextureSample outside = map.sample(turned_kernel({30, 16}, 1, 1, 0));
  EXPECT_EQ(outside.alpha, 0);
  EXPECT_TRUE(outside.color.allFinite());
}

TEST(TextureMap, OneTexelIsEverywhere) {
  const Image image = make_image(1, 1, [](int, int) { return Eigen::Vector4f(0.25F, 0.5F, 1, 1); });
  for (const WrapMode wrap : kWraps) {
    for (const double sigma : {0.3, 1.0, 40.0, 1e6}) {
      EXPECT_EQ(filtered(image, wrap, turned_kernel({1e7, -3}, 2 * sigma, sigma, 1)).color,
                Vec3f(0.25F, 0.5F, 1));
    }
  }
}

TEST(TextureMap, AbsurdPlacesAreFinite) {
  const Image image = noise_image(33, 9, 5);
  for (const WrapMode wrap : kWraps) {
    for (const double x : {1e15, -1e30, 3e38}) {
      const TextureSample sample = filtered(image, wrap, turned_kernel({x, -x}, 700, 30, 0.5));
      EXPECT_TRUE(sample.color.allFinite());
      EXPECT_LE(sample.color.maxCoeff(), 1);
      EXPECT_GE(sample.color.minCoeff(), 0);
    }
  }
}

TEST(TextureMap, ValuesThatAreNotFiniteDoNotSpread) {
  Image image = noise_image(8, 8, 5);
  image.pixel(3, 3)[0] = std::numeric_limits<float>::quiet_NaN();
  image.pixel(5, 3)[1] = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(filtered(image, WrapMode::kRepeat, turned_kernel({4, 4}, 2, 2, 0)).color.allFinite());
}

TEST(TextureMap, RefusesAnImageWithoutPixelsOrColours) {
  EXPECT_THROW(TextureMap(Image{}, WrapMode::kRepeat), Error);
  Image grey = noise_image(2, 2, 1);
  grey.channels = {"Y"};
  EXPECT_THROW(TextureMap(grey, WrapMode::kRepeat), Error);
}

/// An image in memory as a file that counts what is read of it.
class CountingReader final : public ImageReader {
 public:
  explicit CountingReader(Image image) : image_(std::move(image)) {
    layout_ = {"image", image_.width, image_.height, false, false, 16};
  }
  const Layout& layout() const override { return layout_; }
  void read(const Box& box, void* rgba) override {
    pixels_read += box.pixels();
    auto* out = static_cast<float*>(rgba);
    for (int y = box.y_begin; y < box.y_end; ++y, out += box.width() * 4) {
      std::copy_n(image_.pixel(box.x_begin, y), box.width() * 4, out);
    }
  }
  std::size_t pixels_read = 0;

 private:
  Image image_;
  Layout layout_;
};

TEST(TextureMap, FileGivesWhatTheImageInMemoryDoes) {
  const test::TemporaryFolder folder;
  const Image noise = noise_image(301, 203, 11, true);
  for (const std::string name : {"image.png", "image.tif", "image.exr"}) {
    write_image(noise, folder / name);
    for (const WrapMode wrap : kWraps) {
      TextureMap whole(read_image(folder / name), wrap);
      TextureMap file(open_image(folder / name), wrap);
      std::vector<TexelKernel> kernels;
      for (const double sigma : {0.7, 1.5, 6.0, 30.0}) {
        for (const Vec2d& center : {Vec2d(150, 99), Vec2d(2, 200), Vec2d(-900, 1e6)}) {
          kernels.push_back(turned_kernel(center, 2 * sigma, sigma, 0.4 + sigma));
        }
      }
      for (const TexelKernel& kernel : kernels) {
        whole.request(kernel);
        file.request(kernel);
      }
      whole.load();
      file.load();
      EXPECT_TRUE(file.has_alpha());
      for (const TexelKernel& kernel : kernels) {
        EXPECT_LT(difference(whole.sample(kernel), file.sample(kernel)), 1e-6) << name;
      }
      EXPECT_LT(difference(whole.mean(), file.mean()), 1e-6);
    }
  }
}

TEST(TextureMap, KeepsOnlyTheLevelsOfTheKernels) {
  const auto reader = std::make_shared<CountingReader>(noise_image(640, 640, 3));
  TextureMap map(reader, WrapMode::kRepeat);
  map.request(turned_kernel({100, 100}, 11, 10, 0));
  map.load();
  EXPECT_EQ(reader->pixels_read, 640U * 640U);
  EXPECT_EQ(map.pyramid().level_count(), 4);
  std::size_t floats = 0;
  for (int l = 0; l < map.pyramid().level_count(); ++l) {
    floats += map.pyramid().level(l).texels.size();
  }
  EXPECT_EQ(floats, 80U * 80U * 4U);
  for (int tile = 0; tile < 100; ++tile) {
    EXPECT_FALSE(map.pyramid().image().tiles->is_stored(tile % 10, tile / 10));
  }
}

TEST(TextureMap, LoadsOnlyTheTilesThatKernelsReach) {
  const Image image = noise_image(700, 690, 4);
  const auto reader = std::make_shared<CountingReader>(image);
  TextureMap map(reader, WrapMode::kRepeat);
  const TexelKernel inside = turned_kernel({160, 352}, 1.5, 1, 0.3);
  const TexelKernel at_border = turned_kernel({700, 352}, 1.5, 1, 0.3);
  map.request(inside);
  map.load();
  EXPECT_LE(reader->pixels_read, 2U * 64U * 690U);
  std::set<std::pair<int, int>> stored;
  const auto find_stored = [&] {
    for (int row = 0; row < 11; ++row) {
      for (int column = 0; column < 11; ++column) {
        if (map.pyramid().image().tiles->is_stored(column, row)) stored.insert({column, row});
      }
    }
  };
  find_stored();
  EXPECT_EQ(stored, (std::set<std::pair<int, int>>{{2, 5}}));
  EXPECT_LT(difference(map.sample(inside), brute_force(image, WrapMode::kRepeat, inside)), 1e-4);
  map.request(at_border);
  map.load();
  find_stored();
  EXPECT_EQ(stored, (std::set<std::pair<int, int>>{{0, 5}, {2, 5}, {10, 5}}));
  for (const TexelKernel& kernel : {inside, at_border}) {
    EXPECT_LT(difference(map.sample(kernel), brute_force(image, WrapMode::kRepeat, kernel)), 1e-4);
  }
}

TEST(TextureMap, OneTexelOfAFileIsEverywhere) {
  const auto reader = std::make_shared<CountingReader>(
      make_image(1, 1, [](int, int) { return Eigen::Vector4f(0.25F, 0.5F, 1, 1); }));
  TextureMap map(reader, WrapMode::kRepeat);
  const TexelKernel kernel = turned_kernel({1e7, -3}, 80, 40, 1);
  map.request(kernel);
  map.load();
  EXPECT_EQ(map.sample(kernel).color, Vec3f(0.25F, 0.5F, 1));
}

/// A chart of the two triangles of a square.
std::vector<UvCharts::Triangle> square_chart(float low, float high) {
  const std::array<Vec2f, 4> c{Vec2f(low, low), Vec2f(high, low), Vec2f(high, high),
                               Vec2f(low, high)};
  return {{c[0], c[1], c[2]}, {c[0], c[2], c[3]}};
}

TEST(ChartTexture, LevelsMadeInBandsAgreeWithThoseOfTheWholeChart) {
  // Beyond the image, and large enough for more than one band.
  const auto chart = square_chart(-0.1F, 1.4F);
  for (const bool alpha : {false, true}) {
    TextureMap map(noise_image(1024, 1024, 5, alpha), WrapMode::kMirror);
    const CoverageRaster box = *coverage_box(chart, 1024, 1024, 1e9);
    const ChartTexture whole(map, chart, box, {0, 3});
    const ChartTexture bands(map, chart, box, {2, 3});
    for (const double sigma : {5.0, 12.0}) {
      for (const Vec2d& center : {Vec2d(500, 300), Vec2d(-100, -400), Vec2d(3, 1120)}) {
        const TexelKernel kernel = turned_kernel(center, 1.5 * sigma, sigma, 0.5);
        const auto expected = whole.sample(kernel);
        const auto found = bands.sample(kernel);
        ASSERT_TRUE(expected && found);
        EXPECT_LT(difference(*expected, *found), 1e-6);
      }
    }
  }
}

}  // namespace
}  // namespace surfel
