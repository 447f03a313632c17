#include <algorithm>
#include <cstring>

#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/io/tree_records.h>
#include <surfel/lod/store_levels.h>

namespace surfel {

StoreLayout::StoreLayout(const SurfelCloud& like) {
  const CloudRecords records(like, {});
  columns = records.columns();
  stride = records.stride();
}

Vec3d StoreLayout::position(const std::byte* record) const {
  Vec3d p;
  for (int axis = 0; axis < 3; ++axis) {
    const auto column = static_cast<std::size_t>(axis);
    p[axis] = load_scalar<double, false>(record + columns[column].offset);
  }
  return p;
}

void StoreLevels::begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) {
  const CloudRecords records(like, {});
  std::vector<RecordColumn> columns = records.columns();
  if (columns.back().name != kRecordColumn) throw_input("", "its columns have no place for more");
  columns.pop_back();
  if (!same_columns(columns, layout_.columns)) {
    throw_input("", "merged surfels have other columns than the surfels themselves");
  }
  origin_ = like.origin;
  surfels_ = surfels;
  const RecordColumn last = tree_columns().back();
  bytes_.resize(surfels * layout_.stride + clusters * (last.offset + scalar_size(last.type)));
}

void StoreLevels::put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) {
  const std::size_t stride = layout_.stride;
  const std::size_t first_finest = surfels_ - layout_.count(finest_);
  const CloudRecords records(part, {});
  Array<std::byte> made((end - begin) * records.stride());
  records.encode(begin, end, made.data());
  for (std::size_t i = 0; i < end - begin; ++i) {
    const std::byte* from = made.data() + i * records.stride();
    if (at + i >= first_finest) {
      from = finest_.data() + load_scalar<std::uint32_t, false>(from + stride) * stride;
    }
    std::memcpy(bytes_.data() + (at + i) * stride, from, stride);
  }
}

void StoreLevels::finish(ClusterTree tree) {
  const Array<std::byte> clusters = tree_to_records(tree, origin_);
  std::copy(clusters.begin(), clusters.end(),
            bytes_.begin() + static_cast<std::ptrdiff_t>(surfels_ * layout_.stride));
  levels_ = levels_of(tree);
  std::reverse(levels_.begin(), levels_.end());
}

LevelStorePart StoreLevels::part() const {
  LevelStorePart part;
  part.checksum = crc32c(bytes_);
  for (const TreeLevel& level : levels_) {
    part.surfels.push_back(static_cast<std::uint32_t>(level.end_surfel - level.first_surfel));
    part.clusters.push_back(static_cast<std::uint32_t>(level.end - level.begin));
  }
  return part;
}

}  // namespace surfel
