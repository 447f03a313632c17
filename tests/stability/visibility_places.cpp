// What is one surface, in front of which other one, and how much of a pixel it covers.

#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/supersample.h>

#include "stability/published_renderer.h"
#include "stability/views.h"

namespace surfel::test {
namespace {

constexpr const char* kPublished = "SS01 sections 4, 6, 7 (`tests/stability/published_renderer.h`)";

/// Pixels at least `margin` from the border.
std::function<bool(int, int)> within(const Camera& camera, int margin) {
  return [=](int x, int y) {
    return x >= margin && y >= margin && x < camera.width - margin && y < camera.height - margin;
  };
}

/// A picture of one colour.
Image filled(const Camera& camera, const Rgba& color) {
  Image image;
  image.width = camera.width;
  image.height = camera.height;
  image.channels = {"R", "G", "B", "A"};
  for (int i = 0; i < camera.width * camera.height; ++i) {
    for (const float value : {color.red, color.green, color.blue, color.alpha}) {
      image.data.push_back(value);
    }
  }
  return image;
}

Place two_sheets(Effort effort, const std::string& name, const std::vector<double>& gaps,
                 double bound) {
  Place place{.measure = "RMS error against the front sheet's colour",
              .slack = 2e-3,
              .published = kPublished,
              .ours = "`surfel-render`"};
  for (const double gap : gaps) {
    if (effort == Effort::kTest && gap != 0.1 && gap != 3) continue;
    const HardScene scene = make_hard_case(named(name, gap));
    const Camera camera = case_camera(scene.view, effort);
    const Image truth = filled(camera, {0.8F, 0.05F, 0.05F, 1});
    const auto inner = within(camera, 4);
    place.rows.push_back({named(name, gap),
                          rms(render_published<float>(scene.cloud, camera), truth, inner),
                          rms(draw(scene.cloud, camera), truth, inner), bound});
  }
  return place;
}

Place sheets(Effort effort) {
  Place place = two_sheets(effort, "sheets", {0.1, 0.3, 1, 3, 10}, 0.3);
  place.title = "Sheets, both facing the eye";
  place.why =
      "nearer than a disc's radius two sheets cannot be told from one uneven one: both "
      "methods mix them";
  return place;
}

Place thin_body(Effort effort) {
  Place place = two_sheets(effort, "thin-body", {0.01, 0.1, 1, 10}, 1e-4);
  place.title = "Thin body, back to back";
  place.why = "z alone does not tell front from back; the side that is seen does";
  return place;
}

/// Two panes through the y axis, exactly.
Image true_panes(const HardScene& scene, const Camera& camera, Effort effort) {
  struct Pane {
    Vec3d across, normal;
    Rgba color;
  };
  std::vector<Pane> panes;
  const std::size_t half = scene.cloud.size() / 2;
  for (const std::size_t i : {std::size_t{0}, half}) {
    const Vec3d normal = scene.cloud.normal[i].cast<double>();
    const Vec3f& c = scene.cloud.color[i];
    panes.push_back(
        {Vec3d::UnitY().cross(normal), normal, {c.x() / 2, c.y() / 2, c.z() / 2, 0.5F}});
  }
  return supersample(camera, {.samples = effort == Effort::kTest ? 4 : 8, .lowpass = 1},
                     [&](double x, double y, int) {
                       const ViewRay ray = view_ray(camera, x, y);
                       std::map<double, Rgba> hits;
                       for (const Pane& pane : panes) {
                         const Vec3d origin = camera.eye + ray.origin;
                         const double t = -origin.dot(pane.normal) / ray.direction.dot(pane.normal);
                         const Vec3d p = origin + t * ray.direction;
                         if (t > 0 && std::abs(p.dot(pane.across)) < 1 && std::abs(p.y()) < 1) {
                           hits[t] = pane.color;
                         }
                       }
                       Rgba color;
                       for (const auto& [t, c] : hits) color.composite(c);
                       return color;
                     });
}

Place intersecting(Effort effort) {
  Place place{.title = "Intersecting transparent surfaces",
              .measure = "RMS error against exact panes, beside their borders",
              .slack = 2e-3,
              .published = kPublished,
              .ours = "`surfel-render`",
              .why =
                  "near the line both are within epsilon and are mixed. Ours is half the radius of "
                  "disc and pixel filter together where a transparent surface is flat; the "
                  "published one is the disc's alone"};
  for (const double angle : {20.0, 60.0, 120.0}) {
    if (effort == Effort::kTest && angle != 60) continue;
    const HardScene scene = make_hard_case(named("intersecting", angle));
    const Camera camera = case_camera(scene.view, effort);
    const Image truth = true_panes(scene, camera, effort);
    // The middle third around the line where they cross.
    const auto middle = [&](int x, int y) {
      return std::abs(x + 0.5 - camera.center_x) < 16 && within(camera, 4)(x, y) &&
             std::abs(y + 0.5 - camera.center_y) < 40;
    };
    const double published = rms(render_published<float>(scene.cloud, camera), truth, middle);
    place.rows.push_back({named("intersecting", angle), published,
                          rms(draw(scene.cloud, camera), truth, middle), 0.1});
  }
  return place;
}

Place silhouette(Effort effort) {
  Place place{.title = "Silhouettes over background",
              .measure = "RMS error of alpha, edge and inside, against the exact sphere",
              .slack = 2e-3,
              .published = kPublished,
              .ours = "`surfel-render`",
              .why =
                  "tau below the mean sum makes edges too wide; ours completes the sums to the "
                  "pixel filter "
                  "(`render/edge_filter.h`)"};
  for (const double count : {2000, 8000, 100000}) {
    if (effort == Effort::kTest && count != 8000) continue;
    const HardScene scene = make_hard_case(named("silhouette", count));
    // The whole sphere, for tests on fewer pixels.
    CameraOptions view = scene.view;
    if (effort == Effort::kTest) view.width = view.height = 64;
    const Camera camera = make_camera(view, SceneExtent{});
    const double distance = view.eye->norm();
    const Image truth =
        supersample(camera, {.samples = effort == Effort::kTest ? 4 : 8, .lowpass = 1},
                    [&](double x, double y, int) -> Rgba {
                      const Vec3d d = view_ray(camera, x, y).direction.normalized();
                      const double nearest2 = distance * distance - std::pow(camera.eye.dot(d), 2);
                      return nearest2 < 1 ? Rgba{0.8F, 0.8F, 0.8F, 1} : Rgba{};
                    });
    const auto error = [&](const Image& image) {
      double sum = 0;
      for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) {
          const double d = image.pixel(x, y)[3] - truth.pixel(x, y)[3];
          sum += d * d;
        }
      }
      return std::sqrt(sum / (image.width * image.height));
    };
    place.rows.push_back({named("silhouette", count),
                          error(render_published<float>(scene.cloud, camera, {.layers = 1})),
                          error(draw(scene.cloud, camera)), 0.1});
  }
  return place;
}

/// Composite of a stack's panes.
Rgba true_stack(const HardScene& scene) {
  std::map<float, Rgba> panes;  // By -z.
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    const float a = scene.cloud.alpha[i];
    const Vec3f c = a * scene.cloud.color[i];
    panes[-scene.cloud.position[i].z()] = {c.x(), c.y(), c.z(), a};
  }
  Rgba color;
  for (const auto& [z, pane] : panes) color.composite(pane);
  return color;
}

void add_stack_row(Place& place, const std::string& input, int layers, double bound,
                   Effort effort) {
  const HardScene scene = make_hard_case(input);
  const Camera camera = case_camera(scene.view, effort);
  const Image truth = filled(camera, true_stack(scene));
  RenderOptions options;
  options.layers = layers;
  place.rows.push_back(
      {input, rms(render_published<float>(scene.cloud, camera, {.layers = layers}), truth),
       rms(draw(scene.cloud, camera, options), truth), bound, fmt::format("l = {}", layers)});
}

Place layers(Effort effort) {
  Place place{.title = "More surfaces than layers",
              .measure = "RMS error against the exact composite",
              .slack = 2e-3,
              .published = kPublished,
              .ours = "`surfel-render --layers` l",
              .why =
                  "surfels are drawn front to back, so that what has to be merged is complete; "
                  "in the order of a file it is not"};
  for (const int panes : {1, 2, 4, 8, 16}) {
    for (const int l : {1, 2, 3, 8}) {
      if (effort == Effort::kTest && (panes != 4 || l == 8)) continue;
      add_stack_row(place, named("layers", panes), l, l == 1 ? 0.4 : 1e-4, effort);
    }
  }
  return place;
}

Place merge_order(Effort effort) {
  Place place{.title = "Merge order",
              .measure = "RMS error against the exact composite",
              .slack = 2e-3,
              .published = kPublished,
              .ours = "`surfel-render --layers 3`",
              .why = "the picture does not depend on the order of the surfels"};
  for (const char* name : {"layers-near-first", "layers-far-first", "layers"}) {
    add_stack_row(place, named(name, 8), 3, 1e-4, effort);
  }
  return place;
}

}  // namespace

std::vector<Measurement> visibility_places() {
  return {{"Sheets", one<sheets>},
          {"ThinBody", one<thin_body>},
          {"Intersecting", one<intersecting>},
          {"Silhouette", one<silhouette>},
          {"Layers", one<layers>},
          {"MergeOrder", one<merge_order>}};
}

}  // namespace surfel::test
