#include <cstring>

#include <surfel/laz/chunk_table.h>
#include <surfel/laz/integer_coder.h>

namespace surfel::laz {
namespace {

constexpr std::size_t kHead =
    8;  ///< Bytes of the version, which is 0, and of the number of chunks.

/// Codes the chunks one by one: numbers by their differences from the
/// numbers of the chunk before.
template <class Coder>
void code_chunks(Coder& coder, bool variable, std::vector<ChunkSize>& chunks) {
  IntegerCoder numbers(32, 2);
  ChunkSize last;
  for (ChunkSize& chunk : chunks) {
    if (variable) {
      chunk.points = numbers.code(coder, 0, last.points, [&] { return chunk.points; });
    }
    chunk.bytes = numbers.code(coder, 1, last.bytes, [&] { return chunk.bytes; });
    last = chunk;
  }
}

}  // namespace

std::vector<std::uint8_t> encode_chunk_table(std::span<const ChunkSize> chunks, bool variable) {
  const auto count = static_cast<std::uint32_t>(chunks.size());
  std::vector<std::uint8_t> table(kHead);
  std::memcpy(table.data() + 4, &count, sizeof(count));
  if (chunks.empty()) return table;
  std::vector<ChunkSize> sizes(chunks.begin(), chunks.end());
  RangeEncoder coder;
  code_chunks(coder, variable, sizes);
  coder.finish();
  table.insert(table.end(), coder.bytes().begin(), coder.bytes().end());
  return table;
}

std::vector<ChunkSize> decode_chunk_table(std::span<const std::byte> table, bool variable,
                                          std::uint32_t chunk_points, std::uint64_t most) {
  std::uint32_t head[2];
  if (table.size() < kHead) throw Damage();
  std::memcpy(head, table.data(), kHead);
  if (head[0] != 0 || head[1] > most) throw Damage();
  std::vector<ChunkSize> chunks(head[1], ChunkSize{chunk_points, 0});
  if (chunks.empty()) return chunks;
  RangeDecoder coder(table.subspan(kHead));
  code_chunks(coder, variable, chunks);
  return chunks;
}

}  // namespace surfel::laz
