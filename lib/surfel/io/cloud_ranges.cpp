#include <utility>

#include <fmt/format.h>
#include <surfel/base/shell_quote.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/input_file.h>
#include <surfel/io/open_points.h>

namespace surfel {

struct CloudRanges::Impl {
  std::unique_ptr<PointRecords> points;
  RangeReader reader;

  explicit Impl(std::unique_ptr<PointRecords> of) : points(std::move(of)), reader(*points) {}
};

CloudRanges::CloudRanges(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CloudRanges::~CloudRanges() = default;

std::unique_ptr<CloudRanges> CloudRanges::open(const std::string& path) {
  std::unique_ptr<PointRecords> points = open_records(InputFile(path));
  if (!points) return nullptr;
  return std::unique_ptr<CloudRanges>(new CloudRanges(std::make_unique<Impl>(std::move(points))));
}

const std::string& CloudRanges::name() const { return impl_->points->file(); }
std::size_t CloudRanges::size() const { return impl_->points->table().count; }
SurfelCloud CloudRanges::read(std::size_t begin, std::size_t end) const {
  return impl_->reader.read(begin, end);
}
Array<Vec3f> CloudRanges::positions(std::size_t begin, std::size_t end) const {
  return impl_->reader.positions(begin, end);
}
const Bounds& CloudRanges::bounds() const { return impl_->reader.place().bounds; }
const Vec3d& CloudRanges::origin() const { return impl_->reader.place().origin; }
std::size_t CloudRanges::stride() const { return impl_->points->table().stride; }

MortonGrid CloudRanges::grid() const {
  if (bounds().empty()) return {};
  // Rounding keeps the order: the bounds of the rounded positions are the rounded bounds.
  return {(bounds().min - origin()).cast<float>(), (bounds().max - origin()).cast<float>()};
}

std::string range_advice(const std::string& path) {
  return fmt::format("put it into order first: surfel-convert --sort curve {} -o sorted.ply",
                     shell_file(path));
}

}  // namespace surfel
