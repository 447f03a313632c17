#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/surface/sheet.h>

namespace surfel {

/// Divides surfels into groups to be merged: starts with one group of all surfels, and cuts the
/// group that would be the worst surfel in two, across its longest direction, until there are as
/// many groups as asked for. So pieces have about the same size where the surface is alike, and
/// surfels that must not be merged (of two sheets, either side of a sharp edge, of two materials,
/// with and without normals) are cut apart first, as far as there are groups enough. Keeps its
/// memory from call to call.
class SURFEL_API SurfelPartition {
 public:
  /// Divides the surfels into 1 <= groups <= surfels.size() groups. The result depends on the
  /// surfels and their order alone. Throws Error(kUsage) for bad rules.
  void run(std::span<const MergeSurfel> surfels, std::size_t groups, const SheetRules& rules);

  std::size_t size() const { return groups_.size(); }
  std::span<const std::uint32_t> members(std::size_t group) const {
    return {order_.data() + groups_[group].begin, order_.data() + groups_[group].end};
  }
  /// Square of the length that a group's piece of surface has on its longer side, scene unit^2.
  float extent2(std::size_t group) const { return groups_[group].extent2; }

 private:
  struct Group {
    std::uint32_t begin, end;
    float badness;  ///< The group to cut next has the largest.
    float extent2;
    bool conflict;         ///< Some members must not be merged with each other.
    Eigen::Vector4f mean;  ///< Mean position, and a number.
    Eigen::Vector4f cut;   ///< Members are on a side by the sign of cut . (position - mean).
  };

  Group measure(std::uint32_t begin, std::uint32_t end) const;
  std::uint32_t cut(const Group& group);
  std::uint32_t cut_conflict(const Group& group);
  template <class Side>
  std::uint32_t divide(const Group& group, Side side);

  /// What matters of a surfel, in so few bytes that the surfels of some clusters stay in the
  /// first-level cache; four numbers are summed by one vector instruction.
  struct Member {
    Eigen::Vector4f place;   ///< Position, and the area.
    Eigen::Vector4f facing;  ///< Normal, and the square of the piece's longer side.
    std::uint16_t material;
    bool oriented;  ///< The normal is known.

    float area() const { return place[3]; }
  };

  std::vector<Member> surfels_;
  float normal_cosine_ = 0;
  float stretch_ = 0;  ///< SheetRules::sheet_weight.
  float piece2_ = 0;   ///< Square of a mean group's size.
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> scratch_;
  std::vector<Group> groups_;
  std::vector<std::uint32_t> heap_;
};

}  // namespace surfel
