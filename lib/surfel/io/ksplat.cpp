// The format of mkkellogg/GaussianSplats3D: sections of Gaussians, whose positions are stored
// relative to the centres of buckets where they are compressed.

#include <algorithm>
#include <array>
#include <span>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/gaussian_columns.h>
#include <surfel/io/half.h>
#include <surfel/io/ksplat.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>

namespace surfel {
namespace {

constexpr std::size_t kKsplatHeader = 4096;
constexpr std::size_t kKsplatSectionHeader = 1024;
constexpr int kMostKsplatDegree = 3;

/// Where the values of a Gaussian lie within its record: position, then these.
struct KsplatLayout {
  std::size_t scale, rotation, color, harmonics;
  std::size_t harmonic_bytes;  ///< Of each coefficient.
};
constexpr std::array<KsplatLayout, 3> kKsplatLayouts{
    {{12, 24, 40, 44, 4}, {6, 12, 20, 24, 2}, {6, 12, 20, 24, 1}}};

/// A range of Gaussians of one degree.
struct KsplatSection {
  std::size_t count = 0;
  std::size_t first = 0;  ///< Number of the section's first Gaussian in the cloud.
  std::size_t degree = 0;
  std::size_t stride = 0;
  std::size_t full_buckets = 0;
  std::size_t bucket_capacity = 0;
  float position_unit = 0;
  float position_middle = 0;
  std::vector<std::size_t> partial_ends;  ///< Of the buckets behind the full ones.
  std::span<const std::byte> centers;     ///< Three floats a bucket.
  std::span<const std::byte> records;

  /// The bucket of a Gaussian of the section.
  std::size_t bucket(std::size_t i) const {
    const std::size_t full = full_buckets * bucket_capacity;
    if (i < full) return i / bucket_capacity;
    const auto end = std::upper_bound(partial_ends.begin(), partial_ends.end(), i);
    return full_buckets + static_cast<std::size_t>(end - partial_ends.begin());
  }
};

class KsplatReader {
 public:
  explicit KsplatReader(const InputFile& input) : file_(input.name()), bytes_(input.bytes()) {}

  GaussianCloud read(const GaussianReadOptions& options) {
    read_header();
    GaussianCloud cloud;
    std::size_t count = 0;
    for (KsplatSection& section : sections_) {
      section.first = count;
      count += section.count;
      cloud.degree = std::max(cloud.degree, static_cast<int>(section.degree));
    }
    allocate_gaussians(cloud, count, file_, options);
    for (const KsplatSection& section : sections_) decode(section, cloud);
    finish_gaussians(cloud, file_);
    return cloud;
  }

 private:
  void read_header() {
    if (bytes_.size() < kKsplatHeader) {
      throw_input(file_, "is no .ksplat file: its header is cut; it is truncated");
    }
    const auto major = load_scalar<std::uint8_t, false>(bytes_.data());
    const auto minor = load_scalar<std::uint8_t, false>(bytes_.data() + 1);
    if (major != 0 || minor < 1) {
      throw_input(file_,
                  fmt::format("is of version {}.{} of .ksplat; version 0.1 is read", major, minor));
    }
    const std::size_t sections = load_scalar<std::uint32_t, false>(bytes_.data() + 4);
    mode_ = load_scalar<std::uint16_t, false>(bytes_.data() + 20);
    if (mode_ >= kKsplatLayouts.size()) {
      throw_input(file_, fmt::format("has compression level {}; levels 0 to 2 are read", mode_));
    }
    // Zero stands for the usual range.
    const auto range = [&](std::size_t at, float usual) {
      const auto value = load_scalar<float, false>(bytes_.data() + at);
      return value == 0 ? usual : value;
    };
    least_harmonic_ = range(36, -1.5F);
    most_harmonic_ = range(40, 1.5F);
    require_room(sections, kKsplatSectionHeader, bytes_.size() - kKsplatHeader, kTheHeader,
                 "sections", [&](const std::string& message) { throw_input(file_, message); });
    std::size_t at = kKsplatHeader + sections * kKsplatSectionHeader;
    for (std::size_t k = 0; k < sections; ++k) {
      at = read_section(
          bytes_.subspan(kKsplatHeader + k * kKsplatSectionHeader, kKsplatSectionHeader), at);
    }
  }

  /// Bytes [at, at + size) of the file.
  std::span<const std::byte> part(std::size_t at, std::size_t size) const {
    if (at > bytes_.size() || size > bytes_.size() - at) {
      throw_input(file_, "ends within a section; it is truncated or its header is wrong");
    }
    return bytes_.subspan(at, size);
  }

  /// Reads a section whose data begins at `at`; returns where the next one's does.
  std::size_t read_section(std::span<const std::byte> header, std::size_t at) {
    const auto word = [&](std::size_t offset) {
      return std::size_t{load_scalar<std::uint32_t, false>(header.data() + offset)};
    };
    KsplatSection section;
    section.count = word(0);
    const std::size_t room = word(4);
    section.bucket_capacity = word(8);
    const std::size_t buckets = word(12);
    const auto block = load_scalar<float, false>(header.data() + 16);
    const std::size_t bucket_bytes = load_scalar<std::uint16_t, false>(header.data() + 20);
    const std::size_t range = word(24) == 0 ? (mode_ == 0 ? 1 : 32767) : word(24);
    section.full_buckets = word(32);
    const std::size_t partial_buckets = word(36);
    section.degree = load_scalar<std::uint16_t, false>(header.data() + 40);
    if (section.degree > kMostKsplatDegree) {
      throw_input(file_, fmt::format("has spherical harmonics of degree {}; {} at most are there",
                                     section.degree, kMostKsplatDegree));
    }
    const KsplatLayout& layout = kKsplatLayouts[mode_];
    section.stride =
        layout.harmonics + 3 * section.degree * (section.degree + 2) * layout.harmonic_bytes;
    section.position_middle = static_cast<float>(range);
    section.position_unit = block / 2 / static_cast<float>(range);

    const std::span<const std::byte> sizes = part(at, partial_buckets * sizeof(std::uint32_t));
    at += sizes.size();
    section.centers = part(at, buckets * bucket_bytes);
    at += section.centers.size();
    section.records = part(at, room * section.stride);
    if (section.count > room) {
      throw_input(file_, fmt::format("a section has room for {} Gaussians and promises {}", room,
                                     section.count));
    }
    std::size_t end = section.full_buckets * section.bucket_capacity;
    for (std::size_t k = 0; k < partial_buckets; ++k) {
      end += load_scalar<std::uint32_t, false>(sizes.data() + k * sizeof(std::uint32_t));
      section.partial_ends.push_back(end);
    }
    // Uncompressed positions need no bucket.
    constexpr std::size_t kCenter = 3 * sizeof(float);
    if (mode_ != 0 && section.count > 0 &&
        (end < section.count || bucket_bytes != kCenter ||
         section.full_buckets + partial_buckets > buckets)) {
      throw_input(file_, "a section's buckets do not hold its Gaussians; its header is wrong");
    }
    sections_.push_back(std::move(section));
    return at + sections_.back().records.size();
  }

  void decode(const KsplatSection& section, GaussianCloud& cloud) const {
    parallel_each(section.count, kGaussianGrain,
                  [&](std::size_t i) { decode(section, i, cloud, section.first + i); });
  }

  void decode(const KsplatSection& section, std::size_t i, GaussianCloud& cloud,
              std::size_t to) const {
    const KsplatLayout& layout = kKsplatLayouts[mode_];
    const std::span<const std::byte> record =
        section.records.subspan(i * section.stride, section.stride);
    // A number k of those from `at` on.
    const auto number = [&](std::size_t at, std::size_t k) {
      return mode_ == 0
                 ? load_scalar<float, false>(record.data() + at + 4 * k)
                 : float_of_half(load_scalar<std::uint16_t, false>(record.data() + at + 2 * k));
    };
    const std::size_t stride = cloud.harmonics_stride();
    float* const harmonics = cloud.harmonics.data() + to * stride;
    const std::size_t center = mode_ == 0 ? 0 : 3 * sizeof(float) * section.bucket(i);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      cloud.position[to][axis] =
          mode_ == 0
              ? number(0, k)
              : (static_cast<float>(load_scalar<std::uint16_t, false>(record.data() + 2 * k)) -
                 section.position_middle) *
                        section.position_unit +
                    load_scalar<float, false>(section.centers.data() + center + k * sizeof(float));
      cloud.scale[to][axis] = number(layout.scale, k);
      const double shown =
          load_scalar<std::uint8_t, false>(record.data() + layout.color + k) / 255.0;
      harmonics[k] = static_cast<float>((shown - 0.5) / GaussianCloud::kHarmonic0);
    }
    cloud.amplitude[to] =
        static_cast<float>(load_scalar<std::uint8_t, false>(record.data() + layout.color + 3)) /
        255;
    for (std::size_t k = 0; k < 4; ++k) cloud.rotation[to][k] = number(layout.rotation, k);
    std::fill(harmonics + 3, harmonics + stride, 0.0F);
    // Degree by degree, within each the red coefficients, the green ones, the blue ones.
    std::size_t at = 0;
    for (std::size_t degree = 1; degree <= section.degree; ++degree) {
      const std::size_t width = 2 * degree + 1;
      for (std::size_t color = 0; color < 3; ++color) {
        for (std::size_t k = 0; k < width; ++k) {
          harmonics[3 * (degree * degree + k) + color] = harmonic(record, at++);
        }
      }
    }
  }

  float harmonic(std::span<const std::byte> record, std::size_t k) const {
    const KsplatLayout& layout = kKsplatLayouts[mode_];
    const std::size_t at = layout.harmonics + k * layout.harmonic_bytes;
    if (mode_ == 0) return load_scalar<float, false>(record.data() + at);
    if (mode_ == 1) return float_of_half(load_scalar<std::uint16_t, false>(record.data() + at));
    const float share =
        static_cast<float>(load_scalar<std::uint8_t, false>(record.data() + at)) / 255;
    return least_harmonic_ + share * (most_harmonic_ - least_harmonic_);
  }

  const std::string& file_;
  std::span<const std::byte> bytes_;
  std::size_t mode_ = 0;
  float least_harmonic_ = 0;
  float most_harmonic_ = 0;
  std::vector<KsplatSection> sections_;
};

}  // namespace

GaussianCloud read_ksplat(const InputFile& input, const GaussianReadOptions& options) {
  return KsplatReader(input).read(options);
}

}  // namespace surfel
