// M. Isenburg, LASzip: lossless compression of LiDAR data, Photogrammetric Engineering & Remote
// Sensing 79(2), 2013; LAZ specification 1.4 (rapidlasso, 2022).

#include <surfel/laz/layered_codec.h>
#include <surfel/laz/laz_chunk.h>
#include <surfel/laz/pointwise_codec.h>

namespace surfel::laz {

std::vector<std::uint8_t> encode_chunk(const PointLayout& layout, const std::byte* points,
                                       std::size_t count) {
  std::vector<std::uint8_t> chunk;
  (layout.layered() ? encode_layered : encode_pointwise)(layout, points, count, chunk);
  return chunk;
}

void decode_chunk(const PointLayout& layout, std::span<const std::byte> chunk, std::size_t count,
                  std::byte* points) {
  (layout.layered() ? decode_layered : decode_pointwise)(layout, chunk, count, points);
}

}  // namespace surfel::laz
