#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/laz/point_layout.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Point formats 0 to 10 are known.
inline constexpr int kLasFormats = 11;

/// The header of a LAS file (versions 1.0 to 1.4) or LAZ file, and the blocks beside its points:
/// ASPRS, LAS specification 1.4 R15. Everything is checked against the file's size before memory
/// is taken for it. Internal to the io module.
struct SURFEL_API LasHeader {
  int minor = 0;            ///< Of version 1.
  std::size_t begin = 0;    ///< Offset of the first point, or of compressed points.
  bool compressed = false;  ///< LAZ.
  std::uint64_t count = 0;
  std::size_t record = 0;  ///< Bytes of a point.
  LasStorage storage;      ///< Without the blocks that tell how points are stored.
  Bounds bounds;
  std::string extra;                  ///< Descriptions of extra bytes, 192 bytes each.
  std::optional<std::string> laszip;  ///< How points are compressed.
  std::optional<std::string> copc;    ///< Where a COPC file's tree is.

  /// Throws Error(kInput) naming the file and what is wrong.
  explicit LasHeader(const InputFile& file);

  /// Does the content start as a LAS file does?
  static bool matches(std::span<const std::byte> bytes);
  /// What a point consists of.
  laz::PointLayout layout() const { return {.format = storage.point_format, .bytes = record}; }
};

}  // namespace surfel
