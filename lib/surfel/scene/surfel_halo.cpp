#include <algorithm>
#include <array>
#include <utility>

#include <surfel/base/box_tree.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/surfel_halo.h>

namespace surfel {
namespace {

constexpr std::size_t kHaloGrain = 64;
/// Surfels that are read at once for the boxes of runs.
constexpr std::size_t kHaloPiece = 64 * kHaloRun;

/// The boxes of single surfels; those that meet no other have none.
Array<ReachBox> boxes_of(const SurfelCloud& cloud, const SurfelHaloOptions& options, float scale) {
  Array<ReachBox> boxes(cloud.size());
  parallel_for(cloud.size(), kHaloRun, [&](std::size_t begin, std::size_t end, int) {
    std::array<float, kHaloRun> reach;
    options.reach(cloud, begin, end, reach.data());
    for (std::size_t i = begin; i < end; ++i) {
      boxes[i] = {};
      if (reach[i - begin] >= 0) boxes[i].add(cloud.position[i], scale * reach[i - begin]);
    }
  });
  return boxes;
}

/// Tells which surfels, and runs of surfels, may meet the surfels of a block. A curve through space
/// jumps: boxes of some consecutive surfels may be as large as the cloud, the boxes of single
/// surfels are not.
class BlockReach {
 public:
  explicit BlockReach(Array<ReachBox> boxes)
      : boxes_(std::move(boxes)), tree_(boxes_.size(), [&](std::size_t i) { return boxes_[i]; }) {}

  bool may_meet(const ReachBox& other) const {
    if (other.empty()) return false;
    bool found = false;
    tree_.for_each_leaf([&](const ReachBox& box) { return !found && box.may_meet(other); },
                        [&](std::size_t leaf) {
                          tree_.for_each_item(leaf, [&](std::size_t i) {
                            found = found || boxes_[i].may_meet(other);
                          });
                        });
    return found;
  }

 private:
  Array<ReachBox> boxes_;
  BoxTree<ReachBox, 8, 4> tree_;
};

}  // namespace

void ReachBox::add(const Vec3f& center, float radius) {
  low = low.cwiseMin(center);
  high = high.cwiseMax(center);
  reach = std::max(reach, radius);
}

void ReachBox::add(const ReachBox& other) {
  low = low.cwiseMin(other.low);
  high = high.cwiseMax(other.high);
  reach = std::max(reach, other.reach);
}

bool ReachBox::may_meet(const ReachBox& other) const {
  if (empty() || other.empty()) return false;
  constexpr float kRounding = 1 + 1e-5F;
  const Vec3f gap = (low - other.high).cwiseMax(other.low - high).cwiseMax(0.0F);
  return gap.norm() <= (reach + other.reach) * kRounding;
}

SurfelHalo::SurfelHalo(const SurfelRanges& cloud, SurfelHaloOptions options)
    : cloud_(cloud), options_(std::move(options)) {
  ProgressStage stage("measuring surfels", cloud_.size(), "surfels");
  for (std::size_t begin = 0; begin < cloud_.size(); begin += kHaloPiece) {
    const std::size_t end = std::min(begin + kHaloPiece, cloud_.size());
    const Array<ReachBox> boxes = boxes_of(cloud_.read(begin, end), options_, 1);
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      if (i % kHaloRun == 0) runs_.emplace_back();
      runs_.back().add(boxes[i]);
    }
    stage.add(end - begin);
  }
  tree_ = {runs_.size(), [&](std::size_t run) { return runs_[run]; }};
}

SurfelHalo::Around SurfelHalo::around(const SurfelCloud& block, std::size_t begin,
                                      float scale) const {
  const std::size_t end = begin + block.size();
  const BlockReach own(boxes_of(block, options_, scale));
  const auto columns = [&](const SurfelCloud& cloud) {
    return options_.columns ? options_.columns(cloud) : cloud;
  };
  Around out;
  std::vector<SurfelCloud> parts;
  const auto take = [&](std::size_t from, std::size_t to) {
    const SurfelCloud piece = cloud_.read(from, to);
    const Array<ReachBox> boxes = boxes_of(piece, options_, scale);
    Array<std::uint8_t> near(piece.size());
    parallel_each(piece.size(), kHaloGrain,
                  [&](std::size_t i) { near[i] = own.may_meet(boxes[i]) ? 1 : 0; });
    Array<std::uint32_t> rows;
    for (std::size_t i = 0; i < piece.size(); ++i) {
      if (near[i] == 0) continue;
      rows.push_back(static_cast<std::uint32_t>(i));
      out.number.push_back(from + i);
    }
    if (!rows.empty()) parts.push_back(columns(piece).gathered(rows));
  };
  const auto near = [&](ReachBox box) {
    box.reach *= scale;
    return own.may_meet(box);
  };
  std::vector<std::size_t> runs;
  tree_.for_each_leaf(near, [&](std::size_t leaf) {
    tree_.for_each_item(leaf, [&](std::size_t run) {
      if (near(runs_[run])) runs.push_back(run);
    });
  });
  // The first and the last run of the block may go on outside of it.
  for (const std::size_t run : runs) {
    const std::size_t to = std::min(begin, (run + 1) * kHaloRun);
    if (run * kHaloRun < to) take(run * kHaloRun, to);
  }
  out.before = out.number.size();
  parts.push_back(columns(block));
  for (std::size_t i = begin; i < end; ++i) out.number.push_back(i);
  for (const std::size_t run : runs) {
    const std::size_t from = std::max(end, run * kHaloRun);
    const std::size_t to = std::min(cloud_.size(), (run + 1) * kHaloRun);
    if (from < to) take(from, to);
  }

  out.cloud = cloud_of_rows(parts.front(), out.number.size());
  std::size_t at = 0;
  for (const SurfelCloud& part : parts) {
    copy_rows(part, 0, part.size(), out.cloud, at);
    at += part.size();
  }
  return out;
}

}  // namespace surfel
