#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/gaussian/gaussian_options.h>
#include <surfel/gaussian/gaussian_splat.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// kExact: kernels end at 2^-12 of their peak, or of 1 where an optical depth is larger. A share of
/// 2^-12 of each kernel's mass is left out, however faint it is, so that haze of many faint kernels
/// stays, and no pixel loses more of one Gaussian than a sixteenth of a step of 8 bits.
inline constexpr float kExactCut = 12;

/// A camera and a profile, as the projection uses them.
struct GaussianView {
  GaussianProfile profile;  ///< kExact for kSurfel, whose rule is the switch.
  AmplitudeRule rule;
  float rotation[9];     ///< Camera from world, row by row.
  float translation[3];  ///< Camera from the cloud's offsets.
  float eye[3];          ///< In the cloud's offsets.
  float focal_x, focal_y, center_x, center_y;
  int width, height;
  bool orthographic;  ///< Focal lengths are pixels a scene unit.
  float near;         ///< Centres beyond this depth are drawn.
  /// Bounds of x / z and y / z in the derivative of the projection, of trained renderers.
  float least_slope_x, most_slope_x, least_slope_y, most_slope_y;
  float lowpass2;  ///< Variance of the pixel filter, pixels^2.
  float pixel;     ///< Deviation of the pixel filter at depth 1, scene units.
};

GaussianView gaussian_view(const GaussianCloud& cloud, const Camera& camera,
                           const GaussianOptions& options);

/// Projects the Gaussians [begin, end) and writes the splats of the ones that are seen, one after
/// the other; returns how many. Vectors of Gaussians at a time; the same bits for every instruction
/// set.
/// \param splats       room for end - begin.
/// \param perspective  of the same splats, for k2dgs and kExact; else null.
/// \param keys         what the splats are to be ordered by: ascending, a depth's bits.
std::size_t project_gaussians(const GaussianView& view, const GaussianCloud& cloud,
                              std::size_t begin, std::size_t end, GaussianSplat* splats,
                              GaussianPerspective* perspective, std::uint32_t* keys);

}  // namespace surfel
