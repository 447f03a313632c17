// Plug-in libsurfel_icp.so, the only source that includes PCL's registration: the library itself
// neither links nor loads PCL before scans are aligned.

#include <exception>
#include <stdexcept>

#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/transformation_estimation_point_to_plane_lls.h>
#include <surfel/align/icp_plugin.h>
#include <surfel/base/export.h>

extern "C" SURFEL_API surfel::RunIcp surfel_run_icp;

namespace surfel {
namespace {

pcl::PointCloud<pcl::PointNormal>::Ptr to_oriented_cloud(const float* points, const float* normals,
                                                         std::size_t count) {
  pcl::PointCloud<pcl::PointNormal>::Ptr cloud(new pcl::PointCloud<pcl::PointNormal>);
  cloud->resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float* p = points + 3 * i;
    pcl::PointNormal& point = (*cloud)[i];
    point.x = p[0];
    point.y = p[1];
    point.z = p[2];
    if (!normals) continue;
    const float* n = normals + 3 * i;
    point.normal_x = n[0];
    point.normal_y = n[1];
    point.normal_z = n[2];
  }
  return cloud;
}

using PointToPlane =
    pcl::registration::TransformationEstimationPointToPlaneLLS<pcl::PointNormal, pcl::PointNormal>;

/// Of points to planes, by linear least squares. Throws where these have no solution, as in a plane
/// that lies on itself: PCL goes on with a motion that is no number, and ends the process.
class SolvablePointToPlane : public PointToPlane {
 public:
  using PointToPlane::estimateRigidTransformation;
  void estimateRigidTransformation(const pcl::PointCloud<pcl::PointNormal>& source,
                                   const pcl::PointCloud<pcl::PointNormal>& target,
                                   const pcl::Correspondences& pairs,
                                   Matrix4& motion) const override {
    PointToPlane::estimateRigidTransformation(source, target, pairs, motion);
    if (!motion.allFinite()) throw std::runtime_error("no motion fits");
  }
};

}  // namespace
}  // namespace surfel

extern "C" bool surfel_run_icp(surfel::IcpWork& work) {
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  try {
    pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal> icp;
    icp.setTransformationEstimation(pcl::make_shared<surfel::SolvablePointToPlane>());
    icp.setInputSource(surfel::to_oriented_cloud(work.source, nullptr, work.sources));
    icp.setInputTarget(surfel::to_oriented_cloud(work.target, work.normal, work.targets));
    icp.setMaxCorrespondenceDistance(work.reach);
    icp.setMaximumIterations(work.iterations);
    icp.setTransformationEpsilon(1e-10);
    // Points beyond the end of the other scan are the nearest of none.
    icp.setUseReciprocalCorrespondences(true);
    Eigen::Matrix4f start;
    for (int i = 0; i < 16; ++i) start(i / 4, i % 4) = static_cast<float>(work.transform[i]);
    pcl::PointCloud<pcl::PointNormal> moved;
    icp.align(moved, start);
    const Eigen::Matrix4f end = icp.getFinalTransformation();
    for (int i = 0; i < 16; ++i) work.transform[i] = static_cast<double>(end(i / 4, i % 4));
    return end.allFinite();
  } catch (const std::exception&) {
    return false;
  }
}
