// Open Geospatial Consortium, "OGC GeoTIFF Standard", version 1.1, 2019; Adobe, "TIFF", revision
// 6.0, 1992.

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>

#include <surfel/base/error.h>
#include <surfel/io/geo_tiff.h>
#include <surfel/io/las_projection.h>

namespace surfel {
namespace {

/// An entry of a TIFF directory.
struct TiffEntry {
  std::uint16_t tag;
  std::uint16_t type;
  std::uint32_t count;
  std::uint32_t value;
};
static_assert(sizeof(TiffEntry) == 12 && std::endian::native == std::endian::little);

constexpr std::uint16_t kShort = 3;
constexpr std::uint16_t kDouble = 12;

template <class T>
T value_at(const std::vector<unsigned char>& bytes, std::size_t offset) {
  T value{};
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

/// Appends values at an even offset, which TIFF asks for, and returns that.
template <class T>
std::uint32_t append(std::vector<unsigned char>& bytes, const T* values, std::size_t count) {
  if (bytes.size() % 2 != 0) bytes.push_back(0);
  const std::size_t offset = bytes.size();
  bytes.resize(offset + count * sizeof(T));
  std::memcpy(bytes.data() + offset, values, count * sizeof(T));
  return static_cast<std::uint32_t>(offset);
}

}  // namespace

void add_geo_tags(std::vector<unsigned char>& tiff, const MapPlace& place,
                  const std::string& name) {
  constexpr std::size_t kHeader = 8;
  constexpr std::size_t kAdded = 4096;
  const bool classic = tiff.size() >= kHeader && value_at<std::uint16_t>(tiff, 0) == 0x4949 &&
                       value_at<std::uint16_t>(tiff, 2) == 42 &&
                       tiff.size() < std::numeric_limits<std::uint32_t>::max() - kAdded;
  const std::size_t directory = classic ? value_at<std::uint32_t>(tiff, 4) : 0;
  if (!classic || directory + 2 > tiff.size()) {
    throw_io(name, "is not the kind of TIFF file that GeoTIFF's tags are added to");
  }
  const std::size_t count = value_at<std::uint16_t>(tiff, directory);
  if (directory + 2 + count * sizeof(TiffEntry) + 4 > tiff.size()) {
    throw_io(name, "is a TIFF file with a directory that is cut short");
  }
  std::vector<TiffEntry> entries(count);
  std::memcpy(entries.data(), tiff.data() + directory + 2, count * sizeof(TiffEntry));

  const std::array<double, 3> scale{place.pixel, place.pixel, 0};
  const std::array<double, 6> tie{0, 0, 0, place.left, place.top, 0};
  const std::vector<std::uint16_t> keys = geo_keys(place.system);
  entries.push_back({33550, kDouble, 3, append(tiff, scale.data(), scale.size())});
  entries.push_back({33922, kDouble, 6, append(tiff, tie.data(), tie.size())});
  entries.push_back({34735, kShort, static_cast<std::uint32_t>(keys.size()),
                     append(tiff, keys.data(), keys.size())});
  std::sort(entries.begin(), entries.end(),
            [](const TiffEntry& a, const TiffEntry& b) { return a.tag < b.tag; });

  const auto number = static_cast<std::uint16_t>(entries.size());
  const std::uint32_t start = append(tiff, &number, 1);
  append(tiff, entries.data(), entries.size());
  const std::uint32_t last = 0;
  append(tiff, &last, 1);
  std::memcpy(tiff.data() + 4, &start, sizeof(start));
}

}  // namespace surfel
