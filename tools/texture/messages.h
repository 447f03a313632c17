#pragma once

#include <cstddef>

#include <surfel/base/function_ref.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/normal_fit.h>
#include <surfel/texture/surface_lookup.h>
#include <surfel/texture/texture_fit.h>

#include "tools/support/tool.h"
#include "tools/texture/settings.h"

namespace surfel::texture_tool {

/// Surfels that check_mesh() looks at.
inline constexpr std::size_t kMeshSample = 1 << 12;

/// Refuses a mesh that no surfel lies on, and tells where only some do. Where they lie on it, as
/// nearly always, a few thousand surfels show it.
/// \param sample  these, at even steps through the cloud
/// \param all     measures all `surfels`
void check_mesh(const SurfelCloud& sample, std::size_t surfels, const TriangleMesh& mesh,
                FunctionRef<MeshProximity()> all, const Settings& s, tool::Tool& tool);
void check_mesh(const SurfelCloud& cloud, const TriangleMesh& mesh, const Settings& s,
                tool::Tool& tool);

/// Tells where surfels that come without uv were found on the mesh.
void tell_located(const SurfaceLookupReport& found, std::size_t surfels, const Settings& s,
                  tool::Tool& tool);

/// Tells what a fit of colours has found.
/// \param areas  The surfels have areas.
void tell_fit(const TextureFitReport& fit, bool areas, const Settings& s, tool::Tool& tool);

void tell_normals(const NormalFitReport& fit, std::size_t surfels, const Settings& s,
                  tool::Tool& tool);

}  // namespace surfel::texture_tool
