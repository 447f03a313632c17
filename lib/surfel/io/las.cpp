#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>

#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/copc.h>
#include <surfel/io/las.h>
#include <surfel/io/las_header.h>
#include <surfel/io/las_layout.h>
#include <surfel/io/laz_points.h>

namespace surfel {
namespace {

/// Points of an uncompressed file, read some thousands at a time.
class PlainPoints final : public RecordBlocks {
 public:
  PlainPoints(const InputFile& file, const LasHeader& header) : file_(file), header_(header) {}

  std::size_t blocks() const override { return (header_.count + kBlock - 1) / kBlock; }
  std::size_t first(std::size_t block) const override {
    return std::min<std::size_t>(block * kBlock, header_.count);
  }
  const std::byte* read(std::size_t block, Array<std::byte>& scratch) const override {
    const std::size_t begin = first(block);
    return file_.read_at(header_.begin + begin * header_.record,
                         (first(block + 1) - begin) * header_.record, scratch);
  }

 private:
  static constexpr std::size_t kBlock = 8192;  ///< Points: their bytes stay in a core's cache.
  const InputFile& file_;
  const LasHeader& header_;
};

/// Points as records of plain scalars.
class ExpandedPoints final : public RecordBlocks {
 public:
  ExpandedPoints(const RecordBlocks& points, const LasLayout& layout)
      : points_(points), layout_(layout) {}

  std::size_t blocks() const override { return points_.blocks(); }
  std::size_t first(std::size_t block) const override { return points_.first(block); }
  const std::byte* read(std::size_t block, Array<std::byte>& scratch) const override {
    static thread_local Array<std::byte> own;
    const std::size_t count = first(block + 1) - first(block);
    const std::byte* points = points_.read(block, own);
    if (scratch.size() < count * layout_.stride()) scratch.resize(count * layout_.stride());
    const std::uint16_t brightest = layout_.expand(points, count, scratch.data());
    std::uint16_t known = brightest_;
    while (known < brightest && !brightest_.compare_exchange_weak(known, brightest)) {
    }
    return scratch.data();
  }
  /// The largest value of the colours that were read so far.
  int brightest() const { return brightest_; }

 private:
  const RecordBlocks& points_;
  const LasLayout& layout_;
  mutable std::atomic<std::uint16_t> brightest_{0};
};

/// Makes 8-bit colours of colours that were read as if they had 16 bits. Values up to 255 of
/// 65,535 lie on the linear part of the sRGB curve, where they are told apart by their size.
void narrow(SurfelCloud& cloud) {
  const float darkest = srgb16_to_linear(1);
  const auto code = [&](float linear) {
    return static_cast<std::uint8_t>(std::lround(linear / darkest));
  };
  constexpr std::size_t kGrain = std::size_t{1} << 15;
  parallel_each(cloud.size(), kGrain, [&](std::size_t i) {
    for (float& channel : cloud.color[i]) channel = srgb8_to_linear(code(channel));
  });
  cloud.color_encoding = ColorEncoding::kUint8Srgb;
}

}  // namespace

SurfelCloud read_las(const InputFile& file, const CloudReadOptions& options) {
  const LasHeader header(file);
  const LasLayout layout(header, file.name());
  std::unique_ptr<RecordBlocks> points;
  std::uint64_t count = header.count;
  if (options.level || (options.bounds && header.copc)) {
    CopcPart part = copc_part(file, header, options.level, options.bounds);
    count = part.count;
    if (count == 0 && options.bounds) {
      throw_input(file.name(), "holds no points within the `bounds`");
    }
    points = std::make_unique<LazPoints>(file, header, std::move(part.chunks), count);
  } else if (header.compressed) {
    points = std::make_unique<LazPoints>(file, header, laz_chunks(file, header), count);
  } else {
    points = std::make_unique<PlainPoints>(file, header);
  }
  const ExpandedPoints records(*points, layout);
  RecordTable table;
  table.blocks = &records;
  table.count = count;
  table.stride = layout.stride();
  table.columns = layout.columns();
  table.stepped = true;
  if (header.bounds.min.allFinite() && header.bounds.max.allFinite()) {
    table.said_bounds = header.bounds;
  }
  SurfelCloud cloud = cloud_from_records(table, file.name(), true);
  cloud.up = Vec3d::UnitZ();
  cloud.las = header.storage;
  if (cloud.color_encoding == ColorEncoding::kUint16Srgb && records.brightest() <= 255) {
    narrow(cloud);
    if (records.brightest() == 0) cloud.color = {};
  }
  return cloud;
}

}  // namespace surfel
