// A mesh and an image to surfels with filtered texture:  texture MESH IMAGE SURFELS OUT.ply
#include <cstdio>
#include <cstdlib>

#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/texture/texture_source.h>

int main(int argc, char** argv) try {
  if (argc != 5) return 2;
  const surfel::TriangleMesh mesh = surfel::read_mesh(argv[1]);
  surfel::MeshSampleOptions sampling;
  sampling.count = std::strtoull(argv[3], nullptr, 10);
  surfel::SurfelCloud surfels = surfel::sample_mesh(mesh, sampling, nullptr, argv[1]);

  surfel::TextureSourceOptions source;
  source.image = argv[2];
  surfel::TextureSet textures = surfel::load_textures(source, &mesh, argv[1]);
  const surfel::TextureFitReport report = surfel::fit_texture(surfels, textures, {});
  surfel::write_cloud(surfels, argv[4]);
  std::printf("%zu surfels on %zu charts of the texture\n", report.surfels, report.charts);
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "texture: error: %s\n", error.what());
  return 1;
}
