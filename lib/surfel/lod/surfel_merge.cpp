#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <vector>

#include <surfel/lod/surfel_merge.h>
#include <surfel/scene/amplitude.h>
#include <surfel/scene/clips.h>
#include <surfel/surface/tangent_frame.h>

namespace surfel {
namespace {

using Covariance = std::array<double, 6>;

void add_outer(Covariance& c, double weight, const Vec3d& d) {
  c[0] += weight * d.x() * d.x();
  c[1] += weight * d.x() * d.y();
  c[2] += weight * d.x() * d.z();
  c[3] += weight * d.y() * d.y();
  c[4] += weight * d.y() * d.z();
  c[5] += weight * d.z() * d.z();
}

std::array<float, 6> to_float(const Covariance& c) {
  std::array<float, 6> out;
  for (std::size_t k = 0; k < c.size(); ++k) out[k] = static_cast<float>(c[k]);
  return out;
}

/// Material of most area. Groups are small, so that adding up areas again for each member is faster
/// than a table.
std::uint16_t majority_material(std::span<const MergeSurfel> surfels,
                                std::span<const std::uint32_t> members) {
  std::uint16_t best = surfels[members[0]].material;
  double best_area = -1;
  bool all_alike = true;
  for (const std::uint32_t i : members) all_alike = all_alike && surfels[i].material == best;
  if (all_alike) return best;
  for (const std::uint32_t i : members) {
    const std::uint16_t material = surfels[i].material;
    double area = 0;
    for (const std::uint32_t k : members) {
      if (surfels[k].material == material) area += surfels[k].area;
    }
    if (area > best_area || (area == best_area && material < best)) {
      best = material;
      best_area = area;
    }
  }
  return best;
}

}  // namespace

LinedSurfel lined_surfel(const SurfelCloud& cloud, std::uint32_t i) {
  LinedSurfel s{cloud.position[i], std::max(0.0F, amplitude(cloud, i)), {}, is_cut_off(cloud, i)};
  for (int k = 0; k < 2; ++k) {
    const HalfPlane cut = half_plane(cloud, i, k);
    const Vec3f direction = cut.direction.cast<float>();
    const auto distance = static_cast<float>(cut.distance);
    s.lines[static_cast<std::size_t>(k)] = {direction, direction.dot(s.position) + distance};
  }
  return s;
}

MergeSurfel merge_surfel(const SurfelCloud& cloud, std::uint32_t i) {
  MergeSurfel s{};
  static_cast<LinedSurfel&>(s) = lined_surfel(cloud, i);
  s.normal = cloud.normal.empty() ? Vec3f(0, 0, 0) : cloud.normal[i];
  const bool mapped = !cloud.shading_normal.empty() && !cloud.shading_normal[i].isZero();
  s.shading_normal = mapped ? cloud.shading_normal[i] : s.normal;
  const Vec3d n = s.normal.cast<double>();
  Covariance c{};
  if (cloud.anisotropic()) {
    const Vec3d wide = cloud.tangent[i].cast<double>();
    const Vec3d across = wide - n * n.dot(wide);
    Vec3d t = Vec3d::UnitX();
    if (across.norm() > 0) {
      t = across.normalized();
    } else if (!n.isZero()) {
      t = n.unitOrthogonal();
    }
    // Where the normal is unknown the tangent has no meaning either: the disc is turned to the eye.
    const Vec3d b = n.isZero() ? Vec3d(t.unitOrthogonal()) : Vec3d(n.cross(t));
    add_outer(c, cloud.variance_u[i], t);
    add_outer(c, cloud.variance_v[i], b);
    if (n.isZero()) {
      const double mean = (cloud.variance_u[i] + cloud.variance_v[i]) / 2.0;
      c = {mean, 0, 0, mean, 0, mean};
    }
  } else {
    const double v = cloud.variance[i];
    c = {v, 0, 0, v, 0, v};
    add_outer(c, -v, n);
  }
  s.covariance = to_float(c);
  s.extent2 = s.area;
  s.color = cloud.color.empty() ? Vec3f(0, 0, 0) : cloud.color[i];
  s.coefficient = cloud.coefficient.empty() ? Vec3f(0, 0, 0) : cloud.coefficient[i];
  s.alpha = cloud.alpha.empty() ? 1.0F : cloud.alpha[i];
  s.material = cloud.material.empty() ? std::uint16_t{0} : cloud.material[i];
  s.source = i;
  return s;
}

MergeSurfel merged(std::span<const MergeSurfel> surfels, std::span<const std::uint32_t> members) {
  if (members.size() == 1) return surfels[members[0]];
  const auto is_beyond = [&](std::uint32_t i) { return surfels[i].cut_off; };
  const auto beyond = std::count_if(members.begin(), members.end(), is_beyond);
  if (beyond > 0 && beyond < static_cast<std::ptrdiff_t>(members.size())) {
    std::vector<std::uint32_t> rest;
    std::remove_copy_if(members.begin(), members.end(), std::back_inserter(rest), is_beyond);
    return merged(surfels, rest);
  }
  double total = 0;
  for (const std::uint32_t i : members) total += surfels[i].area;
  const auto weight_of = [&](const MergeSurfel& s) { return total > 0 ? s.area : 1.0; };
  const double weights = total > 0 ? total : static_cast<double>(members.size());

  // Offsets from a member, as positions may be large against the distances between them.
  const Vec3d base = surfels[members[0]].position.cast<double>();
  Vec3d mean(0, 0, 0);
  Vec3d normal(0, 0, 0);
  Vec3d shading(0, 0, 0);
  Vec3d color(0, 0, 0);
  Vec3d coefficient(0, 0, 0);
  double opacity = 0;
  bool oriented = false;
  std::uint32_t largest = members[0];
  for (const std::uint32_t i : members) {
    const MergeSurfel& s = surfels[i];
    const double w = weight_of(s);
    mean += w * (s.position.cast<double>() - base);
    normal += w * s.normal.cast<double>();
    shading += w * s.shading_normal.cast<double>();
    color += w * s.alpha * s.color.cast<double>();
    coefficient += w * s.alpha * s.coefficient.cast<double>();
    opacity += w * s.alpha;
    oriented = oriented || !s.normal.isZero();
    if (s.area > surfels[largest].area) largest = i;
  }
  mean /= weights;

  MergeSurfel out = surfels[largest];
  Covariance c{};
  double nearest = std::numeric_limits<double>::infinity();
  for (const std::uint32_t i : members) {
    const MergeSurfel& s = surfels[i];
    const double w = weight_of(s) / weights;
    const Vec3d d = s.position.cast<double>() - base - mean;
    for (std::size_t k = 0; k < c.size(); ++k) c[k] += w * s.covariance[k];
    add_outer(c, w, d);
    if (d.squaredNorm() < nearest) {
      nearest = d.squaredNorm();
      out.source = s.source;
    }
  }
  out.position = (base + mean).cast<float>();
  out.covariance = to_float(c);
  const double length = normal.norm();
  constexpr double kCancelled = 1e-3;  // Shorter sums of unit normals have no direction to rely on.
  if (length > kCancelled * weights) out.normal = (normal / length).cast<float>();
  out.shading_normal = (shading / weights).cast<float>();
  out.area = static_cast<float>(oriented && total > 0 ? std::max(length, total / 2) : total);
  out.alpha = static_cast<float>(opacity / weights);
  if (opacity > 0) {
    out.color = (color / opacity).cast<float>();
    out.coefficient = (coefficient / opacity).cast<float>();
  }
  if (std::any_of(members.begin(), members.end(),
                  [&](std::uint32_t i) { return surfels[i].is_cut(); })) {
    std::vector<const LinedSurfel*> lined;
    for (const std::uint32_t i : members) lined.push_back(&surfels[i]);
    out.lines = merged_lines({out.position, out.normal, out.covariance}, lined);
    const auto cuts_off = [&](const CutLine& line) { return line.inside(out.position) < 0; };
    if (out.cut_off && !cuts_off(out.lines[0]) && !cuts_off(out.lines[1])) return surfels[largest];
  }
  out.material = majority_material(surfels, members);
  return out;
}

void write_attributes(SurfelCloud& cloud, std::size_t i, const MergeSurfel& merged) {
  cloud.position[i] = merged.position;
  const auto write = [i](auto& column, const auto& value) {
    if (!column.empty()) column[i] = value;
  };
  write(cloud.normal, merged.normal);
  write(cloud.shading_normal, merged.shading_normal);
  write(cloud.area, merged.area);
  write(cloud.color, merged.color);
  write(cloud.coefficient, merged.coefficient);
  write(cloud.alpha, merged.alpha);
  write(cloud.material, merged.material);
  write_lines(cloud, i, merged.lines);
}

void write_lines(SurfelCloud& cloud, std::size_t i, const std::array<CutLine, 2>& lines) {
  const auto write = [&](Array<Vec3f>& direction, Array<float>& distance, const CutLine& line) {
    if (direction.empty()) return;
    direction[i] = line.direction;
    distance[i] = line.cuts() ? line.inside(cloud.position[i]) : 0.0F;
  };
  write(cloud.clip1, cloud.clip1_distance, lines[0]);
  write(cloud.clip2, cloud.clip2_distance, lines[1]);
}

TangentGaussian tangent_gaussian(const std::array<float, 6>& covariance, const Vec3f& normal) {
  Eigen::Matrix3d C;
  C << covariance[0], covariance[1], covariance[2], covariance[1], covariance[3], covariance[4],
      covariance[2], covariance[4], covariance[5];
  if (normal.isZero()) {
    // A disc with variance v has the eigenvalues v, v, 0; a ball v, v, v.
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(C, Eigen::EigenvaluesOnly);
    const double v = (solver.eigenvalues()[1] + solver.eigenvalues()[2]) / 2;
    return {Vec3f::UnitX(), static_cast<float>(v), static_cast<float>(v)};
  }
  const TangentFrame frame = tangent_frame(normal.cast<double>());
  const Vec3d& a = frame.a;
  const Vec3d& b = frame.b;
  const PrincipalAxes axes = principal_axes(a.dot(C * a), a.dot(C * b), b.dot(C * b));
  return {frame.lifted(axes.along).cast<float>(), static_cast<float>(axes.larger),
          static_cast<float>(axes.smaller)};
}

}  // namespace surfel
