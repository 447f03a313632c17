#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/level_store.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/level_sink.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Column by which surfels of the finest level of a store's file are found again among the records.
inline constexpr const char* kRecordColumn = "surfel_record";

/// What records of a store look like.
struct StoreLayout {
  std::vector<RecordColumn> columns;
  std::size_t stride = 0;

  StoreLayout() = default;
  /// \param like  any surfels with the columns
  explicit StoreLayout(const SurfelCloud& like);
  std::size_t count(const Array<std::byte>& records) const { return records.size() / stride; }
  /// World coordinates, which are the first three columns, in double precision.
  Vec3d position(const std::byte* record) const;
};

/// The levels of a file of the store, in memory. Surfels of the finest level are records that were
/// there before, and stay as they were: reading and writing a record need not give its own bytes.
class StoreLevels final : public LevelSink {
 public:
  /// Keeps references.
  /// \param finest  records of the surfels, which know their numbers among them by kRecordColumn
  StoreLevels(const StoreLayout& layout, const Array<std::byte>& finest)
      : layout_(layout), finest_(finest) {}

  void begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) override;
  void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) override;
  void finish(ClusterTree tree) override;

  /// The surfels, then the clusters.
  const Array<std::byte>& bytes() const { return bytes_; }
  /// The part without its name.
  LevelStorePart part() const;

 private:
  const StoreLayout& layout_;
  const Array<std::byte>& finest_;
  Vec3d origin_{0, 0, 0};
  std::size_t surfels_ = 0;
  Array<std::byte> bytes_;
  std::vector<TreeLevel> levels_;
};

}  // namespace surfel
