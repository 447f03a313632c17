#pragma once

#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Takes the surfels of all levels of detail, which are made part by part in no order.
class SURFEL_API LevelSink {
 public:
  LevelSink() = default;
  virtual ~LevelSink() = default;
  LevelSink(const LevelSink&) = delete;
  LevelSink& operator=(const LevelSink&) = delete;

  /// Comes before all else.
  /// \param like      some surfels with the columns that all will have, and all that holds for the
  ///                  whole cloud
  /// \param surfels   of all levels
  /// \param clusters  of the tree
  virtual void begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) = 0;
  /// Takes the surfels [begin, end) of a part, which are the tree's surfels from `at` on. Several
  /// threads call it at once.
  virtual void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) = 0;
  /// Comes once all surfels are there.
  virtual void finish(ClusterTree tree) = 0;
};

}  // namespace surfel
