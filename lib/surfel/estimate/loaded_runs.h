#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/run_index.h>

namespace surfel {

/// Which runs of a cloud are in memory, and how far around a place that makes all points known.
class SURFEL_API LoadedRuns {
 public:
  /// No runs. Refers to the index, which has its tree.
  explicit LoadedRuns(const RunIndex& index) : index_(index) { loaded_.assign(index.size(), 0); }

  void add(std::size_t run);
  /// Adds the runs whose boxes come as near to a box as this.
  void add_near(const RunBox& box, float reach);

  bool has(std::size_t run) const { return loaded_[run] != 0; }
  /// Points of all runs that are loaded.
  std::size_t finite() const { return finite_; }
  /// For each of some places: all points of the cloud that are nearer than this belong to loaded
  /// runs. Infinity where all runs are loaded. Places that are near to each other cost least.
  /// \param exact  The distances are the largest there are; else they may be less, which takes less
  ///     time.
  void known_around(std::span<const Vec3f> places, bool exact, float* known) const;

 private:
  const RunIndex& index_;
  Array<std::uint8_t> loaded_;
  std::size_t finite_ = 0;
};

}  // namespace surfel
