#include <algorithm>
#include <cmath>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/sample/cut_search.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/mesh_face.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/texture/adaptive_spacing.h>

namespace surfel {
namespace {

/// Samples that the mesh is first looked at in: 0.3 s of work, and all that smooth meshes need.
constexpr double kFewestProbes = 1 << 15;
/// Share of the samples in cells as small as they come that calls for a closer look.
constexpr double kFinestShare = 0.05;
/// Precision of the logarithm of a cut's price: 0.05 % of the number of samples.
constexpr double kPricePrecision = 1e-3;

double surface_area(const TriangleMesh& mesh) {
  double sum = 0;
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    sum += area_vector(face_corners(mesh, f)).norm() / 2;
  }
  return sum;
}

double diagonal(const TriangleMesh& mesh) {
  Vec3f low = mesh.position[mesh.face.front()[0]];
  Vec3f high = low;
  for (const auto& face : mesh.face) {
    for (const std::uint32_t v : face) {
      low = low.cwiseMin(mesh.position[v]);
      high = high.cwiseMax(mesh.position[v]);
    }
  }
  return (high - low).cast<double>().norm();
}

/// Edges that have a face on one side alone, in pieces no longer than `longest`.
std::vector<BorderPiece> border_pieces(const TriangleMesh& mesh, const Array<std::uint32_t>& rings,
                                       double longest) {
  std::vector<BorderPiece> pieces;
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      if (rings[3 * f + k] != kBorderEdge) continue;
      const Vec3f& a = mesh.position[mesh.face[f][k]];
      const Vec3f& b = mesh.position[mesh.face[f][(k + 1) % 3]];
      const float length = (b - a).norm();
      const int n = static_cast<int>(std::ceil(length / longest));
      for (int i = 0; i < n; ++i) {
        const float t = (static_cast<float>(i) + 0.5f) / static_cast<float>(n);
        pieces.push_back({a + t * (b - a), length / static_cast<float>(n)});
      }
    }
  }
  return pieces;
}

/// Uniform samples of the mesh with their colours as fine as the texture has them.
std::vector<SurfaceProbe> look(const TriangleMesh& mesh, TextureSet* textures, double spacing,
                               std::uint64_t seed, const std::string& name) {
  MeshSampleOptions sampling;
  sampling.spacing = spacing;
  sampling.seed = seed;
  SurfelCloud cloud = sample_mesh(mesh, sampling, nullptr, name);
  const Array<Vec3f>* color = &cloud.color;
  if (textures) {
    // The reconstruction kernel alone, a texel wide: where surfels are finer than texels, edges
    // between texels are no detail that more of them would show.
    std::fill(cloud.variance.begin(), cloud.variance.end(), 0.0f);
    fit_texture(cloud, *textures, {.reconstruction = 1}, name);
    color = &cloud.coefficient;
  }
  std::vector<SurfaceProbe> probes(cloud.size());
  for (std::size_t i = 0; i < probes.size(); ++i) {
    const float alpha = cloud.alpha.empty() ? 1 : cloud.alpha[i];
    probes[i] = {cloud.position[i], cloud.normal[i],
                 color->empty() ? Vec3f(0, 0, 0) : Vec3f(alpha * (*color)[i])};
  }
  return probes;
}

}  // namespace

std::vector<std::string> AdaptiveSpacingOptions::problems() const {
  std::vector<std::string> found;
  if (max_error.has_value() == count.has_value()) {
    found.emplace_back("either `max_error` or `count` must be given, and not both");
  }
  if (max_error) check_positive(found, "max_error", *max_error);
  if (count) check_option(found, *count >= 1, "count", *count, "at least 1");
  if (unit_deviation) check_positive(found, "unit_deviation", *unit_deviation);
  check_positive(found, "variance_scale", variance_scale);
  return found;
}

SizingField adaptive_spacing(const TriangleMesh& mesh, TextureSet* textures,
                             const AdaptiveSpacingOptions& options, AdaptiveSpacingReport* report,
                             const std::string& name) {
  require_usable(options);
  AdaptiveSpacingReport unused;
  AdaptiveSpacingReport& out = report ? *report : unused;
  out = {};
  const double area = surface_area(mesh);
  if (!(area > 0)) {
    throw_input(name, "the mesh has no area; there is nothing to sample");
  }
  out.unit_deviation = options.unit_deviation.value_or(diagonal(mesh) / 30);
  const Array<std::uint32_t> rings = edge_rings(mesh);
  StageTimer timer(out.times);
  for (double wanted = kFewestProbes;; wanted *= 4) {
    const double spacing = std::sqrt(area / wanted);
    const std::vector<SurfaceProbe> probes = look(mesh, textures, spacing, options.seed, name);
    timer.end("look");
    const DetailTree tree(probes, border_pieces(mesh, rings, spacing),
                          {area, spacing, out.unit_deviation, options.variance_scale});
    const auto fine_enough = [&](const DetailTree::Cut& tried) {
      if (options.max_error) return tried.error() <= *options.max_error;
      const auto count = static_cast<double>(*options.count);
      if (tried.samples >= count) return true;
      const SizingField field = tree.field(tried);
      const double density = mean_of_probes(probes.size(), [&](std::size_t i) {
        const double h = field.at(probes[i].position);
        return 1 / (h * h);
      });
      return area * density >= count;
    };
    const DetailTree::Cut cut = bracket_cuts(tree, kPricePrecision, fine_enough).fine;
    timer.end("choose");
    const bool reached = !options.max_error || cut.error() <= *options.max_error;
    if ((reached && cut.finest_samples <= kFinestShare * cut.samples) ||
        4 * wanted > static_cast<double>(options.most_probes)) {
      SizingField field = tree.field(cut);
      out.probes = probes.size();
      out.cells = cut.cells.size();
      out.error = cut.error();
      out.color_error = cut.color_error;
      out.shape_error = cut.shape_error;
      out.least_spacing = field.least();
      out.reached = reached;
      return field;
    }
  }
}

}  // namespace surfel
