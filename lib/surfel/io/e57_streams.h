#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/io/e57_header.h>
#include <surfel/io/e57_pages.h>

namespace surfel {

/// Values of some fields as they are stored, consecutive ones of each.
struct E57Values {
  struct Stream {
    unsigned first_bit = 0;  ///< Of the first value, in the first byte.
    Array<std::byte> bytes;  ///< With eight more than the values have.
  };
  std::vector<Stream> streams;  ///< One for each field.
};

/// The byte streams of a scan's fields. Data packets follow one another in the file and each holds
/// the next bytes of every stream; a value may begin in one packet and end in the next. The
/// constructor goes over the packets' headers alone and notes where the bytes of the streams are,
/// so that points anywhere in the file are found at once. Internal to the io module.
class E57Streams {
 public:
  /// Throws Error(kInput) naming file and scan where packets are not as E57 has them, or hold fewer
  /// bytes than the points need. Keeps references to both.
  E57Streams(const E57Pages& pages, const E57Scan& scan);

  /// Reads the values of points [begin, end) of some fields, by their numbers. Callable from any
  /// thread.
  void read(std::span<const std::size_t> fields, std::uint64_t begin, std::uint64_t end,
            E57Values& to) const;
  /// The values that were read of a field as numbers.
  void decode(std::size_t field, const E57Values::Stream& from, std::size_t count,
              double* to) const;

 private:
  /// Consecutive bytes of a stream that are together in the file.
  struct Piece {
    std::uint64_t in_stream;
    std::uint64_t in_file;  ///< Logical.
  };
  struct Stream {
    std::vector<Piece> pieces;
    std::uint64_t bytes = 0;  ///< In all pieces.
  };
  void scan_packets(std::uint64_t begin, std::uint64_t end);
  [[noreturn]] void fail(const std::string& message) const;

  const E57Pages& pages_;
  const E57Scan& scan_;
  std::vector<unsigned> bits_;   ///< Of a value of each field.
  std::vector<Stream> streams_;  ///< Of each field; no pieces where a value has no bits.
};

}  // namespace surfel
