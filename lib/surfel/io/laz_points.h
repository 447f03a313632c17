#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/io/las_header.h>
#include <surfel/io/record_table.h>
#include <surfel/laz/point_layout.h>

namespace surfel {

/// Where a chunk of compressed points is.
struct LazChunk {
  std::uint64_t begin = 0;  ///< Offset in the file.
  std::uint64_t bytes = 0;
  std::uint64_t first = 0;  ///< Number of points in the chunks before.
};

/// What a header tells about compressed points. Throws Error(kInput) naming `file` for points that
/// LASzip 2 and later do not write.
laz::PointLayout laz_layout(const LasHeader& header, const std::string& file);
/// The reverse: the block that tells readers how points of the layout are compressed, in chunks of
/// so many.
SURFEL_API std::string laszip_block(const laz::PointLayout& layout, std::uint32_t chunk_points);
/// The table of a LAZ file's chunks, also where its place stands at the file's end (-1), checked
/// against the file's size. Throws Error(kInput).
std::vector<LazChunk> laz_chunks(const InputFile& file, const LasHeader& header);
/// Throws Error(kInput) where a chunk cannot hold so many points or is not in the file.
void check_laz_chunk(const InputFile& file, const LasHeader& header, const LazChunk& chunk,
                     std::uint64_t points);

/// Points of a LAZ file, decompressed chunk by chunk whenever they are read. Internal to the io
/// module.
class LazPoints final : public RecordBlocks {
 public:
  /// Chunks in their order; `count` points in all.
  LazPoints(const InputFile& file, const LasHeader& header, std::vector<LazChunk> chunks,
            std::uint64_t count);

  std::size_t blocks() const override { return chunks_.size(); }
  std::size_t first(std::size_t block) const override {
    return block < chunks_.size() ? chunks_[block].first : count_;
  }
  /// Throws Error(kInput) for a chunk that is damaged.
  const std::byte* read(std::size_t block, Array<std::byte>& scratch) const override;

 private:
  const InputFile& file_;
  laz::PointLayout layout_;
  std::vector<LazChunk> chunks_;
  std::uint64_t count_;
};

}  // namespace surfel
