#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/e57_streams.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::size_t kSectionHeaderBytes = 32;
constexpr auto kPointsSection = std::byte{1};
constexpr auto kIndexPacket = std::byte{0};
constexpr auto kDataPacket = std::byte{1};
constexpr auto kIgnoredPacket = std::byte{2};
/// Before the lengths of a data packet's streams.
constexpr std::size_t kPacketHeaderBytes = 6;
/// Bytes behind the values, so that eight can be read from anywhere.
constexpr std::size_t kStreamPadding = 8;

/// Values of `bits` bits each, the lowest bit first, as unsigned numbers.
template <class Take>
void unpack_bits(const E57Values::Stream& from, unsigned bits, std::size_t count,
                 const Take& take) {
  const std::uint64_t mask = bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
  std::uint64_t at = from.first_bit;
  for (std::size_t i = 0; i < count; ++i, at += bits) {
    const std::byte* bytes = from.bytes.data() + (at >> 3);
    const auto skipped = static_cast<unsigned>(at & 7);
    std::uint64_t value;
    std::memcpy(&value, bytes, sizeof(value));
    value >>= skipped;
    if (skipped + bits > 64) {
      value |= std::to_integer<std::uint64_t>(bytes[8]) << (64 - skipped);
    }
    take(i, value & mask);
  }
}

}  // namespace

E57Streams::E57Streams(const E57Pages& pages, const E57Scan& scan)
    : pages_(pages), scan_(scan), streams_(scan.fields.size()) {
  for (const E57Field& field : scan.fields) bits_.push_back(field.bits());
  std::array<std::byte, kSectionHeaderBytes> head;
  if (pages.size() - scan.section < head.size()) fail("its points are cut off");
  E57Window window(pages, 1);
  window.copy(scan.section, head.size(), head.data());
  if (head[0] != kPointsSection) fail("there are no points where the file says that they are");
  const auto length = load_scalar<std::uint64_t, false>(head.data() + 8);
  require_room(
      length, 1, pages.size() - scan.section,
      [&] { return fmt::format("scan {}", scan.number + 1); }, "bytes of points",
      [&](const std::string& message) { throw_input(pages_.file().name(), message); });
  const std::uint64_t begin =
      pages.logical(load_scalar<std::uint64_t, false>(head.data() + 16), "points");
  const std::uint64_t end = scan.section + length;
  if (begin < scan.section || begin > end) fail("its points begin outside of their section");
  scan_packets(begin, end);
  for (std::size_t f = 0; f < streams_.size(); ++f) {
    // No product: the count may be anything.
    const std::uint64_t held = bits_[f] == 0 ? scan.count : streams_[f].bytes * 8 / bits_[f];
    if (held >= scan.count) continue;
    fail(fmt::format(
        "promises {} points, and its packets hold {} of {} for {} of them; the file "
        "is truncated or its header is wrong",
        scan.count, held == 0 ? "no values" : "values", quoted_excerpt(scan.fields[f].name), held));
  }
}

void E57Streams::fail(const std::string& message) const {
  throw_input(pages_.file().name(), fmt::format("scan {}: {}", scan_.number + 1, message));
}

void E57Streams::scan_packets(std::uint64_t begin, std::uint64_t end) {
  E57Window window(pages_, 1);
  const std::size_t lengths = 2 * streams_.size();
  Array<std::byte> head(kPacketHeaderBytes + lengths);
  while (end - begin >= kPacketHeaderBytes) {
    window.copy(begin, kPacketHeaderBytes, head.data());
    const std::uint64_t size =
        load_scalar<std::uint16_t, false>(head.data() + 2) + std::uint64_t{1};
    const auto damaged = [&](const char* what) {
      fail(fmt::format("{} at byte {} of its points; the file is damaged", what,
                       begin - scan_.section));
    };
    if (size < kPacketHeaderBytes || size > end - begin) damaged("a packet has no such length,");
    if (head[0] == kDataPacket) {
      if (load_scalar<std::uint16_t, false>(head.data() + 4) != streams_.size()) {
        damaged("a packet has another number of fields than the points,");
      }
      if (size < head.size()) damaged("a packet is shorter than its header,");
      window.copy(begin + kPacketHeaderBytes, lengths, head.data() + kPacketHeaderBytes);
      std::uint64_t at = head.size();
      for (std::size_t f = 0; f < streams_.size(); ++f) {
        const std::size_t bytes =
            load_scalar<std::uint16_t, false>(head.data() + kPacketHeaderBytes + 2 * f);
        if (bytes > size - at) damaged("a packet's fields are longer than the packet,");
        if (bytes > 0 && bits_[f] > 0) {
          streams_[f].pieces.push_back({streams_[f].bytes, begin + at});
          streams_[f].bytes += bytes;
        }
        at += bytes;
      }
    } else if (head[0] != kIndexPacket && head[0] != kIgnoredPacket) {
      damaged("there is no packet of E57");
    }
    begin += size;
  }
}

void E57Streams::read(std::span<const std::size_t> fields, std::uint64_t begin, std::uint64_t end,
                      E57Values& to) const {
  struct Part {
    std::uint64_t in_file;
    std::size_t bytes;
    std::byte* to;
  };
  std::vector<Part> parts;
  to.streams.resize(fields.size());
  for (std::size_t k = 0; k < fields.size(); ++k) {
    const unsigned bits = bits_[fields[k]];
    E57Values::Stream& out = to.streams[k];
    const std::uint64_t first = begin * bits / 8;
    const std::uint64_t last = (end * bits + 7) / 8;
    out.first_bit = static_cast<unsigned>(begin * bits % 8);
    out.bytes.resize(last - first + kStreamPadding);
    std::memset(out.bytes.data() + (last - first), 0, kStreamPadding);
    if (bits == 0) continue;
    const Stream& stream = streams_[fields[k]];
    auto piece =
        std::upper_bound(stream.pieces.begin(), stream.pieces.end(), first,
                         [](std::uint64_t place, const Piece& p) { return place < p.in_stream; });
    for (std::uint64_t at = first; at < last; ++piece) {
      const Piece& p = *std::prev(piece);
      const std::uint64_t stop =
          std::min(last, piece == stream.pieces.end() ? stream.bytes : piece->in_stream);
      parts.push_back({p.in_file + (at - p.in_stream), static_cast<std::size_t>(stop - at),
                       out.bytes.data() + (at - first)});
      at = stop;
    }
  }
  // Streams take turns within a packet: in the order of the file every page is read once.
  std::sort(parts.begin(), parts.end(),
            [](const Part& a, const Part& b) { return a.in_file < b.in_file; });
  constexpr std::size_t kPagesAtOnce = 64;  // About a packet.
  E57Window window(pages_, kPagesAtOnce);
  for (const Part& part : parts) window.copy(part.in_file, part.bytes, part.to);
}

void E57Streams::decode(std::size_t field, const E57Values::Stream& from, std::size_t count,
                        double* to) const {
  const E57Field& f = scan_.fields[field];
  switch (f.type) {
    case E57Type::kSingle:
      return unpack_bits(from, 32, count, [&](std::size_t i, std::uint64_t bits) {
        to[i] = static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)));
      });
    case E57Type::kDouble:
      return unpack_bits(from, 64, count, [&](std::size_t i, std::uint64_t bits) {
        to[i] = std::bit_cast<double>(bits);
      });
    case E57Type::kInteger:
    case E57Type::kScaled:
    case E57Type::kText:
      break;
  }
  const auto least = static_cast<std::uint64_t>(f.min);
  // Where a scale is 0.001, a quotient is the double next to the number that is meant, unlike a
  // product and a sum.
  const double per_unit = std::round(1 / f.scale);
  const double shift = f.offset * per_unit;
  const bool whole = 1 / per_unit == f.scale && shift == std::round(shift);
  unpack_bits(from, bits_[field], count, [&](std::size_t i, std::uint64_t bits) {
    // The sum of unsigned numbers is the signed one's bits.
    const auto steps = static_cast<double>(static_cast<std::int64_t>(least + bits));
    to[i] = whole ? (steps + shift) / per_unit : steps * f.scale + f.offset;
  });
}

}  // namespace surfel
