// Reads the bytes as the material file of a mesh.

#include <surfel/io/mesh_io.h>

#include "fuzz/fuzz_file.h"

using namespace surfel;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static fuzz::FuzzFile file("materials.mtl");
  const std::string mesh = file.folder() + "/mesh.obj";
  static const bool written = [&] {
    std::ofstream(mesh) << "mtllib materials.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\n"
                           "vt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    return true;
  }();
  fuzz::require(written, "no mesh");
  file.write(data, size);
  // Messages name the file in which something is wrong, which is one of the folder.
  fuzz::read_or_refuse(file.folder(), [&] { read_mesh(mesh); });
  return 0;
}
