#pragma once

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/parallel.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Are two names of columns equal if case is ignored?
inline bool same_name(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](unsigned char c, unsigned char d) {
    return std::tolower(c) == std::tolower(d);
  });
}

/// A named scalar in every record of a table.
struct RecordColumn {
  std::string name;
  ScalarType type = ScalarType::kFloat32;
  std::size_t offset = 0;  ///< Bytes from the record's start; need not be aligned.
};

/// Records that are made block by block whenever they are read: a compressed file has no others.
/// Internal to the library.
class RecordBlocks {
 public:
  virtual ~RecordBlocks() = default;
  virtual std::size_t blocks() const = 0;
  /// The first record of a block; the number of all records for block blocks().
  virtual std::size_t first(std::size_t block) const = 0;
  /// The records of a block, made in `scratch`. Callable from any thread.
  virtual const std::byte* read(std::size_t block, Array<std::byte>& scratch) const = 0;
};

/// Records of equal size, one after the other, as PLY and PCD store them. The table is a view of
/// records in memory, in a file or in blocks, which must outlive it. Internal to the library.
struct RecordTable {
  const std::byte* data = nullptr;  ///< The first record, unless the records are elsewhere.
  const InputFile* file = nullptr;
  const RecordBlocks* blocks = nullptr;  ///< All records; only for_pieces() reads them.
  std::size_t offset = 0;                ///< Offset of the first record in `file`.
  std::size_t count = 0;
  std::size_t stride = 0;  ///< Bytes from one record to the next.
  bool swapped = false;    ///< Values are in the other byte order than this machine's.
  std::vector<RecordColumn> columns;
  /// Bounds of the points as a header tells them, true or not: where they are true the points are
  /// placed in one pass instead of two.
  std::optional<Bounds> said_bounds;
  /// The coordinates are multiples of a step, the finest of the axes, 0: of none. The cloud's
  /// origin is a central_origin(), so that up to 2^24 steps between two points are exact as floats.
  double step = 0;

  /// Drops the first records; not for records in blocks.
  void skip(std::size_t records) {
    if (file) {
      offset += records * stride;
    } else {
      data += records * stride;
    }
    count -= records;
  }
  /// Records [begin, end): a view of them, or a copy in `scratch`, see InputFile::read_at(). Not
  /// for records in blocks.
  const std::byte* read(std::size_t begin, std::size_t end, Array<std::byte>& scratch) const {
    if (!file) return data + begin * stride;
    return file->read_at(offset + begin * stride, (end - begin) * stride, scratch);
  }
  /// The number of pieces that for_pieces() has.
  std::size_t pieces(std::size_t grain) const {
    return blocks ? blocks->blocks() : (count + grain - 1) / grain;
  }
  /// Calls body(piece, begin, end, records, worker) for all records, piece by piece in parallel:
  /// `grain` records each, or the blocks.
  template <class Body>
  void for_pieces(std::size_t grain, const Body& body) const {
    parallel_for(pieces(grain), 1, [&](std::size_t piece, std::size_t, int worker) {
      static thread_local Array<std::byte> scratch;
      const std::size_t begin = blocks ? blocks->first(piece) : piece * grain;
      const std::size_t end = blocks ? blocks->first(piece + 1) : std::min(begin + grain, count);
      if (begin == end) return;
      const std::byte* records = blocks ? blocks->read(piece, scratch) : read(begin, end, scratch);
      body(piece, begin, end, records, worker);
    });
  }
  const RecordColumn* find(std::string_view name) const {
    for (const RecordColumn& column : columns) {
      if (column.name == name) return &column;
    }
    return nullptr;
  }
};

/// PLY's name of a type: "uchar", "float" and so on.
constexpr const char* scalar_name(ScalarType type) {
  constexpr const char* kNames[] = {"char", "uchar", "short", "ushort",
                                    "int",  "uint",  "float", "double"};
  return kNames[static_cast<std::size_t>(type)];
}

/// The value at an address of any alignment, its bytes reversed if `kSwapped`.
template <class T, bool kSwapped>
T load_scalar(const std::byte* from) {
  if constexpr (!kSwapped || sizeof(T) == 1) {
    T value;
    std::memcpy(&value, from, sizeof(T));
    return value;
  } else {
    using Bits =
        std::conditional_t<sizeof(T) == 2, std::uint16_t,
                           std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>>;
    Bits bits;
    std::memcpy(&bits, from, sizeof(T));
    if constexpr (sizeof(T) == 2) bits = __builtin_bswap16(bits);
    if constexpr (sizeof(T) == 4) bits = __builtin_bswap32(bits);
    if constexpr (sizeof(T) == 8) bits = __builtin_bswap64(bits);
    return std::bit_cast<T>(bits);
  }
}

/// Can `value` be stored in To without becoming another number? Rounding to float is allowed.
template <class To, class From>
bool representable(From value) {
  if constexpr (std::is_floating_point_v<To>) {
    return true;
  } else if constexpr (std::is_floating_point_v<From>) {
    // One past the largest, which is a power of two, is exact in every floating type.
    constexpr To kHalf = std::numeric_limits<To>::max() / 2 + 1;
    constexpr double kEnd = 2.0 * static_cast<double>(kHalf);
    return value >= static_cast<double>(std::numeric_limits<To>::min()) &&
           static_cast<double>(value) < kEnd && value == std::trunc(value);
  } else {
    return static_cast<std::int64_t>(value) >= std::int64_t{std::numeric_limits<To>::min()} &&
           static_cast<std::int64_t>(value) <= std::int64_t{std::numeric_limits<To>::max()};
  }
}

}  // namespace surfel
