// Loads a file of surfels or points and says what is in it:  load FILE
#include <cstdio>

#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/scene/surfel_cloud.h>

int main(int argc, char** argv) try {
  if (argc != 2) return 2;
  const surfel::SurfelCloud cloud = surfel::read_cloud(argv[1]);
  const surfel::Bounds box = cloud.bounds();
  std::printf("%zu points from (%g, %g, %g) to (%g, %g, %g)\n", cloud.size(), box.min.x(),
              box.min.y(), box.min.z(), box.max.x(), box.max.y(), box.max.z());
  // A column that the file does not have is empty; every other one has a value for each point.
  std::printf("normals: %s, sizes: %s, colours: %s\n", cloud.normal.empty() ? "no" : "yes",
              cloud.variance.empty() && !cloud.anisotropic() ? "no" : "yes",
              cloud.color.empty() ? "no" : "yes");
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "load: error: %s\n", error.what());
  return 1;
}
