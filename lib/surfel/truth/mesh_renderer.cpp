#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/relief.h>
#include <surfel/render/shading.h>
#include <surfel/sample/mesh_face.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/sample/smooth_normals.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>
#include <surfel/texture/texture_map.h>
#include <surfel/truth/bent_rays.h>
#include <surfel/truth/mesh_renderer.h>
#include <surfel/truth/mesh_tracer_plugin.h>
#include <surfel/truth/supersample.h>

namespace surfel {
namespace {

/// Behind a transparent face a ray goes on after this part of the bounding sphere's diameter, which
/// is ten times the rounding error of the largest distance: a ray through an edge must not see both
/// faces.
constexpr double kGap = 0x1p-20;

/// Weights of a face's three corners.
using Barycentric = Vec3f;

template <class T>
T interpolated(const std::array<T, 3>& corner, const Barycentric& b) {
  return b[0] * corner[0] + b[1] * corner[1] + b[2] * corner[2];
}

/// The image's texels at a place between their centres; premultiplied.
Eigen::Array4f bilinear(const TextureMap& map, const Vec2d& texel) {
  // Beyond 2^30 texels the uv's single precision tells no texels apart; NaN ends there as well.
  const auto bounded = [](double x) { return std::max(-0x1p30, std::min(0x1p30, x)); };
  GaussianPyramid::Sum sum;
  map.pyramid().add_lookup({bounded(texel.x()), bounded(texel.y())}, 1, sum);
  return sum.texels.cast<float>();
}

/// Box around the faces, relative to the mesh's origin.
Bounds face_bounds(const TriangleMesh& mesh) {
  Bounds box;
  for (const auto& face : mesh.face) {
    for (const std::uint32_t v : face) box.add(mesh.position[v].cast<double>());
  }
  return box;
}

struct Sphere {
  Vec3d center{0, 0, 0};
  double radius = 0;
};

/// First and last t of a ray inside a sphere; nullopt where it passes by.
struct Span {
  double first, last;
};
std::optional<Span> inside(const Sphere& sphere, const Vec3d& origin, const Vec3d& direction) {
  const Vec3d to_center = sphere.center - origin;
  const double length2 = direction.squaredNorm();
  const double middle = to_center.dot(direction) / length2;
  const double passes2 = (to_center - middle * direction).squaredNorm();
  if (!(passes2 <= sphere.radius * sphere.radius)) return std::nullopt;
  const double half = std::sqrt((sphere.radius * sphere.radius - passes2) / length2);
  return Span{middle - half, middle + half};
}

/// A fragment for Shader, of a surface that covers all of a ray.
Fragment fragment(const Eigen::Array4f& color, const Vec3f& normal, float depth,
                  std::uint32_t material, bool front) {
  Fragment f{};
  f.channel[kWeight] = 1;
  f.channel[kDepth] = depth;
  for (int k = 0; k < 4; ++k) f.channel[kRed + k] = color[k];
  f.channel[kTag] = std::bit_cast<float>(material << kMaterialShift | (front ? kFrontTag : 0U));
  for (int k = 0; k < 3; ++k) f.channel[kNormalX + k] = normal[k];
  return f;
}

/// A camera as the mesh sees it.
struct View {
  const Camera& camera;
  const Shader& shader;
  Vec3d eye;  ///< Relative to the mesh's origin.
};

}  // namespace

std::vector<std::string> MeshRenderOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, samples >= 1 && samples <= 64, "samples", samples, "in 1..64");
  check_option(found, lowpass >= 0 && lowpass <= 16, "lowpass", lowpass, "in 0..16 pixels");
  check_option(found, bounces >= 0 && bounces <= 32, "bounces", bounces, "in 0..32");
  check_background(found, background);
  return found;
}

struct MeshRenderer::Impl {
  const TriangleMesh& mesh;
  const TextureSet* textures;
  const Scene& scene;
  MeshRenderOptions options;
  Array<std::array<Vec3f, 3>> computed_normal{};  ///< Where the mesh has none and they are needed.
  /// Bounds of the faces, relative to the mesh's origin.
  Bounds box{};
  Sphere bounds{};                             ///< Around the box.
  std::unique_ptr<const MeshTracer> tracer{};  ///< None where there is no face.

  std::uint16_t material(std::uint32_t face) const {
    return mesh.face_material.empty() ? std::uint16_t{0} : mesh.face_material[face];
  }
  std::size_t map_index(const TextureSet& set, std::uint32_t face) const {
    return set.map_of_material.empty() ? 0 : set.map_of_material[material(face)];
  }
  void check_textures(const TextureSet& set) const;
  Eigen::Array4f texel(const TextureMap& image, std::uint32_t face, const Barycentric& b) const;
  Eigen::Array4f color(std::uint32_t face, const Barycentric& b) const;
  Vec3f normal(std::uint32_t face, const Barycentric& b) const;
  bool is_outside(const MeshHit& hit, const Vec3f& normal) const;
  Vec3f mapped_normal(std::uint32_t face, const Barycentric& b, const Vec3f& smooth) const;
  Fragment surface(const View& view, const MeshHit& hit, double z) const;
  NearnessPicture nearness(const View& view) const;
  float gap() const { return static_cast<float>(2 * bounds.radius * kGap); }
  Rgba trace(const View& view, double x, double y, float* nearness = nullptr) const;
  Rgba trace_bent(const View& view, double x, double y) const;
};

void MeshRenderer::Impl::check_textures(const TextureSet& set) const {
  if (mesh.wedge_uv.empty()) {
    throw_input("", "the mesh has no texture coordinates, so no image can be put on it");
  }
  if (set.maps.empty()) throw_input("", "there are no textures in the set");
  const auto& map_of = set.map_of_material;
  if (map_of.empty()) return;
  for (std::uint32_t f = 0; f < mesh.face.size(); ++f) {
    if (material(f) >= map_of.size()) {
      throw_input("", fmt::format("face {} of the mesh uses material {}; there are textures for {}",
                                  f, material(f), map_of.size()));
    }
    if (map_of[material(f)] >= set.maps.size()) {
      throw_input("", fmt::format("`map_of_material` of material {} is {}; there are {} textures",
                                  material(f), map_of[material(f)], set.maps.size()));
    }
  }
}

/// An image's value at a place of a face, premultiplied.
Eigen::Array4f MeshRenderer::Impl::texel(const TextureMap& image, std::uint32_t face,
                                         const Barycentric& b) const {
  Vec2d texel(0, 0);
  for (int k = 0; k < 3; ++k) {
    texel += static_cast<double>(b[k]) * image.texel(mesh.wedge_uv[face][k]);
  }
  return bilinear(image, texel);
}

/// Premultiplied.
Eigen::Array4f MeshRenderer::Impl::color(std::uint32_t face, const Barycentric& b) const {
  if (textures) {
    Eigen::Array4f color = texel(textures->maps[map_index(*textures, face)], face, b);
    if (textures->takes_colors(material(face))) color.head<3>() *= mesh.color_at(face, b).array();
    return color;
  }
  const bool has_materials = !mesh.face_material.empty() && !mesh.material.empty();
  const MeshMaterial* const named = has_materials ? &mesh.material[material(face)] : nullptr;
  const bool known = !mesh.color.empty() || (named && named->texture.empty());
  const Vec3f color = known ? mesh.color_at(face, b) : SurfelCloud::colorless();
  const float alpha = named ? named->opacity : 1;
  return {alpha * color.x(), alpha * color.y(), alpha * color.z(), alpha};
}

/// Normals of a face's corners that cancel say nothing; the face's own does.
Vec3f MeshRenderer::Impl::normal(std::uint32_t face, const Barycentric& b) const {
  const auto& corner = mesh.wedge_normal.empty() ? computed_normal[face] : mesh.wedge_normal[face];
  const Vec3f smooth = interpolated(corner, b);
  const float length = smooth.norm();
  if (length > 1e-3F) return smooth / length;
  const auto& v = mesh.face[face];
  const Vec3d at = mesh.position[v[0]].cast<double>();
  const Vec3d across =
      (mesh.position[v[1]].cast<double>() - at).cross(mesh.position[v[2]].cast<double>() - at);
  return across.normalized().cast<float>();
}

/// Does a ray meet the side that the surface's normal is on, which a file may give against the
/// order of the corners?
bool MeshRenderer::Impl::is_outside(const MeshHit& hit, const Vec3f& normal) const {
  const Vec3d across = area_vector(face_corners(mesh, hit.face));
  return hit.front != (across.dot(normal.cast<double>()) < 0);
}

/// The relief's normal at a place of a face whose own normal is `smooth`.
Vec3f MeshRenderer::Impl::mapped_normal(std::uint32_t face, const Barycentric& b,
                                        const Vec3f& smooth) const {
  const NormalMaps& maps = *options.normal_maps;
  const std::size_t map = map_index(maps.first, face);
  if (maps.kind[map] == ReliefKind::kNone) return smooth;
  const TextureMap& image = maps.first.maps[map];
  const Vec3d value = texel(image, face, b).head<3>().matrix().cast<double>();
  const UvFrame frame = uv_frame(face_corners(mesh, face), mesh.wedge_uv[face]);
  const ReliefBase base{smooth.cast<double>(), frame.dpdu, frame.dpdv};
  const std::optional<Vec3d> mapped =
      maps.kind[map] == ReliefKind::kNormals
          ? normal_in_scene(base, value)
          : raised_normal(base, {.mean = value.head<2>()}, image.width(), image.height());
  return mapped && !mapped->isZero() ? Vec3f(mapped->normalized().cast<float>()) : smooth;
}

Fragment MeshRenderer::Impl::surface(const View& view, const MeshHit& hit, double z) const {
  const Barycentric b(1 - hit.u - hit.v, hit.u, hit.v);
  const std::uint32_t number = material(hit.face);
  const float opacity =
      scene.materials[std::min<std::size_t>(number, scene.materials.size() - 1)].opacity;
  Vec3f n(0, 0, 0);
  bool front = hit.front;
  if (view.shader.lit()) {
    n = normal(hit.face, b);
    front = is_outside(hit, n);
    if (options.normal_maps) n = mapped_normal(hit.face, b, n);
  }
  return fragment(opacity * color(hit.face, b), n, view.shader.depth(static_cast<float>(z)), number,
                  front);
}

/// Premultiplied colour at picture coordinates. `nearness`, if not null, gets that of the surface
/// at which opacity passes one half, else of the nearest one, or kNothing.
Rgba MeshRenderer::Impl::trace(const View& view, double x, double y, float* nearness) const {
  const auto at_x = static_cast<float>(x);
  const auto at_y = static_cast<float>(y);
  Rgba seen;
  SeenThrough surfaces;
  if (nearness) *nearness = NearnessPicture::kNothing;
  const ViewRay ray = view_ray(view.camera, x, y);
  const std::optional<Span> span =
      tracer ? inside(bounds, view.eye + ray.origin, ray.direction) : std::nullopt;
  if (span && span->last >= view.camera.near) {
    const double start = std::max(span->first, view.camera.near);
    const Vec3f origin = (view.eye + ray.origin + start * ray.direction).cast<float>();
    const Vec3f direction = ray.direction.cast<float>();
    MeshRay rest{{origin.x(), origin.y(), origin.z()},
                 {direction.x(), direction.y(), direction.z()},
                 0,
                 options.cull_back};
    while (seen.alpha < 1) {
      const std::optional<MeshHit> hit = tracer->nearest(rest);
      if (!hit) break;
      const Fragment at = surface(view, *hit, start + static_cast<double>(hit->t));
      const Rgba shaded = view.shader.shade(at, at_x, at_y, 1);
      const bool half = seen.alpha < 0.5F;
      seen.composite(shaded);
      if (nearness && (*nearness == NearnessPicture::kNothing || (half && seen.alpha >= 0.5F))) {
        *nearness = at.channel[kDepth];
      }
      surfaces.add(at, 1, 1, shaded.alpha);
      rest.from = hit->t + gap();
    }
  }
  view.shader.add_environment(seen, surfaces, at_x, at_y);
  return seen;
}

/// As trace(), with rays that surfaces bend and mirror.
Rgba MeshRenderer::Impl::trace_bent(const View& view, double x, double y) const {
  const ViewRay ray = view_ray(view.camera, x, y);
  const std::optional<Span> span =
      tracer ? inside(bounds, view.eye + ray.origin, ray.direction) : std::nullopt;
  const double start = span ? std::max(span->first, view.camera.near) : view.camera.near;
  const auto nearest = [&](const Vec3f& origin, const Vec3f& direction,
                           float from) -> std::optional<MetSurface> {
    if (!span) return std::nullopt;
    const auto hit = tracer->nearest({{origin.x(), origin.y(), origin.z()},
                                      {direction.x(), direction.y(), direction.z()},
                                      from,
                                      options.cull_back});
    if (!hit) return std::nullopt;
    const Barycentric b(1 - hit->u - hit->v, hit->u, hit->v);
    const Vec3f outwards = normal(hit->face, b);
    const Vec3f seen = is_outside(*hit, outwards) ? outwards : Vec3f(-outwards);
    return MetSurface{hit->t, color(hit->face, b), seen, material(hit->face), hit->front};
  };
  const BentRays rays{scene, view.shader, view.eye.cast<float>(), gap(), options.bounces};
  return rays.trace(nearest, (view.eye + ray.origin + start * ray.direction).cast<float>(),
                    ray.direction.normalized().cast<float>(), 0);
}

/// Nearness of what the centres of the pixels show, as far around the rows as relief looks.
NearnessPicture MeshRenderer::Impl::nearness(const View& view) const {
  const Camera& camera = view.camera;
  const int margin = relief_margin(options.relief, camera);
  const RowRange rows = camera.drawn_rows();
  const RowRange seen{std::max(0, rows.begin - margin), std::min(camera.height, rows.end + margin)};
  NearnessPicture picture;
  picture.reset(camera.width, seen, margin);
  parallel_each(static_cast<std::size_t>(seen.end - seen.begin), 1, [&](std::size_t row) {
    const int y = seen.begin + static_cast<int>(row);
    for (int x = 0; x < camera.width; ++x) trace(view, x + 0.5, y + 0.5, picture.at(x, y));
  });
  return picture;
}

MeshRenderer::MeshRenderer(const TriangleMesh& mesh, const TextureSet* textures, const Scene& scene,
                           const MeshRenderOptions& options)
    : impl_(new Impl{mesh, textures, scene, options}) {
  require_usable(options);
  require_usable(scene);
  if (options.bounces > 0 && !(options.lit && scene.environment)) {
    throw_usage("`bounces` needs a lit scene with an environment, which the rays see in the end");
  }
  mesh.check_columns("");
  require_sampleable(mesh, "");
  // A mesh without materials may number the materials of its textures, or of a scene.
  if (!mesh.material.empty() || (!textures && mesh.color.empty())) mesh.check_materials("");
  if (textures) impl_->check_textures(*textures);
  if (options.normal_maps) impl_->check_textures(options.normal_maps->first);
  if (mesh.face.empty()) return;
  if (options.lit && mesh.wedge_normal.empty()) {
    impl_->computed_normal = smooth_normals(mesh, MeshSampleOptions{}.crease_angle);
  }
  impl_->box = face_bounds(mesh);
  // A little wider, so that rounding leaves no vertex outside.
  impl_->bounds = {impl_->box.center(), impl_->box.diagonal() / 2 * (1 + 1e-5)};
  auto* const make =
      reinterpret_cast<MakeMeshTracer*>(plugin_symbol("trace", kMakeMeshTracerSymbol));
  impl_->tracer.reset(make({mesh.position.front().data(), mesh.position.size(),
                            mesh.face.front().data(), mesh.face.size()}));
}

MeshRenderer::~MeshRenderer() = default;

Image MeshRenderer::render(const Camera& camera,
                           const std::function<void(double)>& progress) const {
  require_usable(camera);
  const MeshRenderOptions& options = impl_->options;
  const Shader shader(options.lit ? &impl_->scene : nullptr, camera, 0, true);
  const View view{camera, shader, camera.eye - impl_->mesh.origin};
  Image image = supersample(
      camera, {options.samples, options.lowpass},
      [&](double x, double y, int /*worker*/) {
        return options.bounces > 0 ? impl_->trace_bent(view, x, y) : impl_->trace(view, x, y);
      },
      progress);
  if (options.relief == Relief::kNone) {
    composite_over(image, camera.drawn_rows(), options.background);
  } else {
    const auto& [red, green, blue, alpha] = options.background;
    add_relief(image, impl_->nearness(view), camera, options.relief,
               {alpha * red, alpha * green, alpha * blue, alpha});
  }
  return image;
}

SceneExtent MeshRenderer::extent() const {
  const TriangleMesh& mesh = impl_->mesh;
  SceneExtent extent;
  if (mesh.face.empty()) return extent;
  extent.box.add(mesh.origin + impl_->box.min);
  extent.box.add(mesh.origin + impl_->box.max);
  extent.support = [&mesh](const Vec3d& a, double /*b*/) {
    double greatest = -std::numeric_limits<double>::infinity();
    for (const auto& face : mesh.face) {
      for (const std::uint32_t v : face) {
        greatest = std::max(greatest, a.dot(mesh.position[v].cast<double>()));
      }
    }
    return greatest + a.dot(mesh.origin);
  };
  return extent;
}

}  // namespace surfel
