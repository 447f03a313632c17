#include <algorithm>
#include <cstring>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/laz_points.h>
#include <surfel/laz/chunk_table.h>
#include <surfel/laz/laz_chunk.h>
#include <surfel/laz/range_coder.h>

namespace surfel {
namespace {

constexpr std::uint32_t kVariable =
    ~std::uint32_t{0};  ///< Chunks have their own numbers of points.
constexpr std::uint64_t kTableHead = 8;
constexpr std::uint64_t kMostTableEntry = 16;  ///< Bytes of a chunk's two numbers, at most.

/// The block that LASzip describes the points with.
struct LaszipBlock {
  enum Kind : std::uint16_t { kPointwise = 1, kChunked = 2, kLayered = 3 };
  struct Item {
    std::uint16_t type;
    std::uint16_t size;
    std::uint16_t version;
    bool operator==(const Item&) const = default;
  };

  std::uint16_t kind = 0;
  std::uint16_t coder = 0;
  std::uint32_t chunk_points = 0;
  std::vector<Item> items;

  explicit LaszipBlock(const std::string& bytes) {
    constexpr std::size_t kHead = 34;
    if (bytes.size() < kHead) return;
    std::uint16_t count = 0;
    std::memcpy(&kind, bytes.data(), 2);
    std::memcpy(&coder, bytes.data() + 2, 2);
    std::memcpy(&chunk_points, bytes.data() + 12, 4);
    std::memcpy(&count, bytes.data() + 32, 2);
    items.resize(std::min<std::size_t>(count, (bytes.size() - kHead) / sizeof(Item)));
    if (!items.empty())
      std::memcpy(items.data(), bytes.data() + kHead, items.size() * sizeof(Item));
  }
};

/// The items of a point by their numbers in LASzip.
std::vector<LaszipBlock::Item> items_of(const laz::PointLayout& layout) {
  const bool layered = layout.layered();
  const auto version = static_cast<std::uint16_t>(layered ? layout.layered_version : 2);
  std::vector<LaszipBlock::Item> items;
  const auto add = [&](int type, std::size_t size, std::uint16_t of_version) {
    items.push_back(
        {static_cast<std::uint16_t>(type), static_cast<std::uint16_t>(size), of_version});
  };
  add(layered ? 10 : 6, layered ? 30 : 20, version);
  if (!layered && layout.timed()) add(7, 8, version);
  if (layout.infrared()) {
    add(12, 8, version);
  } else if (layout.colored()) {
    add(layered ? 11 : 8, 6, version);
  }
  if (layout.waves()) add(layered ? 13 : 9, 29, layered ? version : 1);
  if (layout.extra() > 0) add(layered ? 14 : 0, layout.extra(), version);
  return items;
}

template <class T>
T read_value(const InputFile& file, std::uint64_t at) {
  Array<std::byte> scratch;
  T value;
  std::memcpy(&value, file.read_at(at, sizeof(T), scratch), sizeof(T));
  return value;
}

/// Offset of the table of chunks.
std::uint64_t table_begin(const InputFile& file, const LasHeader& header) {
  constexpr std::uint64_t kPlace = sizeof(std::int64_t);
  const auto fail = [&](const char* what) {
    throw_input(file.name(), fmt::format("{}; the file is truncated or damaged", what));
  };
  if (file.size() - header.begin < kPlace) fail("ends before its compressed points");
  auto at = read_value<std::int64_t>(file, header.begin);
  if (at == -1) at = read_value<std::int64_t>(file, file.size() - kPlace);
  const auto begin = static_cast<std::uint64_t>(at);
  if (at < 0 || begin < header.begin + kPlace || file.size() < kTableHead ||
      begin > file.size() - kTableHead) {
    fail("has no table of its chunks of compressed points");
  }
  return begin;
}

}  // namespace

laz::PointLayout laz_layout(const LasHeader& header, const std::string& file) {
  const LaszipBlock block(*header.laszip);
  laz::PointLayout layout = header.layout();
  if (layout.layered() && !block.items.empty() && block.items.front().version == 4) {
    layout.layered_version = 4;
  }
  const bool known_kind = layout.layered() ? block.kind == LaszipBlock::kLayered
                                           : block.kind == LaszipBlock::kPointwise ||
                                                 block.kind == LaszipBlock::kChunked;
  if (!known_kind || block.coder != 0 || block.items != items_of(layout)) {
    throw_input(
        file,
        "has points that are compressed in another way than LASzip 2 and later do; compress "
        "it anew, or make it LAS");
  }
  return layout;
}

std::string laszip_block(const laz::PointLayout& layout, std::uint32_t chunk_points) {
  std::string bytes;
  const auto add = [&](auto value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  add(static_cast<std::uint16_t>(layout.layered() ? LaszipBlock::kLayered : LaszipBlock::kChunked));
  add(std::uint16_t{0});
  // The version of LASzip that writes alike.
  add(std::uint8_t{3});
  add(std::uint8_t{4});
  add(std::uint16_t{3});
  add(std::uint32_t{0});
  add(chunk_points);
  add(std::int64_t{-1});
  add(std::int64_t{-1});
  const std::vector<LaszipBlock::Item> items = items_of(layout);
  add(static_cast<std::uint16_t>(items.size()));
  for (const LaszipBlock::Item& item : items) add(item);
  return bytes;
}

void check_laz_chunk(const InputFile& file, const LasHeader& header, const LazChunk& chunk,
                     std::uint64_t points) {
  const bool inside = chunk.begin <= file.size() && chunk.bytes <= file.size() - chunk.begin;
  if (inside && points <= laz::kMostPointsOfByte * chunk.bytes && chunk.bytes >= header.record) {
    return;
  }
  throw_input(file.name(),
              fmt::format("promises {} compressed points in {} bytes at {}, which cannot be; the "
                          "file is truncated or damaged",
                          points, chunk.bytes, chunk.begin));
}

std::vector<LazChunk> laz_chunks(const InputFile& file, const LasHeader& header) {
  const LaszipBlock block(*header.laszip);
  if (header.count == 0) return {};
  std::vector<LazChunk> chunks;
  if (block.kind == LaszipBlock::kPointwise) {
    chunks.push_back({header.begin, file.size() - header.begin, 0});
    check_laz_chunk(file, header, chunks.front(), header.count);
    return chunks;
  }
  const std::uint64_t table = table_begin(file, header);
  std::uint64_t at = header.begin + sizeof(std::int64_t);
  const std::uint64_t most = (table - at) / header.record;
  const auto number = read_value<std::uint32_t>(file, table + 4);
  const std::uint64_t bytes = std::min<std::uint64_t>(
      file.size() - table,
      kTableHead + kMostTableEntry * std::min<std::uint64_t>(most, number) + 2 * kTableHead);
  const auto damaged = [&](const char* what) {
    throw_input(file.name(), fmt::format("its table of chunks of compressed points {}; the file is "
                                         "truncated or damaged",
                                         what));
  };
  std::vector<laz::ChunkSize> sizes;
  try {
    Array<std::byte> scratch;
    sizes = laz::decode_chunk_table({file.read_at(table, bytes, scratch), bytes},
                                    block.chunk_points == kVariable, block.chunk_points, most);
  } catch (const laz::Damage&) {
    damaged("cannot be read");
  }
  std::uint64_t first = 0;
  for (const laz::ChunkSize& size : sizes) {
    std::uint64_t points = size.points;
    // Of chunks with the same number of points the last one may have fewer.
    if (block.chunk_points != kVariable && &size == &sizes.back() && first < header.count) {
      points = std::min<std::uint64_t>(points, header.count - first);
    }
    const LazChunk chunk{at, size.bytes, first};
    if (chunk.bytes > table - at) damaged("is longer than the points");
    if (points > 0) {
      check_laz_chunk(file, header, chunk, points);
      chunks.push_back(chunk);
    }
    first += points;
    at += chunk.bytes;
  }
  if (first != header.count) {
    damaged(fmt::format("has {} points, the header {}", first, header.count).c_str());
  }
  return chunks;
}

LazPoints::LazPoints(const InputFile& file, const LasHeader& header, std::vector<LazChunk> chunks,
                     std::uint64_t count)
    : file_(file),
      layout_(laz_layout(header, file.name())),
      chunks_(std::move(chunks)),
      count_(count) {}

const std::byte* LazPoints::read(std::size_t block, Array<std::byte>& scratch) const {
  static thread_local Array<std::byte> compressed;
  const LazChunk& chunk = chunks_[block];
  const std::size_t count = first(block + 1) - chunk.first;
  if (scratch.size() < count * layout_.bytes) scratch.resize(count * layout_.bytes);
  const std::byte* bytes = file_.read_at(chunk.begin, chunk.bytes, compressed);
  try {
    laz::decode_chunk(layout_, {bytes, chunk.bytes}, count, scratch.data());
  } catch (const laz::Damage&) {
    throw_input(file_.name(),
                fmt::format("the compressed points {} to {} are damaged; get the file anew",
                            chunk.first, chunk.first + count - 1));
  }
  return scratch.data();
}

}  // namespace surfel
