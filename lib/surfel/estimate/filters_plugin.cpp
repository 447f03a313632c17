// Plug-in libsurfel_filters.so, the only source that includes PCL's filters: the library itself
// neither links nor loads PCL before outliers are asked for.

#include <exception>

#include <pcl/console/print.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/point_types.h>
#include <surfel/base/export.h>
#include <surfel/estimate/outliers_plugin.h>

extern "C" SURFEL_API bool surfel_remove_outliers(surfel::OutlierWork& work);

extern "C" bool surfel_remove_outliers(surfel::OutlierWork& work) {
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  try {
    const pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
    cloud->resize(work.count);
    for (std::size_t i = 0; i < work.count; ++i) {
      const float* p = work.points + 3 * i;
      (*cloud)[i] = pcl::PointXYZ(p[0], p[1], p[2]);
    }
    pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter;
    filter.setInputCloud(cloud);
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
