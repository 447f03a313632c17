// SP06: coverage that saturates, quantised depth.

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <surfel/sp06/enlargement.h>
#include <surfel/sp06/methods.h>

#include "render/scenes.h"
#include "stability/views.h"

namespace surfel::test {
namespace {

/// Discs so small that there is much to cover, on a surface without holes.
struct SaturatedGroup {
  Discs discs = make_discs(make_hard_case("saturated").cloud, 0.1);
  DiscSurface surface{make_discs(make_hard_case("saturated").cloud, 9), false};
  GroupCells cells{discs, surface};
};

Place saturated(Effort effort) {
  Place place{.title = "Coverage that saturates",
              .measure = "relative error of the covered area",
              .slack = 1e-6,
              .published = "SP06 (9), 200 iterations: `--fixed-point 200`",
              .ours = "bracketing: `surfel-group --groups 1 --cover enlarge --cover-target` share",
              .why =
                  "the fixed point creeps where discs overlap, and has no limit beyond what can "
                  "be covered; a bracket ends where every cell is covered"};
  const SaturatedGroup group;
  const Discs& discs = group.discs;
  const GroupCells& cells = group.cells;
  for (const double share : {0.8, 0.95, 0.99, 0.999}) {
    if (effort == Effort::kTest && share != 0.999) continue;
    const double area = share * cells.area();
    const auto error = [&](const Enlargement& e) {
      return std::abs(cells.covered_area(discs.radius, e.factor) / area - 1);
    };
    const Enlargement fixed = enlarge_by_fixed_point(cells, discs.radius, area, 200);
    const Enlargement ours = enlarge_by_bracketing(cells, discs.radius, area);
    place.rows.push_back({"saturated", error(fixed), error(ours), 1e-5,
                          fmt::format("share {}; {} against {} evaluations", share,
                                      fixed.iterations, ours.iterations)});
  }
  return place;
}

Place unreachable(Effort) {
  Place place{.title = "Coverage that cannot be reached",
              .measure = "largest disc by that which covers its cell",
              .slack = 1e-6,
              .published = "SP06 (9), 5000 iterations: `--fixed-point 5000`",
              .ours = "bracketing: `surfel-group --groups 1 --cover enlarge`",
              .why = "with the area asked for 5 % more than there is, (9) has no fixed point"};
  const SaturatedGroup group;
  const Discs& discs = group.discs;
  const GroupCells& cells = group.cells;
  double full = 1;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    full = std::max(full, cells.reach(i) / static_cast<double>(discs.radius[i]));
  }
  const double area = 1.05 * cells.area();
  place.rows.push_back({"saturated",
                        enlarge_by_fixed_point(cells, discs.radius, area, 5000).factor / full,
                        enlarge_by_bracketing(cells, discs.radius, area).factor / full, 1.0001});
  return place;
}

/// Share of the pixels that do not show the splat whose centre is nearest, in units of its size, as
/// (10) is to have it. All splats are of one group and have colours of their own.
double share_not_nearest(const HardScene& scene, const Camera& camera, Voronoi voronoi) {
  RenderOptions options;
  options.lit = false;
  options.method = compositing_method(Method::kDeferred, {.voronoi = voronoi});
  options.kernel = Kernel::kAffine;
  RenderCloud surfels(scene.cloud, columns_of(Method::kDeferred));
  const Scene lights;
  const Image image = Renderer(surfels, lights, options).render(camera);
  std::vector<EwaKernel> kernels;
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    kernels.push_back(*make_ewa_kernel(in_camera(scene.cloud, i, camera), camera, options.lowpass));
  }
  int wrong = 0;
  int count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      double best = options.cutoff;
      double second = options.cutoff;
      std::size_t nearest = kernels.size();
      for (std::size_t i = 0; i < kernels.size(); ++i) {
        const Eigen::Vector2d d = Eigen::Vector2d(x + 0.5, y + 0.5) - kernels[i].center;
        if (d.squaredNorm() > 2 * options.cutoff * kernels[i].Sigma.trace()) continue;
        const double beta = kernels[i].beta({x + 0.5, y + 0.5});
        second = std::min(second, std::max(beta, best));
        if (beta < best) {
          best = beta;
          nearest = i;
        }
      }
      if (nearest == kernels.size() || second - best < 1e-3) continue;
      ++count;
      const float* p = image.pixel(x, y);
      const Vec3f shown(p[0], p[1], p[2]);
      wrong += (shown - p[3] * scene.cloud.color[nearest]).norm() > 0.01F ? 1 : 0;
    }
  }
  return static_cast<double>(wrong) / count;
}

Place quantised(Effort effort) {
  Place place{.title = "Quantised depth",
              .measure = "share of the pixels that do not show the nearest splat of their group",
              .slack = 1e-3,
              .published = "SP06 (6), (10): `--method deferred --voronoi quantised`",
              .ours = "`--method deferred` (`--voronoi windowed`)",
              .why =
                  "a surface that crosses a step of the depth is cut there; a window of epsilon "
                  "has no steps"};
  for (const double angle : {0.0, 30.0, 60.0}) {
    if (effort == Effort::kTest && angle != 60) continue;
    const HardScene scene = make_hard_case(named("quantised", angle));
    const Camera camera = case_camera(scene.view, effort);
    place.rows.push_back({named("quantised", angle),
                          share_not_nearest(scene, camera, Voronoi::kQuantised),
                          share_not_nearest(scene, camera, Voronoi::kWindowed), 0.01});
  }
  return place;
}

}  // namespace

std::vector<Measurement> group_places() {
  return {{"Saturated", one<saturated>},
          {"Unreachable", one<unreachable>},
          {"Quantised", one<quantised>}};
}

}  // namespace surfel::test
