#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/measure/rank_selection.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Each call makes one pass over a cloud: it hands on all surfels in their order, piece by piece.
/// All pieces have the same columns and the same origin.
using CloudPasses = std::function<void(FunctionRef<void(const SurfelCloud& piece)> visit)>;

/// cloud_statistics() of a cloud that comes piece by piece: the same figures, to the last bit. The
/// pieces are handed on twice, to add() and, once it has had all of them, to look(); then they are
/// read three times more for the spacing and the coverage, four times where more discs lie over
/// each other than are looked at.
class StreamedStatistics {
 public:
  /// \param pieces   Passes over the cloud.
  /// \param memory   Bytes that samples may take.
  /// \param options  Cutoff and samples of the measures.
  StreamedStatistics(CloudPasses pieces, std::uint64_t memory,
                     const CloudStatisticsOptions& options);

  void add(const SurfelCloud& piece);
  void look(const SurfelCloud& piece);
  /// All figures. Throws Error(kUsage) where the samples do not fit into the memory.
  CloudStatistics finish();
  /// The share of holes with other options, after finish(); 1 where it is not known.
  double holes(const CloudStatisticsOptions& options) const;

 private:
  void measure(const CloudStatisticsOptions& options, CloudStatistics& out) const;
  void choose();

  CloudPasses pieces_;
  std::uint64_t memory_;
  CloudStatisticsOptions options_;
  CloudStatistics counted_;
  bool normals_ = false;
  bool variances_ = false;
  bool chosen_ = false;
  std::uint64_t finite_ = 0;  ///< Surfels with finite positions.
  /// Largest variances of these, 0 where they are not usable: radii ascend with them at any cutoff.
  RankSelection variance_;
  float largest_variance_ = 0;
  double radius_sum_ = 0;
  std::vector<float> ranked_;  ///< Variances at 0, 0.05, 0.5, 0.95 and 1, and of the upper median.
};

}  // namespace surfel
