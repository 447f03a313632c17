// scale_table LEVELS.ply [PROCESSES]: the tables of docs/scale.md. The tree of the file is
// repeated to 10^12 surfels.

#include <cmath>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/io/cloud_io.h>
#include <surfel/render/render_options.h>
#include <surfel/scene/framing.h>
#include <surfel/store/cloud_loader.h>

#include "ranks/scale_model.h"

namespace {

using namespace surfel;
using namespace surfel::test;

struct Place {
  const char* name;
  double height;  ///< Of the eye above the ground, in units of a tile's side.
  double back;    ///< How far the eye is behind what it looks at, likewise.
};

Camera camera_at(const TiledCloud& cloud, const Place& place, int width, int rows) {
  const double side = cloud.side().maxCoeff();
  CameraOptions options;
  options.target = cloud.over_middle(0, 0);
  options.eye = cloud.over_middle(-side * place.back, side * place.height);
  options.up = Vec3d(Vec3d::Unit(cloud.up()));
  options.width = width;
  options.height = rows;
  return make_camera(options, {});
}

void print_row(const std::string& name, const SharedPicture& p, int processes) {
  constexpr double kMega = 1e6;
  fmt::print(
      "| {} | {} | {:.1f} M | {} | {:.0f} | {:.2f} | {:.1f} ({}) | {:.2f} | {:.2f} | {:.0f} / "
      "{:.0f} "
      "| {:.0f} | {:.0f} | {:.0f} |\n",
      name, processes, p.drawn_surfels / kMega, p.messages, p.exchange.bytes / kMega,
      p.most_received / kMega, p.exchange.longest_queue / kMega, p.exchange.most_queued,
      p.most_sent / p.mean_sent, p.most_drawing_time / p.mean_drawing_time, p.held_bytes / kMega,
      p.flight_bytes / kMega, 1e3 * p.exchange.seconds, 1e3 * p.most_drawing_time,
      1e3 * p.gather_seconds);
}

/// Bytes that processes send for a picture of the file itself, whose rows are not balanced yet:
/// surfel-render --from 0.3,0.5,1 --size 1920x1080 --share surfels.
void print_small(const std::string& path, const SurfelCloud& file) {
  const LoadedCloud loaded(path, {.columns = {.levels = true}});
  CameraOptions options;
  options.from = Vec3d(0.3, 0.5, 1);
  options.width = 1920;
  options.height = 1080;
  const Camera camera = make_camera(options, loaded.surfels().extent());
  const TiledCloud one{file.tree, 0};
  const RenderOptions render;
  for (const int processes : {2, 4, 8}) {
    const Dealing dealing = deal(one, processes);
    const TiledCut cut =
        TiledCutter(one, camera, render.lod_pixels(), std::sqrt(2 * render.cutoff), dealing).cut();
    const SharedPicture p =
        share_picture(one, camera, cut, dealing, processes, {}, {}, DealtBy::kTurns, 1);
    fmt::print("{} processes: {} clusters, {:.1f} MB sent, {:.1f} MB received by one at most\n",
               processes, p.drawn_clusters, p.exchange.bytes / 1e6, p.most_received / 1e6);
  }
  fmt::print("\n");
}

void run(const std::string& path, int processes) {
  const SurfelCloud file = read_cloud(path, {.levels = true});
  print_small(path, file);
  const auto finest =
      static_cast<double>(file.tree.back().end - file.tree[first_leaf(file.tree)].begin);
  const TiledCloud cloud{file.tree,
                         static_cast<int>(std::ceil(std::log2(std::sqrt(1e12 / finest))))};
  fmt::print("{:.2e} surfels in {:.2e} clusters, {} tiles of {:.2e}\n\n",
             static_cast<double>(cloud.surfels()), static_cast<double>(cloud.clusters()),
             cloud.tiles(), finest);
  fmt::print(
      "| view | processes | surfels drawn | messages | MB sent | most MB received | longest queue, "
      "MB (messages) | sending, most by mean | drawing, most by mean | MB of tree / of surfels | "
      "exchanged, ms | drawn, ms | gathered, ms |\n|{}\n",
      std::string("---|---|---|---|---|---|---|---|---|---|---|---|---|"));
  const std::vector<Place> places{
      {"all", std::ldexp(0.6, cloud.levels), std::ldexp(0.9, cloud.levels)},
      {"a city", 20, 30},
      {"a street", 0.05, 1}};
  const RenderOptions options;
  for (const Place& place : places) {
    const Camera camera = camera_at(cloud, place, 3840, 2160);
    for (const int count : {8, 125, processes}) {
      const Dealing dealing = deal(cloud, count);
      const TiledCut cut =
          TiledCutter(cloud, camera, options.lod_pixels(), std::sqrt(2 * options.cutoff), dealing)
              .cut();
      print_row(place.name, share_picture(cloud, camera, cut, dealing, count), count);
      if (count != processes) continue;
      print_row(std::string(place.name) + ", ranges",
                share_picture(cloud, camera, cut, dealing, count, {}, {}, DealtBy::kRanges), count);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: scale_table LEVELS.ply [PROCESSES]\n");
    return 2;
  }
  try {
    run(argv[1], argc > 2 ? std::atoi(argv[2]) : 1000);
  } catch (const std::exception& error) {
    fmt::print(stderr, "scale_table: error: {}\n", error.what());
    return 1;
  }
  return 0;
}
