// SP06: coverage that saturates, quantised depth.

#include <cmath>

#include <fmt/format.h>
#include <surfel/group/coverage.h>
#include <surfel/group/enlargement.h>
#include <surfel/group/grouping.h>

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

Place quantised(Effort effort) {
  Place place{.title = "Quantised depth",
              .measure = "PSNR to `--reference` where that is opaque, dB",
              .higher_better = true,
              .slack = 0.1,
              .published = "SP06 (6), (10): `--method deferred --voronoi quantised`",
              .ours =
                  "`--method deferred` (`--voronoi windowed`), both after `surfel-group --groups 4 "
                  "--cover enlarge-each`",
              .why =
                  "a surface that crosses a step of the depth is cut there; a window of epsilon "
                  "has no steps"};
  for (const double angle : {30.0, 60.0, 80.0}) {
    if (effort == Effort::kTest && angle != 60) continue;
    HardScene scene = make_hard_case(named("quantised", angle));
    group_splats(scene.cloud, {.groups = 4});
    cover_groups(scene.cloud);
    const Camera camera = case_camera(scene.view, effort);
    const Image truth = draw_reference(scene.cloud, camera, effort);
    const auto picture = [&](Voronoi voronoi) {
      RenderOptions options;
      options.lit = false;
      options.method = Method::kDeferred;
      options.voronoi = voronoi;
      const RenderCloud surfels(scene.cloud, columns_of(Method::kDeferred));
      const Scene lights;
      return Renderer(surfels, lights, options).render(camera);
    };
    place.rows.push_back({named("quantised", angle),
                          psnr_inside(picture(Voronoi::kQuantised), truth),
                          psnr_inside(picture(Voronoi::kWindowed), truth), 15});
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
