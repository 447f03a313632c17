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

/// Name and meaning of a hard case. Some cases take a number that says how hard they are.
struct HardCase {
  std::string name;
  std::string what;  ///< Meaning in one line, with the number's unit.
  double value = 0;  ///< Default of the number; meaningless where least == most.
  double least = 0;  ///< Smallest number that is accepted.
  double most = 0;   ///< Largest number that is accepted.
  bool has_value() const { return least < most; }
};

/// Data of a hard case.
struct HardScene {
  SurfelCloud cloud;   ///< Surfels, or points where surfels are yet to be estimated.
  CameraOptions view;  ///< The hard view, 128 x 128 pixels.
  std::optional<TriangleMesh> mesh{};  ///< Mesh with uv, of cases whose charts are hard.
  std::optional<Image> image{};        ///< Picture on the mesh.
};

/// All hard cases, in the order of docs/stability.md.
SURFEL_API const std::vector<HardCase>& hard_cases();

/// Makes the case called `text`: "NAME", or "NAME:NUMBER" where the case takes a number. `seed`
/// chooses the jitter. The case does not depend on the number of threads. Throws Error(kUsage),
/// naming the known cases if the name is unknown, or the number's range if the number is out of it.
SURFEL_API HardScene make_hard_case(const std::string& text, std::uint64_t seed = 1);

/// The view as options of surfel-render: "--eye 0,0,2 --target 0,0,0 ...".
SURFEL_API std::string view_options(const CameraOptions& view);

}  // namespace surfel
