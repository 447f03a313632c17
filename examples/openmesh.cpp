// A mesh of OpenMesh's, subdivided there, to surfels:  openmesh MESH SURFELS OUT.ply
#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Subdivider/Uniform/LoopT.hh>
#include <cstdio>
#include <cstdlib>

#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/sample/mesh_sampler.h>

using Mesh = OpenMesh::TriMesh_ArrayKernelT<>;

int main(int argc, char** argv) try {
  Mesh mesh;
  if (argc != 4 || !OpenMesh::IO::read_mesh(mesh, argv[1])) return 2;
  OpenMesh::Subdivider::Uniform::LoopT<Mesh> loop;
  loop.attach(mesh);
  loop(2);
  loop.detach();

  surfel::TriangleMesh triangles;
  for (const Mesh::VertexHandle v : mesh.vertices()) {
    triangles.position.emplace_back(mesh.point(v).data());
  }
  for (const Mesh::FaceHandle f : mesh.faces()) {
    auto& face = triangles.face.emplace_back();
    int corner = 0;
    for (const Mesh::VertexHandle v : mesh.fv_range(f)) face[corner++] = v.idx();
  }
  surfel::MeshSampleOptions options;
  options.count = std::strtoull(argv[2], nullptr, 10);
  const surfel::SurfelCloud surfels = surfel::sample_mesh(triangles, options, nullptr, argv[1]);
  surfel::write_cloud(surfels, argv[3]);
  std::printf("%zu surfels on %zu faces\n", surfels.size(), mesh.n_faces());
} catch (const surfel::Error& error) {
  return std::fprintf(stderr, "openmesh: error: %s\n", error.what()), 1;
}
