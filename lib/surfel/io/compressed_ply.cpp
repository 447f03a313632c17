// The compressed PLY files of PlayCanvas (SuperSplat, splat-transform).

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/compressed_ply.h>
#include <surfel/io/gaussian_columns.h>

namespace surfel {
namespace {

constexpr std::size_t kChunkSize = 256;

/// The lowest and highest value of three numbers in each chunk.
struct ChunkBounds {
  std::array<Array<float>, 3> min;
  std::array<Array<float>, 3> max;

  /// Reads the properties min_PREFIXa and so on.
  ChunkBounds(PlyFile& ply, const std::string& prefix, const std::array<const char*, 3>& names) {
    for (std::size_t k = 0; k < 3; ++k) {
      min[k] = ply.column<float>("chunk", "min_" + prefix + names[k]);
      max[k] = ply.column<float>("chunk", "max_" + prefix + names[k]);
    }
  }
  /// The value at a share of the way from the lowest to the highest.
  float value(std::size_t k, std::size_t chunk, float share) const {
    return min[k][chunk] * (1 - share) + max[k][chunk] * share;
  }
};

/// Some bits of a word, from `shift` on, as a share of the largest number of so many bits.
float share_of(std::uint32_t word, int shift, int bits) {
  const std::uint32_t most = (1U << bits) - 1;
  return static_cast<float>((word >> shift) & most) / static_cast<float>(most);
}

/// Three shares of 11, 10 and 11 bits.
std::array<float, 3> three_shares(std::uint32_t word) {
  return {share_of(word, 21, 11), share_of(word, 11, 10), share_of(word, 0, 11)};
}

/// Two bits name the largest of w, x, y and z, which is not negative; the others follow in order.
std::array<float, 4> packed_rotation(std::uint32_t word) {
  std::array<float, 4> q{};
  const std::size_t largest = word >> 30;
  float squares = 0;
  int shift = 20;
  for (std::size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    q[k] = (share_of(word, shift, 10) - 0.5F) * std::numbers::sqrt2_v<float>;
    squares += q[k] * q[k];
    shift -= 10;
  }
  q[largest] = std::sqrt(std::max(0.0F, 1 - squares));
  return q;
}

/// A coefficient of a byte.
float coefficient_of(std::uint8_t byte) {
  const float share = byte == 0 ? 0 : byte == 255 ? 1 : (static_cast<float>(byte) + 0.5F) / 256;
  return (share - 0.5F) * 8;
}

/// The coefficients above degree 0 of all Gaussians, the red ones first, then the green ones.
std::vector<Array<std::uint8_t>> read_coefficients(PlyFile& ply, std::size_t count) {
  std::vector<Array<std::uint8_t>> columns;
  const PlyElement* const element = ply.header().find("sh");
  if (!element) return columns;
  degree_of_coefficients(element->properties.size(), ply.name());
  if (element->count != count) {
    throw_input(ply.name(), fmt::format("has harmonics of {} Gaussians, and {} Gaussians",
                                        element->count, count));
  }
  for (std::size_t k = 0; k < element->properties.size(); ++k) {
    columns.push_back(ply.column<std::uint8_t>("sh", fmt::format("f_rest_{}", k)));
  }
  return columns;
}

}  // namespace

bool has_packed_gaussians(const PlyHeader& header) {
  const PlyElement* const vertex = header.find("vertex");
  return vertex && vertex->find("packed_position") && header.find("chunk");
}

GaussianCloud read_compressed_ply(PlyFile& ply, const GaussianReadOptions& options) {
  const auto words = [&](const char* name) { return ply.column<std::uint32_t>("vertex", name); };
  const Array<std::uint32_t> position = words("packed_position");
  const Array<std::uint32_t> rotation = words("packed_rotation");
  const Array<std::uint32_t> scale = words("packed_scale");
  const Array<std::uint32_t> color = words("packed_color");
  const std::size_t count = position.size();
  const std::size_t chunks = ply.header().find("chunk")->count;
  if (chunks < (count + kChunkSize - 1) / kChunkSize) {
    throw_input(ply.name(),
                fmt::format("has {} chunks, too few for its {} Gaussians", chunks, count));
  }
  const ChunkBounds places(ply, "", {"x", "y", "z"});
  const ChunkBounds scales(ply, "scale_", {"x", "y", "z"});
  std::optional<ChunkBounds> colors;
  if (ply.header().find("chunk")->find("min_r")) colors.emplace(ply, "", std::array{"r", "g", "b"});
  const std::vector<Array<std::uint8_t>> coefficients = read_coefficients(ply, count);

  GaussianCloud cloud;
  cloud.degree = degree_of_coefficients(coefficients.size(), ply.name());
  allocate_gaussians(cloud, count, ply.name(), options);
  const std::size_t stride = cloud.harmonics_stride();
  parallel_each(count, kGaussianGrain, [&](std::size_t i) {
    const std::size_t chunk = i / kChunkSize;
    const std::array<float, 3> place = three_shares(position[i]);
    const std::array<float, 3> size = three_shares(scale[i]);
    float* const harmonics = cloud.harmonics.data() + i * stride;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      cloud.position[i][axis] = places.value(k, chunk, place[k]);
      cloud.scale[i][axis] = portable::exp(scales.value(k, chunk, size[k]));
      const float share = share_of(color[i], 24 - 8 * static_cast<int>(k), 8);
      const float shown = colors ? colors->value(k, chunk, share) : share;
      harmonics[k] = (shown - 0.5F) / static_cast<float>(GaussianCloud::kHarmonic0);
      for (std::size_t j = 0; j < coefficients.size() / 3; ++j) {
        harmonics[3 * (j + 1) + k] =
            coefficient_of(coefficients[k * coefficients.size() / 3 + j][i]);
      }
    }
    cloud.amplitude[i] = share_of(color[i], 0, 8);
    cloud.rotation[i] = packed_rotation(rotation[i]);
  });
  finish_gaussians(cloud, ply.name());
  return cloud;
}

}  // namespace surfel
