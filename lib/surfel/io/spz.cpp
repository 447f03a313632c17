// The format of nianticlabs/spz: columns of fixed-point numbers and bytes, compressed by gzip as a
// whole (versions 1 to 3) or by Zstandard column by column (version 4).

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/decompression.h>
#include <surfel/io/gaussian_columns.h>
#include <surfel/io/half.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/spz.h>
#include <surfel/io/text_scanner.h>
#include <surfel/scene/harmonic_rotation.h>

namespace surfel {
namespace {

constexpr std::string_view kSpzMagic = "NGSP";
constexpr std::uint8_t kAntialiased = 1;
constexpr std::uint8_t kExtended = 2;
constexpr std::uint32_t kCompressedByColumn = 4;  ///< The version.

struct SpzHeader {
  std::array<char, 4> magic;
  std::uint32_t version;
  std::uint32_t count;
  std::uint8_t degree;
  std::uint8_t fractional_bits;  ///< Of the positions.
  std::uint8_t flags;
  std::uint8_t streams;  ///< Version 4 alone.
};
static_assert(sizeof(SpzHeader) == 16);

/// Where version 4 has more: the offset of the table of streams, and room.
constexpr std::size_t kLongHeader = 32;

/// A stream of version 4.
struct SpzStream {
  std::uint64_t compressed;
  std::uint64_t raw;
};

/// Columns in the order of the file.
enum class SpzColumn : std::uint8_t {
  kPositions,
  kAlphas,
  kColors,
  kScales,
  kRotations,
  kHarmonics
};
constexpr std::size_t kSpzColumns = 6;

/// Bytes of a Gaussian in each column.
std::array<std::size_t, kSpzColumns> column_sizes(const SpzHeader& header) {
  const std::size_t harmonics = header.degree * (header.degree + 2U);
  return {header.version == 1 ? 6U : 9U, 1, 3, 3, header.version < 3 ? 3U : 4U, 3 * harmonics};
}

SpzHeader checked_header(std::span<const std::byte> bytes, const std::string& file) {
  if (bytes.size() < sizeof(SpzHeader)) throw_input(file, "ends within its header");
  const auto header = load_scalar<SpzHeader, false>(bytes.data());
  if (std::string_view(header.magic.data(), header.magic.size()) != kSpzMagic) {
    throw_input(file, "is not a .spz file: its content does not start with 'NGSP'");
  }
  if (header.version < 1 || header.version > kCompressedByColumn) {
    throw_input(file, fmt::format("is of version {} of .spz; versions 1 to {} are read",
                                  header.version, kCompressedByColumn));
  }
  if (header.degree > GaussianCloud::kMostDegree) {
    throw_input(file, fmt::format("has spherical harmonics of degree {}; {} at most are read",
                                  header.degree, GaussianCloud::kMostDegree));
  }
  constexpr int kMostBits = 24;
  if (header.fractional_bits > kMostBits) {
    throw_input(file, fmt::format("positions have {} bits behind the point; {} at most are there",
                                  header.fractional_bits, kMostBits));
  }
  if (header.count == 0) throw_input(file, "holds no Gaussians");
  return header;
}

/// Signs by which the file's axes become x right, y down, z forwards.
using AxisSigns = std::array<float, 3>;
constexpr AxisSigns kFromRightUpBack = {1, -1, -1};

/// The axes of a version 4 file. One extension names others: a number whose bits, less one, are x
/// to the right, y up and z forwards; bit 3 stands for z as the upward axis.
AxisSigns read_axes(std::span<const std::byte> extensions, const std::string& file) {
  constexpr std::uint32_t kCoordinateSystem = 0xADBE0003;
  constexpr std::size_t kRecordHeader = 8;
  while (extensions.size() >= kRecordHeader) {
    const auto type = load_scalar<std::uint32_t, false>(extensions.data());
    const auto size = load_scalar<std::uint32_t, false>(extensions.data() + 4);
    extensions = extensions.subspan(kRecordHeader);
    if (size > extensions.size()) throw_input(file, "an extension ends outside of the header");
    if (type == kCoordinateSystem && size >= sizeof(std::uint32_t)) {
      const auto system = load_scalar<std::uint32_t, false>(extensions.data());
      constexpr std::uint32_t kUnspecified = 0;
      constexpr std::uint32_t kFirstTurned = 9;
      if (system >= kFirstTurned) {
        throw_input(file,
                    fmt::format("its coordinate system, number {}, is not supported", system));
      }
      if (system == kUnspecified) return kFromRightUpBack;
      const std::uint32_t bits = system - 1;
      return {(bits & 1U) != 0 ? 1.0F : -1.0F, (bits & 2U) != 0 ? -1.0F : 1.0F,
              (bits & 4U) != 0 ? 1.0F : -1.0F};
    }
    extensions = extensions.subspan(size);
  }
  return kFromRightUpBack;
}

/// Columns of a file, decompressed.
struct SpzColumns {
  SpzHeader header{};
  AxisSigns signs = kFromRightUpBack;
  std::vector<Array<std::byte>> memory;
  std::array<const std::byte*, kSpzColumns> column{};
};

/// Versions 1 to 3: one stream, or none where the file is not compressed.
SpzColumns read_whole(const InputFile& input) {
  const std::string& file = input.name();
  const std::span<const std::byte> bytes = input.bytes();
  const bool compressed = as_text(bytes).starts_with(kGzipMagic);
  SpzColumns out;
  out.header = compressed ? checked_header(gunzip(bytes, sizeof(SpzHeader), file, true), file)
                          : checked_header(bytes, file);
  if (out.header.version == kCompressedByColumn) {
    throw_input(file, "is of version 4 of .spz, and compressed once more; decompress it by gunzip");
  }
  const std::array<std::size_t, kSpzColumns> sizes = column_sizes(out.header);
  const std::size_t each = std::accumulate(sizes.begin(), sizes.end(), std::size_t{0});
  const std::size_t most = compressed ? bytes.size() * kMostGzipRatio : bytes.size();
  require_room(out.header.count, each, most - std::min(most, sizeof(SpzHeader)), kTheHeader,
               "Gaussians", [&](const std::string& message) { throw_input(file, message); });
  const std::byte* at = bytes.data();
  if (compressed) {
    const std::size_t size = sizeof(SpzHeader) + out.header.count * each;
    // Extensions follow the columns.
    const bool extended = (out.header.flags & kExtended) != 0;
    at = out.memory.emplace_back(gunzip(bytes, size, file, extended)).data();
  }
  at += sizeof(SpzHeader);
  for (std::size_t k = 0; k < kSpzColumns; ++k) {
    out.column[k] = at;
    at += out.header.count * sizes[k];
  }
  return out;
}

/// Version 4: a table of streams, one for each column that is not empty.
SpzColumns read_streams(const InputFile& input) {
  const std::string& file = input.name();
  const std::span<const std::byte> bytes = input.bytes();
  SpzColumns out;
  out.header = checked_header(bytes, file);
  if (bytes.size() < kLongHeader) throw_input(file, "ends within its header");
  const std::size_t table = load_scalar<std::uint32_t, false>(bytes.data() + sizeof(SpzHeader));
  const std::array<std::size_t, kSpzColumns> sizes = column_sizes(out.header);
  const std::size_t streams = out.header.degree == 0 ? kSpzColumns - 1 : kSpzColumns;
  if (out.header.streams != streams) {
    throw_input(file, fmt::format("has {} streams; degree {} has {}", out.header.streams,
                                  out.header.degree, streams));
  }
  if (table < kLongHeader || table > bytes.size() ||
      bytes.size() - table < streams * sizeof(SpzStream)) {
    throw_input(file, "its table of streams lies outside of the file; it is truncated");
  }
  if ((out.header.flags & kExtended) != 0) {
    out.signs = read_axes(bytes.subspan(kLongHeader, table - kLongHeader), file);
  }
  std::size_t at = table + streams * sizeof(SpzStream);
  std::array<std::span<const std::byte>, kSpzColumns> data;
  for (std::size_t k = 0; k < streams; ++k) {
    const auto stream = load_scalar<SpzStream, false>(bytes.data() + table + k * sizeof(SpzStream));
    if (stream.compressed > bytes.size() - at) {
      throw_input(file, fmt::format("stream {} ends outside of the file; it is truncated", k));
    }
    data[k] = bytes.subspan(at, stream.compressed);
    at += stream.compressed;
    require_room(out.header.count, sizes[k], stream.compressed * kMostZstdRatio, kTheHeader,
                 "Gaussians", [&](const std::string& message) { throw_input(file, message); });
    if (stream.raw != out.header.count * sizes[k]) {
      throw_input(file, fmt::format("stream {} is of {} bytes; {} Gaussians have {}", k, stream.raw,
                                    out.header.count, out.header.count * sizes[k]));
    }
  }
  for (std::size_t k = 0; k < streams; ++k) {
    out.memory.push_back(unzstd(data[k], out.header.count * sizes[k], file));
    out.column[k] = out.memory.back().data();
  }
  return out;
}

/// A coordinate of 24 bits, signed.
float fixed_point(const std::byte* at, float unit) {
  const std::uint32_t bits = static_cast<std::uint32_t>(at[0]) |
                             static_cast<std::uint32_t>(at[1]) << 8 |
                             static_cast<std::uint32_t>(at[2]) << 16;
  // Shifted to the top and back, so that the sign is copied.
  return static_cast<float>(static_cast<std::int32_t>(bits << 8) >> 8) * unit;
}

float byte_value(std::byte value) { return static_cast<float>(std::to_integer<int>(value)); }

/// x, y, z of a quaternion whose w is not negative.
std::array<float, 4> first_three(const std::byte* at) {
  std::array<float, 4> q{};  // w x y z
  float squares = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    q[k + 1] = byte_value(at[k]) / 127.5F - 1;
    squares += q[k + 1] * q[k + 1];
  }
  q[0] = std::sqrt(std::max(0.0F, 1 - squares));
  return q;
}

/// The three smaller ones of x, y, z and w, with a sign and nine bits each, the last one lowest;
/// two bits at the top name the largest one, which is not negative.
std::array<float, 4> smallest_three(const std::byte* at) {
  auto bits = load_scalar<std::uint32_t, false>(at);
  const std::uint32_t largest = bits >> 30;
  std::array<float, 4> xyzw{};
  float squares = 0;
  for (std::uint32_t k = 4; k-- > 0;) {
    if (k == largest) continue;
    constexpr std::uint32_t kMask = 511;
    const float size =
        static_cast<float>(bits & kMask) * (std::numbers::sqrt2_v<float> / 2) / kMask;
    xyzw[k] = (bits >> 9 & 1U) != 0 ? -size : size;
    squares += size * size;
    bits >>= 10;
  }
  xyzw[largest] = std::sqrt(std::max(0.0F, 1 - squares));
  return {xyzw[3], xyzw[0], xyzw[1], xyzw[2]};
}

/// The sign of each harmonic where axes are mirrored: each is even or odd in each coordinate.
std::array<float, kMostHarmonics> harmonic_signs(const AxisSigns& axes) {
  const Vec3d direction(0.36, 0.48, 0.8);  // No harmonic is zero there.
  const Vec3d mirrored(axes[0] * direction.x(), axes[1] * direction.y(), axes[2] * direction.z());
  const std::array<double, kMostHarmonics> here = harmonics_of(direction);
  const std::array<double, kMostHarmonics> there = harmonics_of(mirrored);
  std::array<float, kMostHarmonics> signs{};
  for (std::size_t k = 0; k < signs.size(); ++k) signs[k] = here[k] * there[k] > 0 ? 1.0F : -1.0F;
  return signs;
}

GaussianCloud decode(const SpzColumns& in, const std::string& file,
                     const GaussianReadOptions& options) {
  GaussianCloud cloud;
  cloud.degree = in.header.degree;
  if ((in.header.flags & kAntialiased) != 0) {
    cloud.rule = AmplitudeRule::kCompensated;
    cloud.trained_with = TrainedWith::kMip;
  }
  cloud.up = Vec3d(0, -1, 0);
  allocate_gaussians(cloud, in.header.count, file, options);
  const std::array<std::size_t, kSpzColumns> sizes = column_sizes(in.header);
  const std::size_t stride = cloud.harmonics_stride();
  const float unit = 1.0F / static_cast<float>(1U << in.header.fractional_bits);
  const std::array<float, kMostHarmonics> signs = harmonic_signs(in.signs);
  const AxisSigns& axis = in.signs;
  parallel_each(cloud.size(), kGaussianGrain, [&](std::size_t i) {
    const auto at = [&](SpzColumn column) {
      const auto k = static_cast<std::size_t>(column);
      return in.column[k] + i * sizes[k];
    };
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis_k = static_cast<Eigen::Index>(k);
      const float coordinate =
          in.header.version == 1
              ? float_of_half(load_scalar<std::uint16_t, false>(at(SpzColumn::kPositions) + 2 * k))
              : fixed_point(at(SpzColumn::kPositions) + 3 * k, unit);
      cloud.position[i][axis_k] = axis[k] * coordinate;
      cloud.scale[i][axis_k] = portable::exp(byte_value(at(SpzColumn::kScales)[k]) / 16 - 10);
      cloud.harmonics[i * stride + k] =
          (byte_value(at(SpzColumn::kColors)[k]) / 255 - 0.5F) / 0.15F;
    }
    cloud.amplitude[i] = byte_value(*at(SpzColumn::kAlphas)) / 255;
    std::array<float, 4>& q = cloud.rotation[i];
    q = in.header.version < 3 ? first_three(at(SpzColumn::kRotations))
                              : smallest_three(at(SpzColumn::kRotations));
    q[1] *= axis[1] * axis[2];
    q[2] *= axis[0] * axis[2];
    q[3] *= axis[0] * axis[1];
    for (std::size_t k = 3; k < stride; ++k) {
      const float value = (byte_value(at(SpzColumn::kHarmonics)[k - 3]) - 128) / 128;
      cloud.harmonics[i * stride + k] = signs[k / 3] * value;
    }
  });
  finish_gaussians(cloud, file);
  return cloud;
}

}  // namespace

bool is_spz(const InputFile& input) {
  const std::string_view start = as_text(input.head(kSpzMagic.size()));
  return start == kSpzMagic ||
         (start.starts_with(kGzipMagic) && lower_extension(input.name()) == ".spz");
}

GaussianCloud read_spz(const InputFile& input, const GaussianReadOptions& options) {
  const std::string_view start = as_text(input.head(sizeof(SpzHeader)));
  const bool by_column = start.starts_with(kSpzMagic) && start.size() == sizeof(SpzHeader) &&
                         load_scalar<std::uint32_t, false>(input.head(sizeof(SpzHeader)).data() +
                                                           4) == kCompressedByColumn;
  return decode(by_column ? read_streams(input) : read_whole(input), input.name(), options);
}

}  // namespace surfel
