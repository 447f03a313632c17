// How lights shade a surface: for one fragment, and for a vector of fragments at a time. Included
// once for each target, see Highway's documentation.

#if defined(SURFEL_RENDER_LIGHTING_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_LIGHTING_INL_H_
#undef SURFEL_RENDER_LIGHTING_INL_H_
#else
#define SURFEL_RENDER_LIGHTING_INL_H_
#endif

#include <cstddef>

#include <hwy/highway.h>
#include <surfel/render/lighting.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// The lit colour of fragments: Lambert's law and Blinn's highlights of all lights, and the ambient
/// light. A surface whose normal is turned from up by the angle t sees (1 + cos t) / 2 of the sky.
/// Lambert's law and the sky take the mean normal with its length. The cosine is linear in the
/// normal, so the faces beside a crease are lit by their own normals and blended by their shares
/// where the light reaches all of them. Highlights widen by the length: Toksvig, "Mipmapping normal
/// maps", 2005.
/// \tparam Ops  What Vector does not have as an operator: set(const float*), dot(), length(),
///     normalized(), positive_part(cosine), and highlight(cosine, half_cosine, length, shininess)
///     of a mean normal that long, which is 0 where the cosine is.
/// \param color  unpremultiplied.
/// \param normal  the mean of unit normals, on the eye's side, with its length; to_eye is unit.
/// \param place  gives the fragments' places relative to the eye, for point lights.
template <class Ops, class Vector, class Place>
HWY_INLINE Vector lit_color(const Lighting& lighting, const Lighting::Reflection& material,
                            const Vector& color, const Vector& normal, const Vector& to_eye,
                            const Place& place) {
  const auto& shine = material.specular;
  const bool shiny = shine[0] != 0 || shine[1] != 0 || shine[2] != 0;
  constexpr float kNone[3] = {0, 0, 0};
  Vector diffuse = Ops::set(material.ambient);
  Vector specular = Ops::set(kNone);
  if (lighting.has_sky) {
    diffuse = diffuse + Ops::dot(normal, Ops::set(lighting.up)) * Ops::set(material.sky);
  }
  for (std::size_t i = 0; i < lighting.light_count; ++i) {
    const Lighting::Light& light = lighting.lights[i];
    const Vector light_color = Ops::set(light.color);
    Vector to_light = Ops::set(light.vector);
    if (light.point) to_light = Ops::normalized(to_light - place());
    const auto cosine = Ops::positive_part(Ops::dot(normal, to_light));
    diffuse = diffuse + cosine * (Ops::set(material.diffuse) * light_color);
    if (!shiny) continue;
    const auto half_cosine = Ops::dot(normal, Ops::normalized(to_light + to_eye));
    const auto highlight =
        Ops::highlight(cosine, half_cosine, Ops::length(normal), material.shininess);
    specular = specular + highlight * (Ops::set(shine) * light_color);
  }
  return color * diffuse + specular;
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
