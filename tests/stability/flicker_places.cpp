// A slow flight over checks that shrink to less than a pixel at the horizon.

#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/scene/framing.h>

#include "stability/views.h"

namespace surfel::test {
namespace {

/// A path's pictures: what changes from frame to frame.
struct Flight {
  double change = 0;    ///< Sum of the RMS differences of neighbouring frames.
  double decibels = 0;  ///< Sum of the PSNR to the reference.
  int frames = 0;
  std::optional<Image> last;

  void add(Image image, const Image& truth) {
    if (last) {
      // What edges do is another matter.
      change += rms(image, *last, [&](int x, int y) { return truth.pixel(x, y)[3] >= 0.99F; });
    }
    decibels += psnr_inside(image, truth);
    ++frames;
    last = std::move(image);
  }
};

/// What the three filters and the reference change along the path.
void add_flights(Place& change, Place& error, const HardScene& scene, double cutoff,
                 Effort effort) {
  const bool table = effort == Effort::kTable;
  const int frames = table ? 60 : 4;
  RenderCloud surfels(scene.cloud);
  const Scene lights;
  RenderOptions options;
  options.lit = false;
  options.cutoff = cutoff;
  const ReferenceRenderer reference(surfels, lights, options, {.samples = table ? 4 : 2});
  const std::vector<std::pair<Filter, std::string>> filters{
      {Filter::kEwa, "ewa"}, {Filter::kNone, "none"}, {Filter::kCircular, "circular"}};
  std::vector<std::unique_ptr<Renderer>> renderers;
  for (const auto& [filter, name] : filters) {
    options.filter = filter;
    renderers.push_back(std::make_unique<Renderer>(surfels, lights, options));
  }
  std::vector<Flight> flights(filters.size());
  Flight truth_flight;
  for (int i = 0; i < frames; ++i) {
    CameraOptions view = scene.view;
    const Vec3d moved = 0.003 * i * Vec3d(0, -0.3, -1);
    *view.eye += moved;
    *view.target += moved;
    const Camera camera = case_camera(view, effort);
    const Image truth = reference.render(camera);
    for (std::size_t k = 0; k < filters.size(); ++k) {
      flights[k].add(renderers[k]->render(camera), truth);
    }
    truth_flight.add(truth, truth);
  }
  const auto excess = [&](const Flight& flight) {
    return std::abs(flight.change / truth_flight.change - 1);
  };
  for (std::size_t k = 1; k < filters.size(); ++k) {
    const std::string note = fmt::format("{}, `--cutoff {}`", filters[k].second, cutoff);
    change.rows.push_back({"flicker:64", excess(flights[k]), excess(flights[0]), 4, note});
    error.rows.push_back(
        {"flicker:64", flights[k].decibels / frames, flights[0].decibels / frames, 25, note});
  }
}

std::vector<Place> fly(Effort effort) {
  Place change{
      .title = "Flicker: change",
      .measure =
          "RMS change from frame to frame by that of `--reference`, less 1 (in "
          "size), 60 frames",
      .slack = 0.01,
      .published = "SS01 figure 8: `--filter none`, `--filter circular`",
      .ours = "`--filter ewa` (default)",
      .why =
          "what is smaller than a pixel is filtered, and no more than that: aliases "
          "change more than the truth, blur changes less. At cutoff 1 kernels end too soon "
          "for that"};
  Place error{.title = "Flicker: error",
              .measure = "PSNR to `--reference` where that is opaque, dB, mean of 60 frames",
              .higher_better = true,
              .slack = 0.1,
              .published = change.published,
              .ours = change.ours,
              .why = "the same path"};
  const HardScene scene = make_hard_case("flicker:64");
  for (const double cutoff : {1.0, 2.0}) {
    if (effort == Effort::kTest && cutoff == 1) continue;
    add_flights(change, error, scene, cutoff, effort);
  }
  return {change, error};
}

}  // namespace

std::vector<Measurement> flicker_places() { return {{"Flicker", fly}}; }

}  // namespace surfel::test
