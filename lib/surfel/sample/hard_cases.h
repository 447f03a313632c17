#pragma once

// Inputs at the places where methods of point rendering fail; docs/stability.md measures them.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel {

/// What a hard case is called and means. Some have a number that says how hard they are.
struct HardCase {
  std::string name;
  std::string what;  ///< One line, with the number's unit.
  double value = 0;  ///< The number where it is not given; meaningless where least == most.
  double least = 0;  ///< Smallest that is accepted.
  double most = 0;
  bool has_value() const { return least < most; }
};

/// A hard case made.
struct HardScene {
  SurfelCloud cloud;                 ///< Points only where surfels are yet to be estimated.
  CameraOptions view;                ///< From where it is hard to see, 128 x 128 pixels.
  std::optional<TriangleMesh> mesh;  ///< With its charts, where these are what is hard ...
  std::optional<Image> image;        ///< ... and the picture on them.
};

/// All of them, in the order of docs/stability.md.
SURFEL_API const std::vector<HardCase>& hard_cases();

/// The case called `text`: "NAME", or "NAME:NUMBER" where it takes one. `seed` chooses the jitter.
/// The same for any number of threads. Throws Error(kUsage) naming the known ones if a name is
/// unknown, or the number's range.
SURFEL_API HardScene make_hard_case(const std::string& text, std::uint64_t seed = 1);

/// The view as options of surfel-render: "--eye 0,0,2 --target 0,0,0 ...".
SURFEL_API std::string view_options(const CameraOptions& view);

}  // namespace surfel
