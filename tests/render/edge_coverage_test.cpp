#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/render/edge_coverage.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

double phi(double z) { return std::erfc(-z / std::sqrt(2.0)) / 2; }

/// Share of a kernel of variance 1 pixel^2, cut off at beta < c, that lies on one side of a
/// straight line in a distance from its centre.
double share_inside(double distance, double cutoff) {
  const double reach = std::sqrt(2 * cutoff);
  if (std::abs(distance) >= reach) return distance > 0 ? 1 : 0;
  constexpr int kSteps = 4000;
  double inside = 0;
  double all = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double t = reach * (2 * (i + 0.5) / kSteps - 1);
    const double across = std::exp(-t * t / 2) * std::erf(std::sqrt(cutoff - t * t / 2));
    all += across;
    if (t < distance) inside += across;
  }
  return inside / all;
}

constexpr int kPixels = 64;

/// A pixel's fragments: the sums of rho of a front and of a back, and the spacing of the splats.
struct Sums {
  double front = 0, back = 0;
  int step = 0;
  bool merged = false;
};

/// Lets EdgeCoverage work on a red picture of `kPixels` pixels a side, over blue, whose opacities
/// have been resolved to something else.
Image with_edges(double cutoff, const std::function<Sums(int, int)>& sums,
                 const std::function<float(int, int)>& resolved) {
  EdgeCoverage edges(EdgeFilter(cutoff, 1), 1, 0.7F);
  edges.begin(kPixels, kPixels);
  Image image = rgba_image(kPixels, kPixels);
  TileABuffer tile;
  tile.layout = {.layers = 2, .opaque = true};
  std::vector<float> data(tile.layout.size());
  tile.data = data.data();
  for (tile.y0 = 0; tile.y0 < kPixels; tile.y0 += kTileSize) {
    for (tile.x0 = 0; tile.x0 < kPixels; tile.x0 += kTileSize) {
      std::fill(data.begin(), data.end(), 0.0F);
      for (int pixel = 0; pixel < kTilePixels; ++pixel) {
        const Sums s = sums(tile.x0 + tile_pixel_x(pixel), tile.y0 + tile_pixel_y(pixel));
        int layer = 0;
        for (const bool front : {true, false}) {
          const double sum = front ? s.front : s.back;
          if (sum == 0) continue;
          tile.at(layer, kWeight, pixel) = s.merged ? -1 : static_cast<float>(sum);
          tile.at(layer, kTag, pixel) = std::bit_cast<float>(
              static_cast<std::uint32_t>(s.step) << kSpacingShift | (front ? kFrontTag : 0));
          ++layer;
        }
      }
      edges.store(tile, TileInside::kNo);
    }
  }
  for (int y = 0; y < kPixels; ++y) {
    for (int x = 0; x < kPixels; ++x) {
      const float opacity = resolved(x, y);
      edges.set_opacity(x, y, opacity);
      const float color[] = {opacity, 0, 1 - opacity, 1};
      std::copy_n(color, 4, image.pixel(x, y));
    }
  }
  edges.apply(image, {0, image.height}, [](int, int) { return Rgba{0, 0, 1, 1}; });
  return image;
}

float capped(double sum) { return static_cast<float>(std::min(1.0, 1.4 * sum)); }

/// The distance of a pixel's middle from a slanted line, inwards.
double from_line(int x, int y, double angle) {
  return (x + 0.5 - kPixels / 2.0) * std::cos(angle) + (y + 0.5 - kPixels / 2.0) * std::sin(angle) +
         0.3;
}

TEST(EdgeCoverage, OfAStraightEdgeIsThatOfTheWholeGaussian) {
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    const double mean = 1 - std::exp(-cutoff);
    for (const double angle : {0.0, 0.4, 2.2}) {
      const auto share = [&](int x, int y) { return share_inside(from_line(x, y, angle), cutoff); };
      const Image image = with_edges(
          cutoff, [&](int x, int y) { return Sums{.front = mean * share(x, y)}; },
          [&](int x, int y) { return capped(share(x, y)); });
      double worst = 0;
      for (int y = 8; y < kPixels - 8; ++y) {
        for (int x = 8; x < kPixels - 8; ++x) {
          worst = std::max(worst, std::abs(image.pixel(x, y)[0] - phi(from_line(x, y, angle))));
          EXPECT_NEAR(image.pixel(x, y)[0] + image.pixel(x, y)[2], 1, 1e-4);
        }
      }
      // Kernels end where less than this is left of the Gaussian, and the filter's taps are five.
      EXPECT_LT(worst, 0.02) << cutoff << ' ' << angle;
    }
  }
}

TEST(EdgeCoverage, TakesTheLargerSumOfTheTwoSides) {
  const double mean = 1 - std::exp(-2.0);
  const auto share = [&](int x, int y) { return share_inside(from_line(x, y, 0.4), 2); };
  const auto opacity = [&](int x, int y) { return capped(share(x, y)); };
  const Image whole = with_edges(
      2, [&](int x, int y) { return Sums{.front = mean * share(x, y)}; }, opacity);
  const Image sides = with_edges(
      2,
      [&](int x, int y) {
        const double w = mean * share(x, y);
        return (x + y) % 2 == 0 ? Sums{.front = w, .back = 0.3 * w}
                                : Sums{.front = 0.3 * w, .back = w};
      },
      opacity);
  for (std::size_t i = 0; i < whole.data.size(); ++i) {
    ASSERT_NEAR(whole.data[i], sides.data[i], 1e-4) << i;
  }
}

/// Sums that are uneven by a sixth, as those of surfels that are more than a pixel apart, in two
/// ways: where there is no edge the pixels stay, and at an edge they count for less.
TEST(EdgeCoverage, UnevenSumsAreNoHoles) {
  const double mean = 1 - std::exp(-1.0);
  const auto uneven = [](int x, int y) {
    return 1 - random_uniform(3, static_cast<std::uint64_t>(y) * kPixels + x) / 3;
  };
  const Image inside = with_edges(
      1, [&](int x, int y) { return Sums{.front = mean * uneven(x, y), .step = 2}; },
      [](int, int) { return 1.0F; });
  for (int y = 0; y < kPixels; ++y) {
    for (int x = 0; x < kPixels; ++x) ASSERT_EQ(inside.pixel(x, y)[0], 1) << x << ' ' << y;
  }
  const auto even = [&](int x, int y) {
    return share_inside(from_line(x, y, 0.4), 1) * uneven(x, y) * 1.2;
  };
  const Image image = with_edges(
      1, [&](int x, int y) { return Sums{.front = mean * even(x, y), .step = 2}; },
      [&](int x, int y) { return capped(even(x, y)); });
  double sum2 = 0;
  double sums2 = 0;
  int count = 0;
  for (int y = 8; y < kPixels - 8; ++y) {
    for (int x = 8; x < kPixels - 8; ++x) {
      const double d = from_line(x, y, 0.4);
      if (std::abs(d) > 2.5) continue;
      sum2 += std::pow(image.pixel(x, y)[0] - phi(d), 2);
      sums2 += std::pow(std::min(1.0, even(x, y)) - phi(d), 2);
      ++count;
    }
  }
  EXPECT_LT(std::sqrt(sum2 / count), 0.05);
  EXPECT_LT(sum2, 0.35 * sums2);
}

/// A stripe of two pixels keeps most of its opacity, which sharpening by a straight edge's rule
/// alone would take.
TEST(EdgeCoverage, ThinPartsStay) {
  const double mean = 1 - std::exp(-2.0);
  const auto share = [&](int x) {
    const double d = x + 0.5 - kPixels / 2.0 + 0.2;
    return share_inside(d + 1, 2) - share_inside(d - 1, 2);
  };
  const Image image = with_edges(
      2, [&](int x, int) { return Sums{.front = mean * share(x)}; },
      [&](int x, int) { return static_cast<float>(share(x)); });
  double worst = 0;
  for (int x = 0; x < kPixels; ++x) {
    const double d = x + 0.5 - kPixels / 2.0 + 0.2;
    worst = std::max(worst, std::abs(image.pixel(x, kPixels / 2)[0] - (phi(d + 1) - phi(d - 1))));
  }
  EXPECT_LT(worst, 0.08);
}

TEST(EdgeCoverage, LargeSplatsAreLeftAlone) {
  const double mean = 1 - std::exp(-1.0);
  const auto share = [&](int x, int y) { return share_inside(from_line(x, y, 0.4), 1); };
  const Image image = with_edges(
      1, [&](int x, int y) { return Sums{.front = mean * share(x, y), .step = kCoarseStep}; },
      [&](int x, int y) { return capped(share(x, y)); });
  for (int y = 0; y < kPixels; ++y) {
    for (int x = 0; x < kPixels; ++x) ASSERT_EQ(image.pixel(x, y)[0], capped(share(x, y)));
  }
}

TEST(EdgeCoverage, MergedSurfacesAwayFromEdgesAreWhole) {
  const double mean = 1 - std::exp(-1.0);
  const auto is_merged = [](int x, int y) { return x == 20 && y == 31; };
  const Image image = with_edges(
      1, [&](int x, int y) { return Sums{.front = mean, .merged = is_merged(x, y)}; },
      [&](int x, int y) { return is_merged(x, y) ? 0.85F : 1.0F; });
  EXPECT_GT(image.pixel(20, 31)[0], 0.98F);
}

/// Spheres of a radius of 38 pixels, of closed form: at a distance d inwards from the silhouette
/// the coverage is nearly Phi(d - 1 / (2 R)).
TEST(EdgeCoverage, SpheresEndWhereTheyShould) {
  for (const double spacing : {0.5, 1.0, 2.0}) {
    for (const double cutoff : {1.0, 2.0}) {
      constexpr int kSize = 96;
      constexpr double kRadius = 38;
      const auto count = static_cast<int>(4 * M_PI * kRadius * kRadius / (spacing * spacing));
      SurfelCloud sphere = fibonacci_sphere(count, kRadius * 2 / kSize);
      for (float& v : sphere.variance) v *= 0.49F;
      RenderOptions options;
      options.cutoff = cutoff;
      const Image image = render_unlit(sphere, square_camera(kSize), options);
      std::vector<double> errors;
      double mean = 0;
      for (int y = 0; y < kSize; ++y) {
        for (int x = 0; x < kSize; ++x) {
          const double alpha = image.pixel(x, y)[3];
          const double d =
              kRadius - std::hypot(x + 0.5 - kSize / 2.0, y + 0.5 - kSize / 2.0) - 0.5 / kRadius;
          if (std::abs(d) > 1.5) continue;
          ASSERT_GT(alpha, 0);
          // By the slope of Phi, an error of the opacity is one of the edge's place.
          errors.push_back((alpha - phi(d)) * std::sqrt(2 * M_PI) * std::exp(d * d / 2));
          mean += errors.back();
        }
      }
      mean /= static_cast<double>(errors.size());
      double spread = 0;
      for (const double e : errors) spread += (e - mean) * (e - mean);
      spread = std::sqrt(spread / static_cast<double>(errors.size()));
      EXPECT_LT(std::abs(mean), spacing < 2 ? 0.05 : 0.06) << spacing << ' ' << cutoff;
      EXPECT_LT(spread, cutoff < 2 ? 0.15 : 0.1) << spacing << ' ' << cutoff;
    }
  }
}

/// Bars and gaps that are as wide, from a quarter of a pixel on: half of each pixel is covered.
TEST(EdgeCoverage, FencesCoverTheirShare) {
  for (const double cutoff : {1.0, 4.0}) {
    for (const double spacing : {0.25, 0.5}) {
      for (const double width : {0.5, 1.0, 2.0}) {
        constexpr int kSize = 64;
        const auto count = static_cast<int>(kSize / spacing);
        // Surfels of an even grid would lie at the same places of all pixels.
        const SurfelCloud plane = jittered_plane(count, 1, 0.5);
        SurfelCloud fence;
        for (std::size_t i = 0; i < plane.size(); ++i) {
          const double x = (plane.position[i].x() + 1) * kSize / 2;
          if (static_cast<int>(x / width) % 2 != 0) continue;
          add_surfel(fence, plane.position[i], plane.normal[i], 0.49F * plane.variance[i],
                     plane.area[i], Vec3f(1, 1, 1));
        }
        RenderOptions options;
        options.cutoff = cutoff;
        const Image image = render_unlit(fence, square_camera(kSize), options);
        double sum = 0;
        for (int y = 16; y < 48; ++y) {
          for (int x = 16; x < 48; ++x) sum += image.pixel(x, y)[3];
        }
        EXPECT_NEAR(sum / (32 * 32), 0.5, 0.03) << cutoff << ' ' << spacing << ' ' << width;
      }
    }
  }
}

/// A sphere that is there twice, each time with its points elsewhere, ends where one does.
TEST(EdgeCoverage, JoinedScansEndWhereOneDoes) {
  constexpr int kSize = 96;
  constexpr double kRadius = 38;
  const auto count = static_cast<int>(4 * M_PI * kRadius * kRadius);
  SurfelCloud once = fibonacci_sphere(count, kRadius * 2 / kSize);
  for (float& v : once.variance) v *= 0.49F;
  SurfelCloud twice = once;
  for (std::size_t i = 0; i < once.size(); ++i) {
    const auto turned = [](const Vec3f& v) { return Vec3f(v.y(), v.z(), v.x()); };
    add_surfel(twice, turned(once.position[i]), turned(once.normal[i]), once.variance[i],
               once.area[i], Vec3f(1, 1, 1));
  }
  for (const double cutoff : {1.0, 4.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    double area = 0;
    const Image image = render_unlit(twice, square_camera(kSize), options);
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) area += image.pixel(x, y)[3];
    }
    const double offset = (area - M_PI * kRadius * kRadius) / (2 * M_PI * kRadius);
    EXPECT_LT(std::abs(offset), 0.08) << cutoff;  // By sums over one mean: 0.5 pixels and more.
  }
}

}  // namespace
}  // namespace surfel::test
