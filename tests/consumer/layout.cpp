// Sizes and alignments of public types as the compiler's flags make them; compiled twice.

#include "layout.h"

#include <surfel/estimate/estimate.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/transform.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/store/render_cloud.h>
#include <surfel/texture/texture_fit.h>

namespace {

template <class... Types>
std::vector<std::size_t> layout_of() {
  // Without vector instructions Eigen aligns nothing by more than 16 bytes.
  static_assert(((alignof(Types) <= 16) && ...), "the layout depends on the compiler's flags");
  return {sizeof(Types)..., alignof(Types)...};
}

}  // namespace

std::vector<std::size_t> SURFEL_LAYOUT() {
  using namespace surfel;
  return layout_of<SurfelCloud, Viewpoint, TriangleMesh, Image, Camera, CameraOptions, Scene,
                   Material, Light, Environment, Similarity, Bounds, SceneExtent, RenderCloud,
                   Cluster, RenderOptions, FrameStatistics, EstimateOptions, EstimateReport,
                   MeshSampleOptions, MeshSampleReport, TextureFitOptions, TextureSet, TextureMap,
                   TexelKernel, GaussianPyramid::Sum, TextureFitReport>();
}
