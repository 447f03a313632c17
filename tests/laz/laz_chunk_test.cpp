#include <cstring>

#include <gtest/gtest.h>
#include <surfel/laz/chunk_table.h>
#include <surfel/laz/laz_chunk.h>
#include <surfel/laz/range_coder.h>

#include "support/las_points.h"

namespace surfel::test {
namespace {

using laz::PointLayout;

/// Layouts of all point formats, with and without extra bytes, in both versions of layers.
std::vector<PointLayout> layouts() {
  std::vector<PointLayout> all;
  for (int format = 0; format <= 10; ++format) {
    for (const std::size_t extra : {0, 5}) {
      for (int version = 3; version <= (format >= 6 ? 4 : 3); ++version) {
        PointLayout layout{.format = format, .layered_version = version};
        layout.bytes = layout.format_bytes() + extra;
        all.push_back(layout);
      }
    }
  }
  return all;
}

std::span<const std::byte> bytes_of(const std::vector<std::uint8_t>& chunk) {
  return std::as_bytes(std::span(chunk));
}

TEST(LazChunk, LayoutsHaveTheBytesOfTheirFormats) {
  // LAS 1.4 R15, tables 7 to 17.
  constexpr std::size_t kBytes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  for (const PointLayout& layout : layouts()) {
    EXPECT_EQ(layout.format_bytes(), kBytes[layout.format]);
  }
}

TEST(LazChunk, EveryFormatReadsBackByteForByte) {
  for (const PointLayout& layout : layouts()) {
    for (const PointKind kind : {PointKind::kScan, PointKind::kNoise, PointKind::kSame}) {
      for (const std::size_t count : {1, 2, 3000}) {
        const std::vector<std::byte> points = made_points(layout, count, kind);
        const std::vector<std::uint8_t> chunk = laz::encode_chunk(layout, points.data(), count);
        std::vector<std::byte> read(points.size());
        laz::decode_chunk(layout, bytes_of(chunk), count, read.data());
        ASSERT_TRUE(read == points) << "format " << layout.format << ", " << layout.bytes
                                    << " bytes, version " << layout.layered_version << ", kind "
                                    << static_cast<int>(kind) << ", " << count << " points";
      }
    }
  }
}

TEST(LazChunk, ScansBecomeSmallAndEqualPointsNearlyNothing) {
  for (const PointLayout& layout : layouts()) {
    constexpr std::size_t kCount = 50000;
    const std::vector<std::byte> scan = made_points(layout, 2000, PointKind::kScan);
    EXPECT_LT(laz::encode_chunk(layout, scan.data(), 2000).size(), scan.size() * 3 / 4);
    const std::vector<std::byte> same = made_points(layout, kCount, PointKind::kSame);
    const std::size_t bytes = laz::encode_chunk(layout, same.data(), kCount).size();
    EXPECT_LT(bytes, layout.bytes + 4000);
    EXPECT_LT(kCount, laz::kMostPointsOfByte * bytes);
  }
}

/// Decodes and expects a full result or Damage, and nothing else.
bool decodes(const PointLayout& layout, std::span<const std::byte> chunk, std::size_t count) {
  std::vector<std::byte> read(count * layout.bytes);
  try {
    laz::decode_chunk(layout, chunk, count, read.data());
    return true;
  } catch (const laz::Damage&) {
    return false;
  }
}

TEST(LazChunk, CutOffAndChangedBytesAreDamageOrOtherPoints) {
  constexpr std::size_t kCount = 60;
  for (const PointLayout& layout : layouts()) {
    const std::vector<std::byte> points = made_points(layout, kCount, PointKind::kScan);
    const std::vector<std::uint8_t> chunk = laz::encode_chunk(layout, points.data(), kCount);
    for (std::size_t left = 0; left + 20 < chunk.size(); left += 1 + left / 2) {
      EXPECT_FALSE(decodes(layout, bytes_of(chunk).first(left), kCount))
          << "format " << layout.format << ", " << left << " bytes";
    }
    EXPECT_FALSE(decodes(layout, bytes_of(chunk), 30 * kCount));
    for (std::size_t at = 0; at < chunk.size(); at += 13) {
      std::vector<std::uint8_t> changed = chunk;
      changed[at] = static_cast<std::uint8_t>(changed[at] ^ (at % 3 == 0 ? 0xFF : 1 << at % 8));
      decodes(layout, bytes_of(changed), kCount);
    }
    // The first bytes of the code: all ones are the one value that no coder writes.
    std::vector<std::uint8_t> ones = chunk;
    std::fill(ones.begin() + static_cast<std::ptrdiff_t>(layout.bytes), ones.end(), 0xFF);
    EXPECT_FALSE(decodes(layout, bytes_of(ones), kCount));
  }
}

TEST(ChunkTable, ReadsBackWithAndWithoutNumbersOfPoints) {
  std::vector<laz::ChunkSize> chunks;
  for (std::uint32_t i = 0; i < 200; ++i)
    chunks.push_back({50000 - i * i, 300000 + i * 977 % 5000});
  chunks.push_back({0, 0xFFFFFFFF});
  const auto variable = laz::encode_chunk_table(chunks, true);
  EXPECT_EQ(laz::decode_chunk_table(bytes_of(variable), true, 0, 1000), chunks);
  for (laz::ChunkSize& chunk : chunks) chunk.points = 777;
  const auto fixed = laz::encode_chunk_table(chunks, false);
  EXPECT_EQ(laz::decode_chunk_table(bytes_of(fixed), false, 777, 1000), chunks);
  EXPECT_LT(fixed.size(), variable.size());
  EXPECT_TRUE(
      laz::decode_chunk_table(bytes_of(laz::encode_chunk_table({}, false)), false, 5, 0).empty());
  EXPECT_THROW(laz::decode_chunk_table(bytes_of(fixed), false, 777, 200), laz::Damage);
  EXPECT_THROW(laz::decode_chunk_table(bytes_of(fixed).first(40), false, 777, 1000), laz::Damage);
  EXPECT_THROW(laz::decode_chunk_table(bytes_of(fixed).first(5), false, 777, 1000), laz::Damage);
}

}  // namespace
}  // namespace surfel::test
