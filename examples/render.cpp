// Surfels to a picture:  render SURFELS OUT.png
#include <cstdio>

#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>

int main(int argc, char** argv) try {
  if (argc != 3) return 2;
  // The store, the scene and the renderer are made once, for any number of cameras.
  surfel::RenderCloud store(surfel::read_cloud(argv[1]), {}, argv[1]);
  const surfel::Scene scene;  // One material, some ambient light, a headlight.
  surfel::RenderOptions options;
  options.cutoff = 2;  // Smoother than 1, at about twice the time.
  surfel::Renderer renderer(store, scene, options);

  surfel::CameraOptions view;  // What is not said is chosen so that all is seen.
  view.from = surfel::Vec3d(0.3, 0.2, 1);
  view.width = view.height = 256;
  const surfel::Camera camera = surfel::make_camera(view, store.extent());
  surfel::FrameStatistics statistics;
  const surfel::Image image = renderer.render(camera, &statistics);
  surfel::write_image(image, argv[2]);
  std::printf("%zu splats in %.1f ms\n", statistics.splats, statistics.milliseconds);
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "render: error: %s\n", error.what());
  return 1;
}
