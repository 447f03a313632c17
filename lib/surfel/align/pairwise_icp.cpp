#include <algorithm>
#include <cmath>

#include <surfel/align/icp_plugin.h>
#include <surfel/align/pairwise_icp.h>
#include <surfel/base/plugin.h>

namespace surfel {
namespace {

/// The power of two that brings the largest coordinate to 1 to 2; 1 if all are zero. Scaling by it
/// rounds nothing.
double to_unit_size(const Array<Vec3f>& a, const Array<Vec3f>& b) {
  float largest = 0;
  for (const Vec3f& p : a) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  for (const Vec3f& p : b) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  return largest > 0 ? std::ldexp(1.0, -std::ilogb(largest)) : 1;
}

void scale(Array<Vec3f>& points, double factor) {
  for (Vec3f& p : points) p *= static_cast<float>(factor);
}

}  // namespace

void add_to_target(const Scan& scan, const RigidPose& pose, std::size_t most, IcpTarget& target) {
  const std::size_t count = std::min(scan.position.size(), most);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = k * scan.position.size() / count;
    if (scan.normal[i].isZero(0)) continue;
    target.position.push_back(pose(scan.position[i].cast<double>()).cast<float>());
    target.normal.push_back((pose.rotation * scan.normal[i].cast<double>()).cast<float>());
  }
}

RigidPose icp_pose(const Scan& scan, const RigidPose& start, const IcpTarget& target, double reach,
                   std::size_t most) {
  constexpr int kIterations = 30;
  static const auto run = reinterpret_cast<RunIcp*>(plugin_symbol("icp", kRunIcpSymbol));
  const std::size_t count = std::min(scan.position.size(), most);
  Array<Vec3f> source(count);
  for (std::size_t k = 0; k < count; ++k) {
    source[k] = scan.position[k * scan.position.size() / count];
  }
  // PCL's iterations end by a step of an absolute size.
  Array<Vec3f> onto = target.position;
  const double unit = to_unit_size(source, onto);
  scale(source, unit);
  scale(onto, unit);
  RigidPose pose = start;
  for (const double near : {reach, reach / 4}) {
    IcpWork work;
    work.source = source.front().data();
    work.sources = source.size();
    work.target = onto.front().data();
    work.normal = target.normal.front().data();
    work.targets = onto.size();
    work.reach = unit * near;
    work.iterations = kIterations;
    using Transform = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
    Eigen::Map<Transform> transform(work.transform);
    transform.setIdentity();
    transform.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
    transform.topRightCorner<3, 1>() = unit * pose.translation;
    if (!run(work)) return start;
    // PCL's matrix has the precision of floats.
    pose.rotation = Quaternion(Eigen::Matrix3d(transform.topLeftCorner<3, 3>())).normalized();
    pose.translation = transform.topRightCorner<3, 1>() / unit;
    if (!((pose.translation - start.translation).norm() <= 2 * reach)) return start;
  }
  return pose;
}

}  // namespace surfel
