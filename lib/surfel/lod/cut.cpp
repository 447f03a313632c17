#include <algorithm>

#include <surfel/lod/cut.h>

namespace surfel {

std::vector<std::uint32_t> cut_tree(const ClusterTree& tree,
                                    FunctionRef<CutStep(std::uint32_t cluster)> step) {
  std::vector<std::uint32_t> drawn;
  std::vector<std::uint32_t> level;
  std::vector<std::uint32_t> next;
  if (!tree.empty()) level.push_back(0);
  // Level by level: the children of ascending clusters ascend, in breadth-first order.
  while (!level.empty()) {
    next.clear();
    for (const std::uint32_t i : level) {
      const CutStep what = step(i);
      if (what == CutStep::kSkip) continue;
      const TreeCluster& cluster = tree[i];
      if (what == CutStep::kDraw || cluster.child_count == 0) {
        drawn.push_back(i);
        continue;
      }
      for (std::uint32_t k = 0; k < cluster.child_count; ++k) {
        next.push_back(cluster.first_child + k);
      }
    }
    level.swap(next);
  }
  return drawn;
}

float covering_variance(double error, double lowpass) {
  const double spacing = error / kLongerSide;
  if (!(spacing > lowpass)) return 0;
  const double filtered = lowpass / spacing;
  return static_cast<float>(1 - filtered * filtered);
}

}  // namespace surfel
