// Plug-in libsurfel_filters.so, the only source that includes PCL's filters: the library itself
// neither links nor loads PCL before one of them is asked for.

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>

#include <pcl/console/print.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/point_types.h>
// With the bodies of MLSResult, which are inline: libpcl_surface would load VTK.
#include <pcl/surface/impl/mls.hpp>
#include <surfel/base/export.h>
#include <surfel/estimate/filters_plugin.h>

extern "C" SURFEL_API surfel::RemoveOutliers surfel_remove_outliers;
extern "C" SURFEL_API surfel::SmoothPoints surfel_smooth_points;

namespace surfel {
namespace {

pcl::PointCloud<pcl::PointXYZ>::Ptr to_cloud(const float* points, std::size_t count) {
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  cloud->resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float* p = points + 3 * i;
    (*cloud)[i] = pcl::PointXYZ(p[0], p[1], p[2]);
  }
  return cloud;
}

struct SmoothingContext {
  const SmoothingWork& work;
  const pcl::PointCloud<pcl::PointXYZ>& cloud;
};

void write_vector(const Eigen::Vector3d& v, float* out) {
  for (int c = 0; c < 3; ++c) out[c] = static_cast<float>(v[c]);
}

void smooth_point(const void* context, std::size_t point, const std::uint32_t* neighbor,
                  std::size_t count, double radius) {
  const auto& [work, cloud] = *static_cast<const SmoothingContext*>(context);
  const pcl::Indices indices(neighbor, neighbor + count);
  pcl::MLSResult fit;
  fit.computeMLSSurface(cloud, static_cast<pcl::index_t>(point), indices, radius, work.order);
  if (!fit.valid) {
    std::fill_n(work.position + 3 * point, 3, std::numeric_limits<float>::quiet_NaN());
    std::fill_n(work.normal + 3 * point, 3, 0.0F);
    return;
  }
  const pcl::MLSResult::MLSProjectionResults projected =
      fit.projectQueryPoint(pcl::MLSResult::SIMPLE, (work.order + 1) * (work.order + 2) / 2);
  write_vector(projected.point, work.position + 3 * point);
  write_vector(projected.normal.normalized(), work.normal + 3 * point);
}

}  // namespace
}  // namespace surfel

extern "C" bool surfel_remove_outliers(surfel::OutlierWork& work) {
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  try {
    pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter;
    filter.setInputCloud(surfel::to_cloud(work.points, work.count));
    filter.setMeanK(work.neighbors);
    filter.setStddevMulThresh(work.deviations);
    pcl::Indices kept;
    filter.filter(kept);
    for (const pcl::index_t i : kept) work.inlier[i] = 1;
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

extern "C" void surfel_smooth_points(surfel::SmoothingWork& work) {
  const auto cloud = surfel::to_cloud(work.points, work.count);
  const surfel::SmoothingContext context{work, *cloud};
  work.for_each(work.self, surfel::smooth_point, &context);
}
