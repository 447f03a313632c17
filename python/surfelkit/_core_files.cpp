// Files of all kinds.

#include <array>
#include <string>

#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>

#include "_pictures.h"

namespace surfel::python {

void bind_files(py::module_& module) {
  module.def("file_kind", [](const std::string& path) {
    switch (made([&] { return file_kind(path); })) {
      case FileKind::kCloud:
        return "points";
      case FileKind::kMesh:
        return "mesh";
      case FileKind::kImage:
        return "image";
      case FileKind::kGaussians:
        return "gaussians";
      case FileKind::kVolume:
        break;
    }
    return "volume";
  });
  module.def("read_points", [](const std::string& path, const py::dict& given,
                               const py::object& progress, std::optional<int> threads) {
    CloudReadOptions options;
    Options take(given);
    std::optional<std::pair<std::array<double, 3>, std::array<double, 3>>> bounds;
    take("every", options.every);
    take("level", options.level);
    take("bounds", bounds);
    take("columns", options.columns);
    if (bounds) options.bounds = Bounds{Vec3d(bounds->first.data()), Vec3d(bounds->second.data())};
    return hold(made({progress, threads}, [&] { return read_cloud(path, options); }));
  });
  module.def("read_mesh",
             [](const std::string& path) { return hold(made([&] { return read_mesh(path); })); });
  module.def("read_gaussians", [](const std::string& path) {
    return hold(made([&] { return read_gaussians(path); }));
  });
  module.def(
      "write_points", [](const std::string& path, HeldCloud& held, bool ascii, bool no_clobber) {
        const SurfelCloud& cloud = ready(held);
        const InUse use(held);
        return made(
            [&] { return write_cloud(cloud, path, {.no_clobber = no_clobber, .ascii = ascii}); });
      });
  module.def("write_mesh", [](const std::string& path, HeldMesh& held, bool no_clobber) {
    const TriangleMesh& mesh = ready(held);
    const InUse use(held);
    run([&] { write_mesh(mesh, path, {.no_clobber = no_clobber}); });
  });
  module.def("write_gaussians", [](const std::string& path, HeldGaussians& held, bool no_clobber) {
    const GaussianCloud& cloud = ready(held);
    const InUse use(held);
    run([&] { write_gaussians(cloud, path, {.no_clobber = no_clobber}); });
  });
  module.def("read_image", [](const std::string& path, bool raw) {
    return std::make_shared<Picture>(
        Picture{made([&] { return raw ? read_image(path, true) : read_premultiplied_image(path); }),
                std::nullopt});
  });
  module.def("write_image",
             [](const std::string& path, const py::object& image,
                std::vector<std::pair<std::string, std::string>> metadata, bool no_clobber) {
               const HeldPicture picture = picture_of(image);
               ImageWriteOptions options;
               options.no_clobber = no_clobber;
               options.metadata = std::move(metadata);
               if (picture->camera)
                 options.world_to_camera = world_to_camera_matrix(*picture->camera);
               run([&] { write_image(picture->image, path, options); });
             });
}

}  // namespace surfel::python
