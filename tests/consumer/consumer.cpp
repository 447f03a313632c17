// Writes and reads a small cloud and a small image: proves that headers, library and plug-ins of an
// installed Surfelkit are found, and that library and program agree on the layout of types.

#include <cstdio>

#include <surfel/base/error.h>
#include <surfel/base/version.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_cloud.h>

#include "layout.h"

int main(int argc, char** argv) try {
  if (argc != 2) return 2;
  const std::string folder = argv[1];
  surfel::SurfelCloud cloud;
  cloud.position.assign(3, surfel::Vec3f(1, 2, 3));
  surfel::write_cloud(cloud, folder + "/consumer.ply");
  const bool read = surfel::read_cloud(folder + "/consumer.ply").size() == cloud.size();

  // The image's format lives in a plug-in beside the library.
  surfel::Image image{2, 1, {"R", "G", "B", "A"}, {}};
  image.data.assign(8, 1.0F);
  surfel::write_image(image, folder + "/consumer.png");
  const bool seen = surfel::read_image(folder + "/consumer.png").width == image.width;

  const bool works = read && seen && plain_layout() == native_layout();
  std::printf("surfel %s: %s\n", surfel::version(), works ? "works" : "does not work");
  return works ? 0 : 1;
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "consumer: error: %s\n", error.what());
  return 1;
}
