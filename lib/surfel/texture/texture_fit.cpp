#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/ewa_fit.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {
namespace {

void check_columns_present(const SurfelCloud& cloud, const std::string& name) {
  if (cloud.empty()) return;
  if (cloud.uv.empty()) {
    throw_input(name,
                "the surfels have no texture coordinates (u, v); sample them with surfel-from-mesh "
                "from a mesh that has some");
  }
  if (cloud.dpdu.empty() || cloud.dpdv.empty()) {
    throw_input(name,
                "the surfels have no surface derivatives (dpdu_x ... dpdv_z); sample them with "
                "surfel-from-mesh or surfel-generate");
  }
  const bool frame = !cloud.variance_u.empty() && !cloud.variance_v.empty();
  if (cloud.anisotropic() ? !frame : cloud.variance.empty()) {
    throw_input(name,
                "the surfels have no variance; surfel-from-mesh and surfel-estimate write one");
  }
}

void check_materials(const SurfelCloud& cloud, const TextureSet& textures,
                     const std::string& name) {
  if (textures.maps.empty()) throw_usage("there is no texture");
  const std::size_t materials = textures.map_of_material.size();
  if (materials == 0 || cloud.empty()) return;
  if (cloud.material.empty()) {
    if (materials == 1) return;
    throw_input(name, fmt::format("the surfels have no material to tell {} of the mesh apart; "
                                  "sample them with surfel-from-mesh, or give one image",
                                  materials));
  }
  const auto largest = std::max_element(cloud.material.begin(), cloud.material.end());
  if (*largest >= materials) {
    throw_input(name, fmt::format("surfel {} has material {}, but the mesh has {}; give the mesh "
                                  "that the surfels were sampled from",
                                  largest - cloud.material.begin(), *largest, materials));
  }
}

}  // namespace

std::vector<std::string> TextureFitOptions::problems() const {
  std::vector<std::string> found;
  if (!(reconstruction >= 0.25 && reconstruction <= 16)) {
    found.push_back(
        fmt::format("reconstruction is {}; it must be 0.25 to 16 texels", reconstruction));
  }
  if (!(max_aspect >= 1 && max_aspect <= 10000)) {
    found.push_back(fmt::format("max-aspect is {}; it must be 1 to 10000", max_aspect));
  }
  return found;
}

TextureFitReport fit_texture(SurfelCloud& cloud, TextureSet& textures,
                             const TextureFitOptions& options, const std::string& name) {
  for (const std::string& problem : options.problems()) throw_usage(problem);
  check_columns_present(cloud, name);
  check_materials(cloud, textures, name);

  TextureFitReport report;
  report.surfels = cloud.size();
  switch (options.kind) {
    case TextureFitKind::kEwa:
      fit_ewa(cloud, textures, options, report);
      break;
  }
  if (!cloud.empty()) {
    report.coefficient_min = report.coefficient_max = cloud.coefficient.front();
    for (const Vec3f& w : cloud.coefficient) {
      report.coefficient_min = report.coefficient_min.cwiseMin(w);
      report.coefficient_max = report.coefficient_max.cwiseMax(w);
    }
  }
  return report;
}

}  // namespace surfel
