#pragma once

// Deferred shading, SS01 section 4: each fragment once, with its filtered normal. Environments:
// SP06 section 5.2.3.

#include <array>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/lighting.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/scene.h>

namespace surfel {

/// Reflectance of an interface at an angle of incidence of this cosine, for unpolarised light: with
/// an index of refraction (inside by outside) Fresnel's equations for dielectrics, scaled to be
/// `normal_reflectance` at normal incidence and 1 at total reflection; without one Schlick's
/// approximation ("An inexpensive BRDF model for physically-based rendering", 1994, (15)). 0 where
/// `normal_reflectance` is 0.
SURFEL_API Vec3f fresnel_reflectance(const Vec3f& normal_reflectance, std::optional<float> ior,
                                     float cosine);

/// A ray after refraction, SP06 (12).
struct RefractedRay {
  Vec3f direction;  ///< Unit; at total reflection the mirrored ray's.
  /// Change of the direction's angle by the normal's angle, in the plane of incidence ...
  float by_normal;
  float by_direction;  ///< ... and by the incident ray's angle.
};

/// sin(theta_T) = eta^layers sin(theta_I), where eta = 1 / ior. `normal` and `to_eye` are unit, on
/// the same side.
SURFEL_API RefractedRay refract(const Vec3f& to_eye, const Vec3f& normal, float ior, float layers);

/// The surfaces through which a pixel sees its background. A surface that covers only a part of the
/// pixel, because another surface begins there or because it is the tail of a kernel, refracts only
/// its share of the light.
class SURFEL_API SeenThrough {
 public:
  /// The next surface, front to back.
  /// \param surfaces How many surfaces the fragment stands for: 1, or more where it is merged.
  /// \param coverage share of the pixel that the surface covers, 0..1.
  /// \param opacity  opacity of the surface after shading: surfaces behind an opaque one do not
  ///     count.
  void add(const Fragment& surface, float surfaces, float coverage, float opacity);

  /// Number of surfaces that are the nearest ones in some share of the pixel.
  int count() const { return count_; }
  const Fragment& surface(int i) const { return surface_[static_cast<std::size_t>(i)]; }
  /// Share of the pixel that surface i covers and no surface before i does.
  float share(int i) const { return share_[static_cast<std::size_t>(i)]; }
  /// The share of the pixel that no surface covers. Surfaces are taken to lie upon one another.
  float uncovered() const { return uncovered_; }
  /// SP06's l, a real number as in the paper: the sum of the coverages of all surfaces up to the
  /// first opaque one.
  float layers() const { return layers_; }

 private:
  static constexpr int kMost = 4;  ///< The last surface stands for all that follow.
  std::array<Fragment, kMost> surface_;
  std::array<float, kMost> share_;
  int count_ = 0;
  float uncovered_ = 1;
  float layers_ = 0;
  bool opaque_ = false;
};

/// A place of a surface and the ray by which it is seen.
struct SeenSurface {
  const Material& material;
  Vec3f to_eye;       ///< Unit; towards where the ray comes from.
  Vec3f normal;       ///< Unit, on the side of `to_eye`.
  float mean_length;  ///< Length of the mean of the surface's unit normals there, 1 at most.
  /// Variance of the normals along an axis, microfacets included, radians^2.
  float normal_variance;
};

/// Variance of the normals of a material's microfacets along an axis, radians^2: see Shader.
SURFEL_API float microfacet_variance(const Material& material);

/// Turns fragments into colours: unlit (the filtered texture itself) or lit by a scene's lights
/// with the reflection model of Blinn and Phong, and by its environment. Normals are seen from both
/// sides. For one camera.
///
/// Environment. Every fragment reflects it, as if there were nothing else around; a back face as
/// much as a front face at the same angle, since a ray that Snell has turned at the front of a body
/// meets the back at the angle inside, where Fresnel's equations give the same. What passes through
/// all surfaces of a pixel sees it behind them: refracted at the nearest surface (12), less what
/// the layers absorb (11). Opacity needs no equation (11): to composite l layers of opacity alpha
/// leaves (1 - alpha)^l.
///
/// Filtering. Curved surfaces minify what they mirror. How much normals vary in a fragment shows in
/// the length of their mean (Toksvig, "Mipmapping normal maps", 2005), -ln |mean| being their
/// variance along an axis; reflection turns a ray by twice a normal's turn, refraction by
/// RefractedRay::by_normal. Microfacets of width alpha are such a variance as well, alpha^2 / 2
/// (Wang et al., "All-frequency rendering of dynamic, spatially-varying reflectance", 2009), and
/// the pixel filter one of the ray's direction. The lookup has the sum of all.
///
/// Mean normals. The length of the mean matters to lights as well: highlights widen as the mean
/// gets shorter, by Toksvig's exponent, and Lambert's law has the mean as it is, so that a crease
/// between two lit faces is as bright as they are.
///
/// Normal maps. Where normals come from a map, a fragment's side, not its normal, tells whether the
/// normal is to be turned to the eye: mapped normals of faces that are seen from the side may look
/// away.
class SURFEL_API Shader {
 public:
  /// The reflection of the last fragment that was shaded at a place.
  struct Reflected {
    const Material* material = nullptr;  ///< The fragment's; null: there was no fragment.
    Vec3f normal;                        ///< Unit, on the eye's side.
    float normal_variance;               ///< Variance of the normals along an axis, radians^2.
    Vec3f reflectance, radiance;
  };
  /// `scene` null: unlit. Refers to the scene.
  /// \param lowpass  Standard deviation of the pixel filter, pixels, where the fragments are
  ///                 filtered with it; 0 where several rays a pixel are going to be.
  /// \param mapped   The fragments' normals come from a normal map.
  ///
  /// Throws Error(kUsage) if the scene's environment has not been loaded.
  Shader(const Scene* scene, const Camera& camera, double lowpass = 0, bool mapped = false);
  Shader(const Shader&) = delete;
  Shader& operator=(const Shader&) = delete;

  bool lit() const { return scene_ != nullptr; }
  bool has_environment() const { return environment_ != nullptr; }
  /// The lights and materials of fragments; null if unlit. Valid as long as the shader.
  const Lighting* lighting() const { return lit() ? &lighting_ : nullptr; }

  /// Colour of an unmerged fragment seen at picture coordinates (x, y), pixels, pixel centres at
  /// +1/2: normalised by the sum of rho (9), shaded, its opacity multiplied with its coverage
  /// min(1, sum of rho / full_weight). A reflection is added in full whatever the fragment's
  /// opacity; the opacity that is returned hides what lies behind fragment and reflection together.
  Rgba shade(const Fragment& fragment, float x, float y, float full_weight) const {
    Reflected unknown;
    return shade(fragment, x, y, full_weight, unknown);
  }
  /// Shades as above, and looks the environment up only once for successive fragments of a place
  /// whose reflections are alike.
  /// \param reflected  kept from fragment to fragment of the place (x, y).
  Rgba shade(const Fragment& fragment, float x, float y, float full_weight,
             Reflected& reflected) const;

  /// What is seen of the environment at a place where there is no surface; nothing if there is none
  /// or it is not visible.
  Rgba open_view(float x, float y) const;
  /// The environment's radiance behind all surfaces of a pixel, seen through the nearest one:
  /// refracted `layers` times (once where the scene says so), in each of R, G and B by its own
  /// index, straight ahead where the surface does not refract. Black without an environment. To be
  /// multiplied by the transmittance that the surfaces leave.
  /// \param layers  SP06's l, a real number as in the paper: surfaces up to the first opaque one,
  ///     each counted by its coverage.
  Vec3f behind(const Fragment& nearest, float x, float y, float layers) const;
  Vec3f behind(const Fragment& nearest, float x, float y, int layers) const {
    return behind(nearest, x, y, static_cast<float>(layers));
  }

  /// Composites a pixel's surfaces over the environment: behind() where there are surfaces, the
  /// environment itself where there are none and in so far as it is visible. A surface that does
  /// not refract is seen straight through, and shows no invisible environment. Where it shows, the
  /// pixel becomes opaque. Nothing happens without an environment.
  /// \param color  the surfaces' composite, premultiplied.
  void add_environment(Rgba& color, const SeenThrough& surfaces, float x, float y) const;

  /// Colour of a surface under the scene's lights alone, neither mirrored nor seen through; 0 to 1
  /// and beyond. Of a lit shader.
  /// \param color  the surface's own, unpremultiplied.
  /// \param surface  its material is one of the scene's.
  /// \param place  relative to the camera's eye, world axes; point lights need it.
  Vec3f lit_color(const Vec3f& color, const SeenSurface& surface, const Vec3f& place) const;
  /// Radiance of the environment from a direction in world axes, of any length but zero, filtered
  /// with `variance`, radians^2. Only where there is an environment.
  Vec3f radiance(const Vec3f& direction, float variance) const;

  /// Conversions between Splat::depth and the depth z along the view.
  float z(float depth) const { return lighting_.orthographic ? -depth : 1.0F / depth; }
  float depth(float z) const { return lighting_.orthographic ? -z : 1.0F / z; }
  /// How much depths, as Splat::depth, differ that are as far apart as pixels are at this depth.
  float pixel_depth(float depth) const {
    return lighting_.inv_focal_x * (lighting_.orthographic ? 1.0F : depth);
  }

 private:
  SeenSurface surface(const Fragment& fragment, float x, float y) const;
  /// Shades a fragment of two materials: by each of them, and blends the colours by their shares.
  Rgba shade_mixed(const Fragment& fragment, const OtherMaterial& other, float x, float y,
                   float full_weight) const;
  /// Direction from the eye through picture coordinates (x, y), world axes; perspective cameras
  /// give it z = 1 along the view.
  Vec3f ray(float x, float y) const;
  /// Vector in world axes that leads z along the view, and across it as far as picture coordinates
  /// (x, y) lie from the principal point at depth 1.
  Vec3f from_eye(float x, float y, float z) const;
  Vec3f lit_color(const Vec3f& color, const SeenSurface& surface, float x, float y,
                  float depth) const;
  const Lighting::Reflection& reflection(const SeenSurface& surface) const {
    return materials_[static_cast<std::size_t>(&surface.material - scene_->materials.data())];
  }

  const Scene* scene_;
  const Environment* environment_ = nullptr;
  std::vector<Lighting::Light> lights_;
  std::vector<Lighting::Reflection> materials_;
  Lighting lighting_{};
  Eigen::Matrix3f world_from_camera_;
  Eigen::Matrix3f map_from_world_;  ///< The environment's rotation, undone.
  /// Variance of a ray's direction within its pixel, along an axis, radians^2.
  float ray_variance_;
};

}  // namespace surfel
