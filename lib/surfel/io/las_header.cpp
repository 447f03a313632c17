#include <bit>
#include <cstring>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/las_header.h>
#include <surfel/io/promises.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

static_assert(std::endian::native == std::endian::little, "LAS is little-endian");

constexpr std::size_t kLeastHeader = 227;
constexpr std::size_t kHeaderOf14 = 375;
constexpr std::size_t kBlockHeader = 54;
constexpr std::size_t kLateBlockHeader = 60;  ///< Of a block behind the points.
/// Blocks are kept in memory, whole: what is longer, such as waveforms, is left in the file.
constexpr std::uint64_t kMostBlock = std::uint64_t{1} << 24;

template <class T>
T value_at(std::span<const std::byte> bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

Vec3d vector_at(std::span<const std::byte> bytes, std::size_t at, std::size_t step) {
  return {value_at<double>(bytes, at), value_at<double>(bytes, at + step),
          value_at<double>(bytes, at + 2 * step)};
}

/// Text in a field that zeros fill up.
std::string text_at(std::span<const std::byte> bytes, std::size_t at, std::size_t most) {
  const std::string_view field = as_text(bytes.subspan(at, most));
  return std::string(field.substr(0, field.find('\0')));
}

/// Sorts the blocks of a file into a header.
class BlockReader {
 public:
  BlockReader(const InputFile& file, LasHeader& header) : file_(file), header_(header) {}

  /// `count` blocks from `at` on that end before `end`; the header of a block is longer
  /// where blocks are `late`, behind the points.
  void read(std::uint64_t count, std::uint64_t at, std::uint64_t end, bool late) {
    const std::size_t size = late ? kLateBlockHeader : kBlockHeader;
    const auto fail = [&](const std::string& message) { throw_input(file_.name(), message); };
    const char* things = late ? "blocks behind the points" : "blocks before the points";
    if (count > 0 && at > end) require_room(count, size, 0, kTheHeader, things, fail);
    require_room(count, size, count > 0 ? end - at : 0, kTheHeader, things, fail);
    for (std::uint64_t i = 0; i < count; ++i) {
      if (end - at < size) fail(truncated(things, i, count));
      Array<std::byte> scratch;
      const std::span<const std::byte> head(file_.read_at(at, size, scratch), size);
      const std::uint64_t bytes =
          late ? value_at<std::uint64_t>(head, 20) : value_at<std::uint16_t>(head, 20);
      at += size;
      if (end - at < bytes) fail(truncated(things, i, count));
      take({.user = text_at(head, 2, 16),
            .id = value_at<std::uint16_t>(head, 18),
            .description = text_at(head, late ? 28 : 22, 32),
            .bytes = {}},
           at, bytes);
      at += bytes;
    }
  }

 private:
  static std::string truncated(const char* things, std::uint64_t i, std::uint64_t count) {
    return fmt::format(
        "the header promises {} {}, and block {} is not whole; the file is truncated or its header "
        "is wrong",
        count, things, i + 1);
  }

  void take(LasRecord block, std::uint64_t at, std::uint64_t bytes) {
    if (bytes > kMostBlock) return;
    Array<std::byte> scratch;
    if (bytes > 0) block.bytes = as_text({file_.read_at(at, bytes, scratch), bytes});
    if (block.user == "laszip encoded" && block.id == 22204) {
      header_.laszip = std::move(block.bytes);
    } else if (block.user == "LASF_Spec" && block.id == 4) {
      header_.extra = std::move(block.bytes);
    } else if (block.user == "copc" && block.id == 1) {
      header_.copc = std::move(block.bytes);
    } else if (block.user != "copc") {  // The tree's pages are found by the block above.
      header_.storage.records.push_back(std::move(block));
    }
  }

  const InputFile& file_;
  LasHeader& header_;
};

}  // namespace

bool LasHeader::matches(std::span<const std::byte> bytes) {
  return as_text(bytes).starts_with("LASF");
}

LasHeader::LasHeader(const InputFile& file) {
  const std::span<const std::byte> head = file.head(kHeaderOf14);
  const auto fail = [&](const std::string& message) { throw_input(file.name(), message); };
  if (head.size() < kLeastHeader) fail("is cut off within the LAS header");
  const int major = std::to_integer<int>(head[24]);
  minor = std::to_integer<int>(head[25]);
  if (major != 1 || minor > 4) {
    fail(fmt::format("is LAS {}.{}; 1.0 to 1.4 are supported", major, minor));
  }
  const bool of14 = minor >= 4;
  const auto size = value_at<std::uint16_t>(head, 94);
  if (size < (of14 ? kHeaderOf14 : kLeastHeader) || size > file.size()) {
    fail(fmt::format("says that its LAS header has {} bytes; the file is damaged", size));
  }
  begin = value_at<std::uint32_t>(head, 96);
  if (begin < size || begin > file.size()) {
    fail(
        fmt::format("has its points at byte {} of {}; the file is truncated or its header is wrong",
                    begin, file.size()));
  }
  // The two highest bits mark compressed points.
  const int format = std::to_integer<int>(head[104]);
  compressed = (format & 0xC0) != 0;
  storage.point_format = format & 0x3F;
  if (storage.point_format >= kLasFormats) {
    fail(fmt::format("has points of format {}; 0 to 10 are supported", storage.point_format));
  }
  record = value_at<std::uint16_t>(head, 105);
  const std::size_t least = layout().format_bytes();
  if (record < least) {
    fail(fmt::format("has points of {} bytes, and format {} takes {}; the header is wrong", record,
                     storage.point_format, least));
  }
  count = value_at<std::uint32_t>(head, 107);
  if (of14) {
    const auto wide = value_at<std::uint64_t>(head, 247);
    if (count == 0 || wide != 0) count = wide;
  }
  storage.global_encoding = value_at<std::uint16_t>(head, 6);
  storage.scale = vector_at(head, 131, 8);
  storage.offset = vector_at(head, 155, 8);
  if (!storage.scale.allFinite() || !storage.offset.allFinite() ||
      (storage.scale.array() == 0).any()) {
    fail("has a scale that is zero or not finite; the header is wrong");
  }
  bounds = {vector_at(head, 187, 16), vector_at(head, 179, 16)};
  if (!compressed) {
    require_room(count, record, file.size() - begin, kTheHeader, "points", fail);
  }
  BlockReader blocks(file, *this);
  blocks.read(value_at<std::uint32_t>(head, 100), size, begin, false);
  if (of14) {
    blocks.read(value_at<std::uint32_t>(head, 243), value_at<std::uint64_t>(head, 235), file.size(),
                true);
  }
  if (compressed && !laszip) fail("has compressed points and does not say how; it is damaged");
}

}  // namespace surfel
