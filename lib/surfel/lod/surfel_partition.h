#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/surfel_merge.h>

namespace surfel {

/// Divides surfels into groups to be merged: starts with one group of all, and cuts the one that
/// would be the worst surfel in two, across its longest direction, until there are as many as asked
/// for. So pieces have about the same size where the surface is alike, and what must not be merged
/// (two sheets, a sharp edge, materials, known and unknown normals) is cut before the rest, unless
/// there are not enough groups for that. Keeps its memory from call to call.
class SURFEL_API SurfelPartition {
 public:
  /// Divides them into 1 <= groups <= surfels.size() groups. The result depends on the surfels and
  /// their order alone.
  void run(std::span<const MergeSurfel> surfels, std::size_t groups, const SheetRules& rules);

  std::size_t size() const { return groups_.size(); }
  std::span<const std::uint32_t> members(std::size_t group) const {
    return {order_.data() + groups_[group].begin, order_.data() + groups_[group].end};
  }
  /// Square of the length on the longer side of what a group stands for, scene unit^2.
  float extent2(std::size_t group) const { return groups_[group].extent2; }

 private:
  struct Group {
    std::uint32_t begin, end;
    float badness;  ///< The group to cut next has the largest.
    float extent2;
    bool conflict;  ///< It holds what must not be merged.
    Vec3f mean;
    Vec3f cut;  ///< Members are on a side by the sign of cut . (position - mean).
  };

  Group measure(std::uint32_t begin, std::uint32_t end) const;
  std::uint32_t cut(const Group& group);
  std::uint32_t cut_conflict(const Group& group);
  template <class Side>
  std::uint32_t divide(const Group& group, Side side);

  std::span<const MergeSurfel> surfels_;
  float normal_cosine_ = 0;
  float stretch_ = 0;
  float piece2_ = 0;  ///< Square of a mean group's size.
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> scratch_;
  std::vector<Group> groups_;
  std::vector<std::uint32_t> heap_;
};

}  // namespace surfel
