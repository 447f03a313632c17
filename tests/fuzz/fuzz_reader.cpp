// Reads the bytes as a file of one format, by the extension that the definition names: the reader
// must end well, or with a message that names the file.

#include <surfel/io/camera_file.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/scene_file.h>

#include "fuzz/fuzz_file.h"

using namespace surfel;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
#if defined(SURFEL_FUZZ_CLOUD)
  static fuzz::FuzzFile file("cloud" SURFEL_FUZZ_CLOUD);
  const auto read = [](const std::string& path) { read_cloud(path).check_columns(path); };
#elif defined(SURFEL_FUZZ_MESH)
  static fuzz::FuzzFile file("mesh" SURFEL_FUZZ_MESH);
  const auto read = [](const std::string& path) { read_mesh(path); };
#elif defined(SURFEL_FUZZ_IMAGE)
  static fuzz::FuzzFile file("image" SURFEL_FUZZ_IMAGE);
  set_most_image_pixels(1 << 20);
  const auto read = [](const std::string& path) { read_image(path); };
#elif defined(SURFEL_FUZZ_SCENE)
  static fuzz::FuzzFile file("scene" SURFEL_FUZZ_SCENE);
  const auto read = [](const std::string& path) {
    fuzz::require(read_scene(path).problems().empty(), "a scene that was read has problems");
  };
#elif defined(SURFEL_FUZZ_CAMERA)
  static fuzz::FuzzFile file("cameras" SURFEL_FUZZ_CAMERA);
  const auto read = [](const std::string& path) {
    for (const CameraOptions& camera : read_cameras(path, {})) {
      fuzz::require(camera.problems().empty(), "a camera that was read has problems");
    }
  };
#endif
  const std::string& path = file.write(data, size);
  fuzz::read_or_refuse(path, [&] { read(path); });
  return 0;
}
