#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// Rays, filter and light of a MeshRenderer.
struct MeshRenderOptions {
  int samples = 16;    ///< n: n x n rays a pixel, 1..64.
  double lowpass = 1;  ///< Standard deviation of the Gaussian pixel filter, pixels, 0..16; 0: the
                       ///< mean over the pixel's own square.
  bool cull_back = false;  ///< Leave out faces whose corners are seen clockwise.
  bool lit = true;         ///< Shade with the scene; else show the texture itself.
  /// Surfaces at which a ray is bent and mirrored one after another, 0..32; behind the last one it
  /// sees the environment. 0: rays go straight on, and mirror and refract the environment as
  /// surfels do, SP06 (12). Above 0 the scene needs an environment, and its `refraction` plays no
  /// role.
  int bounces = 0;
  Relief relief = Relief::kNone;  ///< By the depths at the pixels' centres: see add_relief().
  std::array<float, 4> background{0, 0, 0, 0};  ///< Linear R G B, straight alpha.
  /// Relief of the faces, which bends their normals, texels bilinearly interpolated; null: none. It
  /// must outlive the renderer.
  const NormalMaps* normal_maps = nullptr;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Ray-traces a textured mesh: the truth for pictures of surfels that were made from it.
///
/// A ray has the colour of the nearest face at z >= near; where that face is transparent, the
/// colours of all faces behind it are composited. A face's colour comes from its texture's own
/// texels, bilinearly interpolated and not filtered: the rays of a pixel do that. Without textures
/// it is the vertices' colour, else the material's where that names no image, else the light grey
/// of colourless clouds. Normals are the file's, else smooth ones as sample_mesh() makes them by
/// default. They are on the side of the face that the ray meets, so that smooth normals beside a
/// silhouette may look away from the eye, and are shaded as surfels' normals are; the scene's
/// materials, too, apply as to the surfels, by the number of the face's material. Then
/// supersample() filters the rays of a picture.
///
/// With `bounces`, rays follow geometrical optics instead: each surface whose material has an index
/// of refraction bends a ray by Snell's law where it goes in (through a front face) and where it
/// comes out (through a back face), mirrors Fresnel's share of it, and takes the material's
/// absorption; other surfaces let through straight ahead what they do not mirror or hide. Rays in
/// the end see the environment, so that there are no caustics, and lights cast no shadows.
///
/// Directions and distances are single precision, from where the ray enters the mesh's bounding
/// sphere on: the picture depends neither on how far from the world's origin the mesh lies, nor on
/// how far from the mesh the eye is. Faces that coincide count as one, that of the lowest number.
/// Memory: some 120 bytes a face beside the mesh, half of them for normals.
class SURFEL_API MeshRenderer {
 public:
  /// Keeps references to all but the options; they must outlive the renderer.
  /// \param mesh      The surface to draw.
  /// \param textures  null: none are to be seen. Charts play no role.
  /// \param scene     Lights, environment and materials.
  /// \param options   Rays of a pixel, the pixel filter, bounces and background.
  ///
  /// Throws Error: kUsage for options or scenes that are not usable, and for bounces where nothing
  /// is lit or the scene has no environment; kInput where a column of the mesh has another length
  /// than it must have or a face names vertices or materials that the mesh lacks, where
  /// require_sampleable() refuses the mesh, and where there are textures or normal maps but the
  /// mesh has no texture coordinates, or has a material without a map; kNumeric if the mesh does
  /// not fit into memory a second time.
  MeshRenderer(const TriangleMesh& mesh, const TextureSet* textures, const Scene& scene,
               const MeshRenderOptions& options);
  MeshRenderer(TriangleMesh&& mesh, const TextureSet* textures, const Scene& scene,
               const MeshRenderOptions& options) = delete;
  MeshRenderer(const TriangleMesh& mesh, const TextureSet* textures, Scene&& scene,
               const MeshRenderOptions& options) = delete;
  ~MeshRenderer();
  MeshRenderer(const MeshRenderer&) = delete;
  MeshRenderer& operator=(const MeshRenderer&) = delete;

  /// Premultiplied linear R G B A over the background. The same for any number of threads. Draws
  /// on all threads; several calls may run at once. Throws Error(kUsage) for a camera that is not
  /// usable.
  /// \param camera    The camera of the picture.
  /// \param progress  Called with the share that is done, 0..1, from any thread; may be empty.
  Image render(const Camera& camera, const std::function<void(double)>& progress = {}) const;

  /// World bounds of the faces, for make_camera(). Refers to the mesh.
  SceneExtent extent() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
