#include <algorithm>
#include <numeric>

#include <surfel/lod/level_plan.h>

namespace surfel {
namespace {

constexpr std::size_t kMostBlock = std::size_t{1} << 17;

std::size_t divided(std::size_t count, int reduction) {
  const auto by = static_cast<std::size_t>(reduction);
  return (count + by - 1) / by;
}

std::size_t clusters_of(std::size_t surfels) {
  return (surfels + kClusterSurfels - 1) / kClusterSurfels;
}

/// How many surfels and clusters a block has in a level.
struct BlockSize {
  std::size_t surfels, clusters;
};

/// \param count  surfels of the finest level
BlockSize block_size(std::size_t count, std::size_t level, int reduction) {
  BlockSize size{count, clusters_of(count)};
  for (std::size_t l = 0; l < level; ++l) {
    // All clusters but the last are full, and so are their children.
    size.surfels = divided(size.surfels, reduction);
    size.clusters = divided(size.clusters, reduction);
  }
  return size;
}

/// Levels up to a single cluster of a block of so many surfels.
std::size_t levels_of_block(std::size_t surfels, int reduction) {
  std::size_t levels = 1;
  for (std::size_t n = clusters_of(surfels); n > 1; n = divided(n, reduction)) ++levels;
  return levels;
}

/// A block, or a cluster above the blocks.
struct Node {
  std::uint32_t surfels = 0;
  Vec3f min{0, 0, 0}, max{0, 0, 0};
  std::vector<std::uint32_t> children;  ///< Of the level below.

  Vec3f center() const { return min + (max - min) / 2; }
};

/// The nodes above some.
class Grouping {
 public:
  Grouping(const std::vector<Node>& nodes, int reduction)
      : nodes_(nodes), reduction_(reduction), order_(nodes.size()) {
    std::iota(order_.begin(), order_.end(), 0U);
    split(0, order_.size());
  }
  std::vector<Node> take() { return std::move(groups_); }

 private:
  void split(std::size_t begin, std::size_t end) {
    std::size_t surfels = 0;
    Vec3f low = nodes_[order_[begin]].center();
    Vec3f high = low;
    for (std::size_t i = begin; i < end; ++i) {
      const Node& node = nodes_[order_[i]];
      surfels += node.surfels;
      low = low.cwiseMin(node.center());
      high = high.cwiseMax(node.center());
    }
    const std::size_t most = kClusterSurfels * static_cast<std::size_t>(reduction_);
    if (surfels <= most) return group(begin, end, surfels);
    Eigen::Index axis = 0;
    (high - low).maxCoeff(&axis);
    std::sort(order_.begin() + static_cast<std::ptrdiff_t>(begin),
              order_.begin() + static_cast<std::ptrdiff_t>(end),
              [&](std::uint32_t a, std::uint32_t b) {
                const float x = nodes_[a].center()[axis];
                const float y = nodes_[b].center()[axis];
                return x != y ? x < y : a < b;
              });
    // So many clusters are needed at least; each side gets a whole number of them.
    const std::size_t clusters = (surfels + most - 1) / most;
    const std::size_t wanted = surfels * (clusters / 2) / clusters;
    std::size_t middle = begin + 1;
    std::size_t before = nodes_[order_[begin]].surfels;
    while (middle + 1 < end && before + nodes_[order_[middle]].surfels <= wanted) {
      before += nodes_[order_[middle++]].surfels;
    }
    split(begin, middle);
    split(middle, end);
  }
  void group(std::size_t begin, std::size_t end, std::size_t surfels) {
    Node node = nodes_[order_[begin]];
    node.surfels = static_cast<std::uint32_t>(divided(surfels, reduction_));
    node.children.assign(order_.begin() + static_cast<std::ptrdiff_t>(begin),
                         order_.begin() + static_cast<std::ptrdiff_t>(end));
    for (const std::uint32_t child : node.children) {
      node.min = node.min.cwiseMin(nodes_[child].min);
      node.max = node.max.cwiseMax(nodes_[child].max);
    }
    groups_.push_back(std::move(node));
  }

  const std::vector<Node>& nodes_;
  int reduction_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> groups_;
};

}  // namespace

std::size_t most_block_surfels(int reduction) {
  std::size_t most = kClusterSurfels;
  while (most * static_cast<std::size_t>(reduction) <= kMostBlock) {
    most *= static_cast<std::size_t>(reduction);
  }
  return most;
}

LevelPlan::LevelPlan(const std::vector<CurveBlock>& blocks, int reduction) : reduction_(reduction) {
  std::size_t largest = 0;
  for (const CurveBlock& block : blocks) {
    counts_.push_back(block.count);
    largest = std::max<std::size_t>(largest, block.count);
  }
  block_levels_ = levels_of_block(largest, reduction);

  // The roots of the blocks, and all levels above them.
  std::vector<std::vector<Node>> nodes(1);
  for (const CurveBlock& block : blocks) {
    const BlockSize root = block_size(block.count, block_levels_ - 1, reduction);
    nodes[0].push_back({static_cast<std::uint32_t>(root.surfels), block.min, block.max, {}});
  }
  while (nodes.back().size() > 1) {
    std::vector<Node> above = Grouping(nodes.back(), reduction).take();
    nodes.push_back(std::move(above));
  }

  // Children follow one another: each level is put into the order of the level above it.
  upper_.resize(nodes.size() - 1);
  std::vector<std::uint32_t> order{0};
  for (std::size_t k = nodes.size() - 1; k > 0; --k) {
    std::vector<std::uint32_t> below;
    for (const std::uint32_t i : order) {
      const Node& node = nodes[k][i];
      Upper upper{{}, {node.min, node.max}};
      upper.cluster.level = static_cast<std::uint8_t>(block_levels_ + k - 1);
      upper.cluster.child_count = static_cast<std::uint32_t>(node.children.size());
      upper.cluster.end = node.surfels;
      upper_[k - 1].push_back(upper);
      below.insert(below.end(), node.children.begin(), node.children.end());
    }
    order = std::move(below);
  }
  place_levels(order);
}

/// \param order  the blocks in the order of the tree
void LevelPlan::place_levels(const std::vector<std::uint32_t>& order) {
  levels_.resize(block_levels_ + upper_.size());
  LevelPart next;
  for (std::size_t l = levels_.size(); l-- > block_levels_;) {
    std::vector<Upper>& clusters = upper_[l - block_levels_];
    LevelPart& level = levels_[l];
    level = {next.first_surfel, next.first_cluster, 0, clusters.size()};
    std::size_t child = level.first_cluster + clusters.size();
    for (Upper& upper : clusters) {
      TreeCluster& cluster = upper.cluster;
      cluster.begin = static_cast<std::uint32_t>(level.first_surfel + level.surfels);
      level.surfels += cluster.end;
      cluster.end += cluster.begin;
      cluster.first_child = static_cast<std::uint32_t>(child);
      child += cluster.child_count;
    }
    next = {level.first_surfel + level.surfels, level.first_cluster + level.clusters, 0, 0};
  }
  starts_.resize(counts_.size() * block_levels_);
  for (std::size_t l = block_levels_; l-- > 0;) {
    LevelPart& level = levels_[l];
    level = {next.first_surfel, next.first_cluster, 0, 0};
    for (const std::uint32_t b : order) {
      starts_[b * block_levels_ + l] = {
          static_cast<std::uint32_t>(level.first_surfel + level.surfels),
          static_cast<std::uint32_t>(level.first_cluster + level.clusters)};
      const BlockSize size = block_size(counts_[b], l, reduction_);
      level.surfels += size.surfels;
      level.clusters += size.clusters;
    }
    next = {level.first_surfel + level.surfels, level.first_cluster + level.clusters, 0, 0};
  }
}

std::vector<LevelPart> LevelPlan::block(std::size_t block) const {
  std::vector<LevelPart> parts;
  for (std::size_t l = 0; l < block_levels_; ++l) {
    const Start& start = starts_[block * block_levels_ + l];
    const BlockSize size = block_size(counts_[block], l, reduction_);
    parts.push_back({start.surfel, start.cluster, size.surfels, size.clusters});
  }
  return parts;
}

}  // namespace surfel
