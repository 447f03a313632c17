#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include <surfel/base/elementary.h>
#include <surfel/gaussian/gaussian_cut.h>
#include <surfel/gaussian/gaussian_extent.h>
#include <surfel/measure/gaussian_statistics.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {
namespace {

/// Counts values in the parts between edges; values outside belong to the nearest part.
Histogram histogram_of(const std::vector<double>& values, std::vector<double> edges) {
  Histogram out{.edges = std::move(edges), .counts = {}};
  out.counts.resize(out.edges.size() - 1);
  for (const double value : values) {
    const auto above = std::upper_bound(out.edges.begin() + 1, out.edges.end() - 1, value);
    ++out.counts[static_cast<std::size_t>(above - out.edges.begin()) - 1];
  }
  return out;
}

/// Ten equal parts from 0 on.
std::vector<double> even_edges(double most) {
  constexpr int kParts = 10;
  std::vector<double> edges;
  for (int k = 0; k <= kParts; ++k) edges.push_back(most * k / kParts);
  return edges;
}

/// Powers of ten around all values that are not zero.
std::vector<double> decade_edges(const std::vector<double>& values) {
  double least = 0;
  double most = 0;
  for (const double value : values) {
    if (value > 0 && (least == 0 || value < least)) least = value;
    most = std::max(most, value);
  }
  if (most == 0) return {0, 1};
  int exponent = static_cast<int>(std::floor(portable::log10(least)));
  std::vector<double> edges{portable::pow(10.0, exponent)};
  do edges.push_back(portable::pow(10.0, ++exponent));
  while (edges.back() <= most);
  return edges;
}

/// Distance of each Gaussian's seventh nearest neighbour, or of the last one where there are fewer.
std::vector<double> neighbor_distances(const GaussianCloud& cloud) {
  constexpr std::size_t kNeighbors = 1 + 7;  // The first one is the Gaussian itself.
  std::vector<double> distances(cloud.size());
  make_neighbor_search(cloud.position)
      ->for_each_nearest(kNeighbors, [&](std::size_t i, std::span<const Neighbor> found, int) {
        distances[i] = std::sqrt(static_cast<double>(found.back().distance2));
      });
  return distances;
}

/// Number of cubes with that edge that hold a centre, of the Gaussians with an amplitude of at
/// least `least`.
std::size_t occupied_cubes(const GaussianCloud& cloud, const Bounds& box, double edge,
                           double least) {
  constexpr int kBits = 21;
  constexpr double kMost = (1 << kBits) - 1;  // Far floaters share the cubes at the rim.
  std::vector<std::uint64_t> cubes;
  cubes.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (static_cast<double>(cloud.amplitude[i]) < least) continue;
    const Vec3d p = cloud.origin + cloud.position[i].cast<double>() - box.min;
    std::uint64_t cube = 0;
    for (int k = 0; k < 3; ++k) {
      const double at = std::clamp(std::floor(p[k] / edge) + kMost / 2, 0.0, kMost);
      cube = cube << kBits | static_cast<std::uint64_t>(at);
    }
    cubes.push_back(cube);
  }
  std::sort(cubes.begin(), cubes.end());
  return static_cast<std::size_t>(std::unique(cubes.begin(), cubes.end()) - cubes.begin());
}

/// What pictures of the part of a scene need that cameras frame.
std::array<PictureNeed, 4> picture_needs(const GaussianCloud& cloud, double least) {
  const SceneExtent extent = gaussian_extent(cloud);
  const Bounds& box = extent.core ? extent.core->box : extent.box;
  const double side = box.empty() ? 0 : (box.max - box.min).maxCoeff();
  std::array<PictureNeed, 4> needs;
  for (std::size_t k = 0; k < needs.size(); ++k) {
    needs[k].rows = 128 << k;
    if (side > 0) {
      needs[k].gaussians =
          occupied_cubes(cloud, box, kGaussianLodError * side / needs[k].rows, least);
    }
  }
  return needs;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

GaussianStatistics gaussian_statistics(const GaussianCloud& cloud) {
  constexpr double kReach = 3;    // Standard deviations.
  constexpr double kFar = 10;     // Medians of the distance.
  constexpr double kHuge = 20;    // Medians of the scale.
  constexpr double kFaint = 0.1;  // Opacity.
  constexpr double kUnseen = 1.0 / 255;
  GaussianStatistics out;
  out.count = cloud.size();
  std::vector<double> amplitude(cloud.size());
  std::vector<double> scale(cloud.size());
  std::vector<double> elongation;
  std::vector<double> flatness;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    out.bounds.add(cloud.origin + cloud.position[i].cast<double>());
    amplitude[i] = cloud.amplitude[i];
    std::array<double, 3> axes = {cloud.scale[i][0], cloud.scale[i][1], cloud.scale[i][2]};
    std::sort(axes.begin(), axes.end());
    scale[i] = axes[2];
    if (axes[1] == 0) continue;
    elongation.push_back(axes[2] / axes[1]);
    flatness.push_back(axes[0] / axes[1]);
  }
  out.amplitude = distribution(amplitude);
  out.scale = distribution(scale);
  if (!elongation.empty()) {
    out.elongation = distribution(std::move(elongation));
    out.flatness = distribution(std::move(flatness));
  }
  const bool density = cloud.rule == AmplitudeRule::kDensity;
  out.amplitudes = histogram_of(amplitude, even_edges(density ? out.amplitude.max : 1));
  out.scales = histogram_of(scale, decade_edges(scale));

  const std::vector<double> distance = neighbor_distances(cloud);
  const double usual_distance = median(distance);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    out.isolated += distance[i] > kFar * usual_distance && distance[i] > kReach * scale[i];
    if (density) continue;
    out.invisible += amplitude[i] < kUnseen;
    out.veils += scale[i] > kHuge * out.scale.median && amplitude[i] < kFaint;
  }
  out.needs = picture_needs(cloud, density ? 0 : kUnseen);
  return out;
}

}  // namespace surfel
