// The format of the viewer antimatter15/splat: position and scale as floats, colour, opacity and
// rotation in bytes.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/gaussian_columns.h>
#include <surfel/io/splat.h>

namespace surfel {
namespace {

/// A Gaussian as the file has it, little-endian like every machine that this library runs on.
struct SplatRecord {
  std::array<float, 3> position;
  std::array<float, 3> scale;
  std::array<std::uint8_t, 4> rgba;
  std::array<std::uint8_t, 4> rotation;  ///< w x y z, each (byte - 128) / 128.
};
static_assert(sizeof(SplatRecord) == 32);

std::uint8_t to_byte(double value) {
  return static_cast<std::uint8_t>(std::clamp(std::floor(value + 0.5), 0.0, 255.0));
}

}  // namespace

GaussianCloud read_splat(const InputFile& input, const GaussianReadOptions& options) {
  const std::size_t record = sizeof(SplatRecord);
  if (input.size() % record != 0) {
    throw_input(input.name(),
                fmt::format("is no .splat file: {} bytes are not a multiple of {}; it is "
                            "truncated or of another format",
                            input.size(), record));
  }
  GaussianCloud cloud;
  allocate_gaussians(cloud, input.size() / record, input.name(), options);
  parallel_for(cloud.size(), kGaussianGrain, [&](std::size_t begin, std::size_t end, int) {
    static thread_local Array<std::byte> scratch;
    const std::byte* at = input.read_at(begin * record, (end - begin) * record, scratch);
    for (std::size_t i = begin; i < end; ++i, at += record) {
      SplatRecord splat;
      std::memcpy(&splat, at, record);
      cloud.position[i] = Vec3f(splat.position.data());
      cloud.scale[i] = Vec3f(splat.scale.data());
      cloud.amplitude[i] = static_cast<float>(splat.rgba[3]) / 255;
      for (std::size_t k = 0; k < 3; ++k) {
        cloud.harmonics[3 * i + k] =
            static_cast<float>((splat.rgba[k] / 255.0 - 0.5) / GaussianCloud::kHarmonic0);
      }
      for (std::size_t k = 0; k < 4; ++k) {
        cloud.rotation[i][k] = (static_cast<float>(splat.rotation[k]) - 128) / 128;
      }
    }
  });
  finish_gaussians(cloud, input.name());
  return cloud;
}

void write_splat(const GaussianCloud& cloud, OutputFile& file) {
  const std::size_t stride = cloud.harmonics_stride();
  const std::uint64_t start = file.reserve(cloud.size() * sizeof(SplatRecord));
  parallel_for(cloud.size(), kGaussianGrain, [&](std::size_t begin, std::size_t end, int) {
    static thread_local Array<SplatRecord> records;
    records.resize(end - begin);
    for (std::size_t i = begin; i < end; ++i) {
      SplatRecord& splat = records[i - begin];
      for (int k = 0; k < 3; ++k) {
        const auto at = static_cast<std::size_t>(k);
        splat.position[at] = cloud.position[i][k];
        splat.scale[at] = cloud.scale[i][k];
        splat.rgba[at] =
            to_byte(255 * (0.5 + GaussianCloud::kHarmonic0 * cloud.harmonics[i * stride + at]));
      }
      splat.rgba[3] = to_byte(255.0 * cloud.amplitude[i]);
      for (std::size_t k = 0; k < 4; ++k) {
        splat.rotation[k] = to_byte(128.0 * cloud.rotation[i][k] + 128);
      }
    }
    file.write_at(start + begin * sizeof(SplatRecord), records.data(),
                  records.size() * sizeof(SplatRecord));
  });
}

}  // namespace surfel
