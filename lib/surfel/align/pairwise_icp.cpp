#include <algorithm>

#include <surfel/align/icp_plugin.h>
#include <surfel/align/pairwise_icp.h>
#include <surfel/base/plugin.h>

namespace surfel {

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
  RigidPose pose = start;
  for (const double near : {reach, reach / 4}) {
    IcpWork work;
    work.source = source.front().data();
    work.sources = source.size();
    work.target = target.position.front().data();
    work.normal = target.normal.front().data();
    work.targets = target.position.size();
    work.reach = near;
    work.iterations = kIterations;
    using Transform = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
    Eigen::Map<Transform> transform(work.transform);
    transform.setIdentity();
    transform.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
    transform.topRightCorner<3, 1>() = pose.translation;
    if (!run(work)) return start;
    // PCL's matrix has the precision of floats.
    pose.rotation = Quaternion(Eigen::Matrix3d(transform.topLeftCorner<3, 3>())).normalized();
    pose.translation = transform.topRightCorner<3, 1>();
    if (!((pose.translation - start.translation).norm() <= 2 * reach)) return start;
  }
  return pose;
}

}  // namespace surfel
