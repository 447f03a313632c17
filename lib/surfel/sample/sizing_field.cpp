#include <algorithm>

#include <surfel/sample/sizing_field.h>

namespace surfel {
namespace {

/// Cells of a leaf of the tree.
constexpr std::size_t kLeaf = 4;

std::size_t node_count(std::size_t cells) {
  std::size_t depth = 0;
  for (std::size_t n = cells; n > kLeaf; n = n - n / 2) ++depth;
  return (std::size_t{2} << depth) - 1;
}

}  // namespace

SizingField::SizingField(double spacing) : least_(spacing), largest_(spacing) {}

SizingField::SizingField(const std::vector<SizingCell>& cells, double gradient, double largest)
    : least_(largest), largest_(largest), gradient_(gradient) {
  cell_.reserve(cells.size());
  for (const SizingCell& c : cells) {
    cell_.push_back({c.min, c.max, c.spacing});
    least_ = std::min<double>(least_, c.spacing);
  }
  if (cell_.empty()) return;
  tree_.resize(node_count(cell_.size()));
  build(0, 0, cell_.size());
}

void SizingField::build(std::size_t node, std::size_t begin, std::size_t end) {
  Node& bounds = tree_[node];
  bounds = cell_[begin];
  for (std::size_t i = begin + 1; i < end; ++i) {
    bounds.min = bounds.min.cwiseMin(cell_[i].min);
    bounds.max = bounds.max.cwiseMax(cell_[i].max);
    bounds.spacing = std::min(bounds.spacing, cell_[i].spacing);
  }
  if (end - begin <= kLeaf) return;
  int axis = 0;
  (bounds.max - bounds.min).maxCoeff(&axis);
  const std::size_t middle = begin + (end - begin + 1) / 2;
  const auto at = [this](std::size_t i) { return cell_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(begin), at(middle), at(end), [axis](const Node& a, const Node& b) {
    return a.min[axis] + a.max[axis] < b.min[axis] + b.max[axis];
  });
  build(2 * node + 1, begin, middle);
  build(2 * node + 2, middle, end);
}

double SizingField::bound(const Node& cell, const Vec3f& p) const {
  const Vec3f outside = (cell.min - p).cwiseMax(p - cell.max).cwiseMax(0.0f);
  return cell.spacing + gradient_ * outside.norm();
}

void SizingField::lower(std::size_t node, std::size_t begin, std::size_t end, const Vec3f& p,
                        double& spacing) const {
  if (end - begin <= kLeaf) {
    for (std::size_t i = begin; i < end; ++i) spacing = std::min(spacing, bound(cell_[i], p));
    return;
  }
  const std::size_t middle = begin + (end - begin + 1) / 2;
  const double low = bound(tree_[2 * node + 1], p);
  const double high = bound(tree_[2 * node + 2], p);
  const auto visit_low = [&] {
    if (low < spacing) lower(2 * node + 1, begin, middle, p, spacing);
  };
  if (low <= high) visit_low();
  if (high < spacing) lower(2 * node + 2, middle, end, p, spacing);
  if (low > high) visit_low();
}

double SizingField::at(const Vec3f& p) const {
  double spacing = largest_;
  if (!cell_.empty()) lower(0, 0, cell_.size(), p, spacing);
  return spacing;
}

}  // namespace surfel
