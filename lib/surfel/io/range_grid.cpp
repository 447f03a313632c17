#include <Eigen/Dense>
#include <charconv>

#include <surfel/io/range_grid.h>

namespace surfel {
namespace {

/// Value of a line "NAME NUMBER"; 0 where there is none.
std::size_t obj_info_number(const PlyHeader& header, std::string_view name) {
  for (const std::string& line : header.obj_info) {
    std::string_view text = line;
    if (!text.starts_with(name) || text.size() <= name.size() || text[name.size()] != ' ') continue;
    text.remove_prefix(name.size() + 1);
    std::size_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error == std::errc() && end == text.data() + text.size()) return value;
  }
  return 0;
}

}  // namespace

std::optional<Viewpoint> range_grid_viewpoint(PlyFile& ply, const SurfelCloud& cloud) {
  constexpr const char* kElement = "range_grid";
  constexpr const char* kList = "vertex_indices";
  const PlyElement* grid = ply.header().find(kElement);
  if (!grid) return std::nullopt;
  const PlyProperty* list = grid->find(kList);
  const std::size_t columns = obj_info_number(ply.header(), "num_cols");
  const std::size_t rows = obj_info_number(ply.header(), "num_rows");
  if (!list || !list->is_list() || columns == 0 || grid->count / columns != rows ||
      grid->count % columns != 0) {
    return std::nullopt;
  }
  const PlyLists<std::int32_t> vertices = ply.lists<std::int32_t>(kElement, kList);
  const auto vertex = [&](std::size_t cell) -> const Vec3f* {
    if (vertices.offset[cell + 1] - vertices.offset[cell] != 1) return nullptr;
    const std::int32_t v = vertices.value[vertices.offset[cell]];
    const bool there = v >= 0 && static_cast<std::size_t>(v) < cloud.size();
    return there ? &cloud.position[static_cast<std::size_t>(v)] : nullptr;
  };
  // A point is a linear function of column and row, and lies anywhere along the line of sight: that
  // is the direction of what a linear fit leaves.
  Eigen::Matrix3d normal_matrix = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d right_side = Eigen::Matrix3d::Zero();
  const auto each = [&](const auto& visit) {
    for (std::size_t cell = 0; cell < grid->count; ++cell) {
      const Vec3f* p = vertex(cell);
      if (!p || !p->allFinite()) continue;
      const std::size_t row = cell / columns;
      // About the middle, so that the three functions are nearly independent.
      visit(Vec3d(static_cast<double>(cell % columns) - static_cast<double>(columns) / 2,
                  static_cast<double>(row) - static_cast<double>(rows) / 2, 1),
            Vec3d(p->cast<double>()));
    }
  };
  each([&](const Vec3d& place, const Vec3d& p) {
    normal_matrix += place * place.transpose();
    right_side += place * p.transpose();
  });
  const Eigen::Matrix3d step = normal_matrix.ldlt().solve(right_side).transpose();
  Eigen::Matrix3d left = Eigen::Matrix3d::Zero();
  each([&](const Vec3d& place, const Vec3d& p) {
    const Vec3d residual = p - step * place;
    left += residual * residual.transpose();
  });
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(left);
  const Vec3d facing = step.col(0).cross(step.col(1));
  // A single line tells nothing.
  if (!(facing.norm() > 1e-3 * step.col(0).norm() * step.col(1).norm())) return std::nullopt;
  // Of a plane nothing is left: it was looked at from the front.
  const bool flat = !(eigen.eigenvalues()[2] > 4 * eigen.eigenvalues()[1]);
  Vec3d backward = flat ? facing.normalized() : Vec3d(eigen.eigenvectors().col(2));
  if (backward.dot(facing) < 0) backward = -backward;
  const Bounds box = cloud.bounds();
  if (!backward.allFinite() || box.empty()) return std::nullopt;
  Eigen::Matrix3d axes;
  const Vec3d right = step.col(0);
  axes.col(0) = (right - right.dot(backward) * backward).normalized();
  axes.col(1) = axes.col(0).cross(backward);
  axes.col(2) = -backward;
  const Eigen::Quaterniond q(axes);
  return Viewpoint{box.center() + 100 * box.diagonal() * backward, {q.w(), q.x(), q.y(), q.z()}};
}

}  // namespace surfel
