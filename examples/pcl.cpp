// A cloud of PCL's through the estimation of surfels and back:  pcl IN.pcd OUT.pcd
#include <cstdio>

#include <pcl/io/pcd_io.h>
#include <surfel/base/error.h>
#include <surfel/estimate/estimate.h>
#include <surfel/pcl/conversion.h>

int main(int argc, char** argv) try {
  if (argc != 3) return 2;
  pcl::PointCloud<pcl::PointXYZRGB> points;
  if (pcl::io::loadPCDFile(argv[1], points) < 0) return 1;
  const surfel::SurfelCloud surfels =
      surfel::estimate_surfels(surfel::fromPCL(points), {}, nullptr, argv[1]);
  // PointSurfel holds position, normal, colour and radius.
  const auto out = surfel::toPCL<pcl::PointSurfel>(surfels);
  if (pcl::io::savePCDFileBinary(argv[2], out) < 0) return 1;
  std::printf("%zu surfels\n", out.size());
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "pcl: error: %s\n", error.what());
  return 1;
}
