#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include <surfel/base/box_tree.h>
#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_ranges.h>

namespace surfel {

/// Box around the centres of some surfels, and how far they reach.
struct ReachBox {
  Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
  Vec3f high = Vec3f::Constant(-std::numeric_limits<float>::infinity());
  float reach = 0;

  void add(const Vec3f& center, float radius);
  void add(const ReachBox& other);
  bool empty() const { return !(low.x() <= high.x()); }
  /// False only if no surfel of this box meets a surfel of the other one.
  bool may_meet(const ReachBox& other) const;
};

struct SurfelHaloOptions {
  /// Writes how far each of the surfels [begin, end) of a cloud reaches, scene units; negative:
  /// it meets no other. At most kHaloRun surfels, which follow each other in the cloud.
  std::function<void(const SurfelCloud& cloud, std::size_t begin, std::size_t end, float* reach)>
      reach;
  /// The columns that the work needs of surfels; empty: all.
  std::function<SurfelCloud(const SurfelCloud&)> columns = {};
};

/// Surfels of a run: what is kept of a cloud that is not in memory is a box for each.
inline constexpr std::size_t kHaloRun = 1024;

/// Finds the surfels around a block of a cloud that need not be in memory: all that meet one of the
/// block, as two surfels do whose distance is at most the sum of their reaches. 32 bytes a run.
class SURFEL_API SurfelHalo {
 public:
  /// Reads the cloud once. Keeps a reference to it.
  SurfelHalo(const SurfelRanges& cloud, SurfelHaloOptions options);

  /// A block among the surfels around it, in the order of the cloud.
  struct Around {
    SurfelCloud cloud;
    std::vector<std::size_t> number;  ///< In the whole cloud.
    std::size_t before = 0;           ///< How many come before the block's first.
  };
  /// \param begin  number of the block's first surfel
  /// \param scale  of all reaches
  Around around(const SurfelCloud& block, std::size_t begin, float scale = 1) const;

 private:
  const SurfelRanges& cloud_;
  SurfelHaloOptions options_;
  std::vector<ReachBox> runs_;
  BoxTree<ReachBox, 8, 8> tree_;  ///< Of the runs.
};

}  // namespace surfel
