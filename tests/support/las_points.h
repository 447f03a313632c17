#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <surfel/io/laz_points.h>
#include <surfel/laz/chunk_table.h>
#include <surfel/laz/laz_chunk.h>

namespace surfel::test {

/// How the bytes of made-up points go on.
enum class PointKind {
  kScan,   ///< Values change as a scanner's do.
  kNoise,  ///< Any byte may change to any value.
  kSame    ///< All points are the first one.
};

/// Points of a LAS format as the file's bytes.
inline std::vector<std::byte> made_points(const laz::PointLayout& layout, std::size_t count,
                                          PointKind kind, std::uint32_t state = 12345) {
  std::vector<std::byte> points(count * layout.bytes);
  const auto random = [&](std::uint32_t below) {
    state = state * 1664525 + 1013904223;
    return (state >> 8) % below;
  };
  for (std::size_t i = 0; i < count; ++i) {
    std::byte* point = points.data() + i * layout.bytes;
    if (i > 0) std::memcpy(point, point - layout.bytes, layout.bytes);
    if (kind == PointKind::kSame) {
      if (i == 0) std::fill_n(point, layout.bytes, std::byte{0x11});
      continue;
    }
    if (kind == PointKind::kNoise) {
      for (std::size_t k = 0; k < layout.bytes; ++k) {
        if (i == 0 || random(3) == 0) point[k] = static_cast<std::byte>(random(256));
      }
      continue;
    }
    const auto set = [&](std::size_t at, auto value) {
      std::memcpy(point + at, &value, sizeof(value));
    };
    const auto grow = [&](std::size_t at, std::uint32_t most) {
      std::uint32_t value = 0;
      std::memcpy(&value, point + at, sizeof(value));
      set(at, value + random(most) - most / 3);
    };
    grow(0, 200);
    grow(4, 90);
    grow(8, 40);
    set(12, static_cast<std::uint16_t>(random(900)));
    const std::uint32_t n = 1 + random(4);
    const std::uint32_t r = 1 + random(n);
    if (layout.layered()) {
      set(14, static_cast<std::uint8_t>(n << 4 | r));
      set(15, static_cast<std::uint8_t>((i / 50 % 3) << 4 | (i / 7 % 2) << 6 | i / 90 % 2));
      set(16, static_cast<std::uint8_t>(random(70)));
      set(18, static_cast<std::int16_t>(static_cast<int>(random(300)) - 150));
    } else {
      set(14, static_cast<std::uint8_t>(n << 3 | r | (i / 7 % 2) << 6));
      set(15, static_cast<std::uint8_t>(random(9)));
      set(16, static_cast<std::int8_t>(static_cast<int>(random(30)) - 15));
    }
    set(17, static_cast<std::uint8_t>(i / 100));
    set(layout.layered() ? 20 : 18, static_cast<std::uint16_t>(7000 + i / 200));
    if (layout.timed()) {
      // Two scanners whose times are interleaved, and a pause.
      const double time = 2e5 + static_cast<double>(i % 2) * 50 +
                          static_cast<double>(i / 3) * 1e-5 + (i > count / 2 ? 4000 : 0);
      set(layout.layered() ? 22 : 20, time);
    }
    std::size_t at = layout.base();
    if (layout.colored()) {
      for (std::size_t k = 0; k < 3; ++k) {
        set(at + 2 * k, static_cast<std::uint16_t>(random(4) == 0 ? 30000 : random(65536)));
      }
      at += 6;
    }
    if (layout.infrared()) {
      set(at, static_cast<std::uint16_t>(random(3) * 257));
      at += 2;
    }
    if (layout.waves()) {
      set(at, static_cast<std::uint8_t>(random(3)));
      set(at + 1, std::uint64_t{60} + (random(5) == 0 ? random(1000000) : i * 128));
      set(at + 9, std::uint32_t{128});
      for (std::size_t k = 0; k < 4; ++k) set(at + 13 + 4 * k, static_cast<float>(random(50)));
      at += 29;
    }
    for (; at < layout.bytes; ++at) set(at, static_cast<std::uint8_t>(i / (at % 5 + 1)));
  }
  return points;
}

/// Layout of a point format with so many extra bytes.
inline laz::PointLayout layout_of(int format, std::size_t extra = 0) {
  laz::PointLayout layout{.format = format};
  layout.bytes = layout.format_bytes() + extra;
  return layout;
}

/// A LAS or LAZ file with blocks before its points, as another program writes it.
struct LasFileMaker {
  laz::PointLayout layout;
  int minor = 4;
  std::vector<std::byte> points;
  std::string extra_descriptions;
  std::string copc;
  double scale = 0.01;
  double offset = 1000;

  std::size_t count() const { return points.size() / layout.bytes; }

  /// \param tail  goes behind the blocks; the header's offset of the points is where it begins
  std::string file(const std::string& tail, bool compressed, const std::string& laszip = {}) const {
    std::string blocks;
    std::uint32_t block_count = 0;
    const auto add_block = [&](const char* user, std::uint16_t id, const std::string& bytes) {
      if (bytes.empty()) return;
      std::string head(54, '\0');
      std::memcpy(head.data() + 2, user, std::strlen(user));
      put(head, 18, id);
      put(head, 20, static_cast<std::uint16_t>(bytes.size()));
      blocks += head + bytes;
      ++block_count;
    };
    add_block("copc", 1, copc);
    add_block("LASF_Spec", 4, extra_descriptions);
    add_block("laszip encoded", 22204, laszip);
    std::string head(minor >= 4 ? 375 : minor == 3 ? 235 : 227, '\0');
    std::memcpy(head.data(), "LASF", 4);
    head[24] = 1;
    head[25] = static_cast<char>(minor);
    put(head, 94, static_cast<std::uint16_t>(head.size()));
    put(head, 96, static_cast<std::uint32_t>(head.size() + blocks.size()));
    put(head, 100, block_count);
    head[104] = static_cast<char>(layout.format | (compressed ? 0x80 : 0));
    put(head, 105, static_cast<std::uint16_t>(layout.bytes));
    put(head, 107, static_cast<std::uint32_t>(layout.layered() ? 0 : count()));
    for (std::size_t k = 0; k < 3; ++k) {
      put(head, 131 + 8 * k, scale);
      put(head, 155 + 8 * k, offset);
    }
    if (minor >= 4) put(head, 247, std::uint64_t{count()});
    return head + blocks + tail;
  }
  std::string las() const {
    return file({reinterpret_cast<const char*>(points.data()), points.size()}, false);
  }

  template <class T>
  static void put(std::string& bytes, std::size_t at, T value) {
    std::memcpy(bytes.data() + at, &value, sizeof(value));
  }
};

/// Where the file says that its chunks are listed.
enum class TableAt { kInFront, kAtTheEnd };

/// The maker's points as LAZ in chunks of these numbers of points; one number is for all chunks.
inline std::string laz_of(const LasFileMaker& maker, const std::vector<std::uint32_t>& counts,
                          TableAt place = TableAt::kInFront) {
  const bool variable = counts.size() > 1;
  std::string chunks;
  std::vector<laz::ChunkSize> sizes;
  for (std::size_t first = 0; first < maker.count();) {
    const std::size_t wanted = counts[variable ? sizes.size() : 0];
    const std::size_t count = std::min(wanted, maker.count() - first);
    const auto chunk =
        laz::encode_chunk(maker.layout, maker.points.data() + first * maker.layout.bytes, count);
    chunks.append(chunk.begin(), chunk.end());
    sizes.push_back({static_cast<std::uint32_t>(count), static_cast<std::uint32_t>(chunk.size())});
    first += count;
  }
  const auto table = laz::encode_chunk_table(sizes, variable);
  const std::string laszip =
      laszip_block(maker.layout, variable ? ~std::uint32_t{0} : counts.front());
  std::string tail(8, '\xFF');
  const std::size_t begin = maker.file("", true, laszip).size();
  const std::uint64_t table_at = begin + 8 + chunks.size();
  if (place == TableAt::kInFront) LasFileMaker::put(tail, 0, table_at);
  tail += chunks + std::string(table.begin(), table.end());
  if (place == TableAt::kAtTheEnd) {
    tail.resize(tail.size() + 8);
    LasFileMaker::put(tail, tail.size() - 8, table_at);
  }
  return maker.file(tail, true, laszip);
}

/// The points of a LAS file, without its header.
inline std::string points_in(const std::string& las) {
  std::uint32_t begin = 0;
  std::memcpy(&begin, las.data() + 96, sizeof(begin));
  return las.substr(begin);
}

}  // namespace surfel::test
