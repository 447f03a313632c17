#include <cmath>

#include <fmt/format.h>
#include <surfel/base/binary_digits.h>
#include <surfel/base/curve_cell.h>
#include <surfel/base/error.h>

namespace surfel {
namespace {

/// The first digit of doubles stands for 2^-1074, and the cells that are told apart by it have
/// sides of that length.
constexpr int kLeastSide = -1074;

/// How many of a cell's sides its corner nearest to the origin is away from it; no sign.
double sides_away(double coordinate, int side) {
  return std::floor(std::ldexp(std::abs(coordinate), -side));
}

}  // namespace

int common_side(const Vec3d& p, const Vec3d& q) {
  const int highest = deciding_axis(p, q).second;
  if (highest == kSignsDiffer) return CurveCell::kAllSpace;
  return highest < 0 ? kNoSide : highest + kLeastSide;
}

bool CurveCell::contains(const Vec3d& p) const {
  return side == kAllSpace || common_side(center, p) <= side;
}

CurveCell cell_around(const Vec3d& p, int side) {
  CurveCell cell;
  if (side == CurveCell::kAllSpace) return cell;
  cell.side = side;
  for (int axis = 0; axis < 3; ++axis) {
    const double middle = std::ldexp(sides_away(p[axis], side) + 0.5, side);
    cell.center[axis] = p[axis] < 0 ? -middle : middle;
  }
  if (!cell.contains(p)) {
    throw_input("", fmt::format("points near ({}, {}, {}) are too near to each other for so far "
                                "from the origin; move them nearer to it",
                                p.x(), p.y(), p.z()));
  }
  return cell;
}

std::string CurveCell::name() const {
  if (side == kAllSpace) return "all";
  std::string name = fmt::format("{}", side);
  for (int axis = 0; axis < 3; ++axis) {
    // Cells on both sides of 0 are 0 sides away from it.
    name += fmt::format("_{}{:.0f}", center[axis] < 0 ? "-" : "", sides_away(center[axis], side));
  }
  return name;
}

bool before_in_space(const Vec3d& p, const Vec3d& q) {
  const int axis = deciding_axis(p, q).first;
  return p[axis] < q[axis];
}

}  // namespace surfel
