// Karras, "Maximizing Parallelism in the Construction of BVHs, Octrees, and k-d Trees", 2012: boxes
// are common prefixes of Morton codes.

#include <algorithm>
#include <bit>
#include <limits>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/surface/point_tree.h>

namespace surfel {
namespace {

constexpr std::size_t kTreeGrain = 1 << 14;
constexpr std::size_t kWidth = PointTree::kWidth;

/// Leading bits that two codes share.
int shared_bits(std::uint64_t a, std::uint64_t b) { return std::countl_zero(a ^ b); }

/// Cuts ascending codes into the largest ranges that are all of a common prefix and no longer than
/// kWidth, and calls block(begin, end) for each. Where more than kWidth codes are equal it calls
/// equal(begin, end) with all of them instead.
template <class Block, class Equal>
void for_each_block(std::span<const std::uint64_t> code, Block&& block, Equal&& equal) {
  const std::size_t count = code.size();
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    if (begin + kWidth < count && code[begin] == code[begin + kWidth]) {
      end = static_cast<std::size_t>(
          std::upper_bound(code.begin() + static_cast<std::ptrdiff_t>(begin), code.end(),
                           code[begin]) -
          code.begin());
      equal(begin, end);
      continue;
    }
    // All ranges before are whole prefixes, so this one starts here; it must neither reach back
    // nor hold the code kWidth further on.
    int prefix = begin == 0 ? 0 : shared_bits(code[begin - 1], code[begin]) + 1;
    if (begin + kWidth < count) {
      prefix = std::max(prefix, shared_bits(code[begin], code[begin + kWidth]) + 1);
    }
    end = begin + 1;
    while (end < count && shared_bits(code[begin], code[end]) >= prefix) ++end;
    block(begin, end);
  }
}

/// Orders points of equal codes along a Morton curve of their own where they are many.
void refine(std::span<const std::uint64_t> code, std::span<Vec3f> position,
            std::span<std::uint32_t> member) {
  for_each_block(
      code, [](std::size_t, std::size_t) {},
      [&](std::size_t begin, std::size_t end) {
        const std::size_t count = end - begin;
        const Array<Vec3f> before(position.begin() + begin, position.begin() + end);
        const MortonGrid grid = morton_grid(before);
        if (grid.cells_per_unit == 0) return;
        const std::vector<std::uint32_t> members(member.begin() + begin, member.begin() + end);
        // Points at one place are ascending and stay so.
        const Array<std::uint32_t> order = morton_order(before);
        Array<std::uint64_t> finer(count);
        for (std::size_t i = 0; i < count; ++i) {
          position[begin + i] = before[order[i]];
          member[begin + i] = members[order[i]];
          finer[i] = grid.code(before[order[i]]);
        }
        refine(finer, position.subspan(begin, count), member.subspan(begin, count));
      });
}

/// Box of a leaf's first `count` entries.
void set_box(PointTree::Node& node, std::size_t child, const PointTree::Leaf& leaf,
             std::size_t count) {
  const float* axes[] = {leaf.x, leaf.y, leaf.z};
  for (int d = 0; d < 3; ++d) {
    const auto [low, high] = std::minmax_element(axes[d], axes[d] + count);
    node.low[d][child] = *low;
    node.high[d][child] = *high;
  }
}

void set_box(PointTree::Node& node, std::size_t child, const PointTree::Node& inner) {
  for (int d = 0; d < 3; ++d) {
    node.low[d][child] = *std::min_element(inner.low[d], inner.low[d] + inner.children);
    node.high[d][child] = *std::max_element(inner.high[d], inner.high[d] + inner.children);
  }
}

}  // namespace

PointTree::PointTree(const Array<Vec3f>& points) : member_(morton_order(points)) {
  const std::size_t n = points.size();
  const MortonGrid grid = morton_grid(points);
  Array<std::uint64_t> code(n);
  Array<Vec3f> position(n);
  parallel_each(n, kTreeGrain, [&](std::size_t i) {
    position[i] = points[member_[i]];
    code[i] = grid.code(position[i]);
  });
  refine(code, position, member_);

  // Distinct positions.
  const std::size_t blocks = (n + kTreeGrain - 1) / kTreeGrain;
  std::vector<std::size_t> before(blocks + 1);
  const auto starts_place = [&](std::size_t i) { return i == 0 || position[i] != position[i - 1]; };
  parallel_for(n, kTreeGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i)
      before[begin / kTreeGrain + 1] += starts_place(i) ? 1 : 0;
  });
  for (std::size_t b = 0; b < blocks; ++b) before[b + 1] += before[b];
  first_.resize(before.back() + 1);
  first_.back() = static_cast<std::uint32_t>(n);
  Array<Vec3f> place(before.back());
  parallel_for(n, kTreeGrain, [&](std::size_t begin, std::size_t end, int) {
    std::size_t at = before[begin / kTreeGrain];
    for (std::size_t i = begin; i < end; ++i) {
      if (!starts_place(i)) continue;
      first_[at] = static_cast<std::uint32_t>(i);
      place[at++] = position[i];
    }
  });
  if (places() < n) {
    place_of_.resize(n);
    for (std::size_t p = 0; p < places(); ++p) {
      place_of_[at(p).front()] = static_cast<std::uint32_t>(p);
      code[p] = code[first_[p]];
    }
    code.resize(places());
  }

  if (n == 0) return;
  cut_leaves(place, 0, code);
  std::vector<std::uint64_t> leaf_code(leaf_place_.size());
  for (std::size_t i = 0; i < leaf_code.size(); ++i) leaf_code[i] = code[leaf_place_[i]];
  leaf_place_.push_back(static_cast<std::uint32_t>(places()));
  fill_leaves(place);
  add_levels(std::move(leaf_code));
}

/// Cuts the places from `begin` on, which have these codes, into leaves.
void PointTree::cut_leaves(std::span<const Vec3f> place, std::size_t begin,
                           std::span<const std::uint64_t> code) {
  for_each_block(
      code,
      [&](std::size_t b, std::size_t) {
        leaf_place_.push_back(static_cast<std::uint32_t>(begin + b));
      },
      [&](std::size_t b, std::size_t e) {
        // refine() ordered the places by this grid.
        const MortonGrid grid = morton_grid(place.subspan(begin + b, e - b));
        std::vector<std::uint64_t> finer(e - b);
        for (std::size_t i = b; i < e; ++i) finer[i - b] = grid.code(place[begin + i]);
        cut_leaves(place, begin + b, finer);
      });
}

void PointTree::fill_leaves(std::span<const Vec3f> place) {
  constexpr std::size_t kLeavesGrain = kTreeGrain / kWidth;
  leaf_.resize(leaf_place_.size() - 1);
  parallel_for(leaf_.size(), kLeavesGrain, [&](std::size_t begin, std::size_t end, int) {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    for (std::size_t l = begin; l < end; ++l) {
      Leaf& leaf = leaf_[l];
      for (std::size_t i = 0; i < kWidth; ++i) {
        const bool used = i < leaf_size(l);
        const std::size_t p = leaf_place_[l] + (used ? i : 0);
        leaf.x[i] = used ? place[p].x() : kNan;
        leaf.y[i] = used ? place[p].y() : kNan;
        leaf.z[i] = used ? place[p].z() : kNan;
        leaf.index[i] = member_[first_[p]];
      }
    }
  });
}

/// Adds levels until one has a single node; `code` has the Morton code of every leaf.
void PointTree::add_levels(std::vector<std::uint64_t> code) {
  do {
    std::vector<std::uint32_t> first;
    const auto add = [&](std::size_t begin, std::size_t) {
      first.push_back(static_cast<std::uint32_t>(begin));
    };
    for_each_block(code, add, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; i += kWidth) add(i, end);
    });
    const bool lowest = level_.empty();
    Array<Node> nodes(first.size());
    first.push_back(static_cast<std::uint32_t>(code.size()));
    parallel_each(nodes.size(), kTreeGrain / kWidth, [&](std::size_t i) {
      Node& node = nodes[i];
      node = {};  // Boxes of unused entries are never looked at, but are read.
      node.first_child = first[i];
      node.children = first[i + 1] - first[i];
      for (std::size_t c = 0; c < node.children; ++c) {
        if (lowest) {
          set_box(node, c, leaf_[first[i] + c], leaf_size(first[i] + c));
        } else {
          set_box(node, c, level_.back()[first[i] + c]);
        }
      }
    });
    for (std::size_t i = 0; i < nodes.size(); ++i) code[i] = code[first[i]];
    code.resize(nodes.size());
    level_.push_back(std::move(nodes));
  } while (code.size() > 1);
}

}  // namespace surfel
