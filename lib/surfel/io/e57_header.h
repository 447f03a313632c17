#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <surfel/io/e57_pages.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// How the values of a field are stored, one after the other without gaps.
enum class E57Type : std::uint8_t {
  kSingle,   ///< A float.
  kDouble,   ///< A double.
  kInteger,  ///< As many bits as the range asks for, above the least value.
  kScaled,   ///< An integer, scaled and shifted.
  kText,     ///< Strings, which are not read.
};

/// A field of a scan's points.
struct E57Field {
  std::string name;  ///< With its prefix, if it has one: "cartesianX", "nor:normalX".
  E57Type type = E57Type::kDouble;
  std::int64_t min = 0;  ///< Of integers.
  std::int64_t max = 0;
  double scale = 1;
  double offset = 0;

  /// Bits of a value; 0 where all values are equal, and for text.
  unsigned bits() const;
  /// The values of an integer that the bits can tell, in scene units if it is scaled; finite.
  double least() const { return static_cast<double>(min) * scale + offset; }
  double most() const;
};

/// A range of values that a file tells.
struct E57Limits {
  double min = 0;
  double max = 0;
};

/// A scan with at least one point.
struct E57Scan {
  std::string name;
  std::size_t number = 0;         ///< Among all scans of the file, from 0.
  std::uint64_t section = 0;      ///< Logical address of its points.
  std::uint64_t count = 0;        ///< Of points.
  std::vector<E57Field> fields;   ///< In the order of their byte streams.
  std::optional<Viewpoint> pose;  ///< From the scan's coordinates to the file's; unset: the same.
  /// Least and most of red, green and blue, where they are told.
  std::array<std::optional<E57Limits>, 3> color;

  const E57Field* find(std::string_view field) const;
};

/// What an E57 file (ASTM E2807, version 1) tells about its scans. Throws Error(kInput) naming the
/// file where a page is damaged or the header, the XML or a scan's description is wrong, and where
/// no scan has points. Internal to the io module.
struct E57Header {
  explicit E57Header(const InputFile& file);
  static bool matches(std::span<const std::byte> bytes);

  E57Pages pages;
  std::vector<E57Scan> scans;
};

}  // namespace surfel
