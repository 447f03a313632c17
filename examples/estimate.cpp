// Raw points to surfels: normals, their side, and the size of every splat:  estimate IN OUT.ply
#include <cstdio>

#include <surfel/base/error.h>
#include <surfel/estimate/estimate.h>
#include <surfel/io/cloud_io.h>

int main(int argc, char** argv) try {
  if (argc != 3) return 2;
  const surfel::SurfelCloud points = surfel::read_cloud(argv[1]);
  surfel::EstimateOptions options;
  options.normals.adaptive = true;  // As many neighbours as noise, curvature and density ask for.
  surfel::EstimateReport report;
  const surfel::SurfelCloud surfels = surfel::estimate_surfels(points, options, &report, argv[1]);
  surfel::write_cloud(surfels, argv[2]);
  std::printf("%zu surfels; %.1f neighbours a normal; %zu splats at borders\n", surfels.size(),
              report.mean_neighbors, report.border);
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "estimate: error: %s\n", error.what());
  return 1;
}
