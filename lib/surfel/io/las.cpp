#include <algorithm>
#include <atomic>
#include <memory>

#include <surfel/base/error.h>
#include <surfel/io/cloud_comments.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/copc.h>
#include <surfel/io/las.h>
#include <surfel/io/las_header.h>
#include <surfel/io/las_layout.h>
#include <surfel/io/las_projection.h>
#include <surfel/io/las_writer.h>
#include <surfel/io/laz_points.h>
#include <surfel/io/narrow_colors.h>
#include <surfel/io/text_scanner.h>

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

}  // namespace

struct LasPoints::Impl {
  InputFile input;
  LasHeader header;
  LasLayout layout;
  std::unique_ptr<RecordBlocks> points;
  std::unique_ptr<ExpandedPoints> records;
  RecordTable table;

  explicit Impl(InputFile file)
      : input(std::move(file)), header(input), layout(header, input.name()) {}

  void open(const CloudReadOptions& options) {
    table.count = header.count;
    if (options.level || (options.bounds && header.copc)) {
      CopcPart part = copc_part(input, header, options.level, options.bounds);
      table.count = part.count;
      if (part.count == 0 && options.bounds) {
        throw_input(input.name(), "holds no points within the `bounds`");
      }
      points = std::make_unique<LazPoints>(input, header, std::move(part.chunks), part.count);
    } else if (header.compressed) {
      points = std::make_unique<LazPoints>(input, header, laz_chunks(input, header), header.count);
    } else {
      points = std::make_unique<PlainPoints>(input, header);
    }
    records = std::make_unique<ExpandedPoints>(*points, layout);
    table.blocks = records.get();
    table.stride = layout.stride();
    table.columns = layout.columns();
    table.step = header.storage.scale.cwiseAbs().minCoeff();
    if (header.bounds.min.allFinite() && header.bounds.max.allFinite()) {
      table.said_bounds = header.bounds;
    }
  }
};

LasPoints::LasPoints(InputFile file, const CloudReadOptions& options)
    : impl_(std::make_unique<Impl>(std::move(file))) {
  impl_->open(options);
}
LasPoints::~LasPoints() = default;

const RecordTable& LasPoints::table() const { return impl_->table; }
const std::string& LasPoints::file() const { return impl_->input.name(); }

void LasPoints::describe(SurfelCloud& cloud) const {
  cloud.up = Vec3d::UnitZ();
  cloud.las = impl_->header.storage;
  narrow_colors(cloud, impl_->records->brightest());
  const std::optional<CoordinateSystem> system = las_projection(cloud.las->records);
  if (system) cloud.comments.push_back(coordinate_system_comment(*system));
  // Comments that this program wrote are in a block of their own.
  std::vector<LasRecord>& blocks = cloud.las->records;
  const auto comments = std::find_if(blocks.begin(), blocks.end(), [](const LasRecord& block) {
    return block.user == kCommentUser && block.id == kCommentId;
  });
  if (comments == blocks.end()) return;
  TextScanner in({}, comments->bytes);
  std::vector<std::string> lines;
  for (; !in.at_end(); in.next_line()) lines.emplace_back(in.rest_of_line());
  blocks.erase(comments);
  // The blocks of LAS say it.
  std::erase_if(lines, [&](const std::string& line) {
    return system && line == coordinate_system_comment(*system);
  });
  read_comments(lines, impl_->input.name(), cloud);
}

}  // namespace surfel
