// A slow flight over checks that shrink to less than a pixel at the horizon.

#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "stability/views.h"

namespace surfel::test {
namespace {

/// Root mean square of what changes from frame to frame beyond what changes in the reference.
struct Flight {
  double sum = 0;
  int steps = 0;
  std::optional<Image> last;

  /// Two pictures' difference less that of the reference: (a_i - a_i-1) - (t_i - t_i-1).
  void add(const Image& image, const Image& truth, const std::optional<Image>& last_truth) {
    if (last && last_truth) {
      double squares = 0;
      for (int y = 0; y < truth.height; ++y) {
        for (int x = 0; x < truth.width; ++x) {
          for (int c = 0; c < 3; ++c) {
            const double d = (image.pixel(x, y)[c] - last->pixel(x, y)[c]) -
                             (truth.pixel(x, y)[c] - last_truth->pixel(x, y)[c]);
            squares += d * d;
          }
        }
      }
      sum += std::sqrt(squares / (3.0 * truth.width * truth.height));
      ++steps;
    }
    last = image;
  }
  double mean() const { return sum / steps; }
};

/// What the three filters and the reference change along the path.
void add_flights(Place& place, const HardScene& scene, double cutoff, Effort effort) {
  const bool table = effort == Effort::kTable;
  const int frames = table ? 60 : 4;
  const RenderCloud surfels(scene.cloud);
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
  std::optional<Image> last_truth;
  for (int i = 0; i < frames; ++i) {
    CameraOptions view = scene.view;
    const Vec3d moved = 0.003 * i * Vec3d(0.3, 0, -1);
    *view.eye += moved;
    *view.target += moved;
    const Camera camera = case_camera(view, effort);
    Image truth = reference.render(camera);
    for (std::size_t k = 0; k < filters.size(); ++k) {
      flights[k].add(renderers[k]->render(camera), truth, last_truth);
    }
    last_truth = std::move(truth);
  }
  for (std::size_t k = 1; k < filters.size(); ++k) {
    place.rows.push_back({"flicker:64", flights[k].mean(), flights[0].mean(), 0.06,
                          fmt::format("{}, `--cutoff {}`", filters[k].second, cutoff)});
  }
}

Place flicker(Effort effort) {
  Place place{.title = "Flicker",
              .measure =
                  "mean over a path of 60 frames of the RMS of what changes from frame to "
                  "frame, less what changes in `--reference`",
              .slack = 1e-4,
              .published = "SS01 figure 8: `--filter none`, `--filter circular`",
              .ours = "`--filter ewa` (default)",
              .why = "what is smaller than a pixel is filtered, and no more than that"};
  const HardScene scene = make_hard_case("flicker:64");
  for (const double cutoff : {1.0, 2.0}) {
    if (effort == Effort::kTest && cutoff == 1) continue;
    add_flights(place, scene, cutoff, effort);
  }
  return place;
}

}  // namespace

std::vector<Measurement> flicker_places() { return {{"Flicker", flicker}}; }

}  // namespace surfel::test
