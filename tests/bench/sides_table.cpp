// Prints the table of sides in docs/estimation.md: how many normals are on the wrong side, by
// method and scene; tests/estimation.sh calls it.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/morton.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/orientation.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/surface/neighbor_lists.h>

#include "support/side_scenes.h"

namespace {

using namespace surfel;
using namespace surfel::test;

SidedPoints of_cloud(const SurfelCloud& cloud) {
  SidedPoints out;
  out.position = cloud.position;
  out.truth = cloud.normal;
  double area = 0;
  for (const float a : cloud.area) area += a;
  out.spacing = std::sqrt(area / static_cast<double>(cloud.size()));
  return out;
}

std::string test_data(const std::string& name) {
  const char* data = std::getenv("SURFEL_TEST_DATA");
  return fmt::format("{}/{}", data ? data : SURFEL_TEST_DATA_DEFAULT, name);
}

/// A scan and what tells its sides: the normals of its file, its viewpoint, or up.
SidedPoints of_scan(const std::string& name, const std::optional<Vec3d>& up) {
  const SurfelCloud cloud = read_cloud(test_data(name));
  SidedPoints out;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = cloud.position[i].cast<double>();
    Vec3d side = up.value_or(Vec3d(0, 0, 0));
    if (cloud.viewpoint) {
      side = (cloud.viewpoint->position - cloud.origin - p).normalized();
    } else if (!cloud.normal.empty()) {
      side = cloud.normal[i].cast<double>();
    }
    if (p.allFinite() && side.allFinite()) out.add(p, side);
  }
  return out;
}

SidedPoints of_mesh(const std::string& name, std::size_t count) {
  const std::string path = test_data("meshes/" + name);
  MeshSampleOptions options;
  options.count = count;
  return of_cloud(sample_mesh(read_mesh(path), options, nullptr, path));
}

SidedPoints of_scene(const std::string& kind, std::size_t count) {
  GenerateOptions options;
  options.count = count;
  return of_cloud(generate_surfels(procedural_scene(kind, 1), options));
}

SidedPoints nested(std::size_t count) {
  const SidedPoints sphere = of_scene("sphere", count / 2);
  SidedPoints out = sphere;
  for (std::size_t i = 0; i < sphere.position.size(); ++i) {
    out.position.push_back(0.8F * sphere.position[i]);
    out.truth.push_back(-sphere.truth[i]);
  }
  return out;
}

SidedPoints in_order(const SidedPoints& points) {
  SidedPoints out;
  out.spacing = points.spacing;
  for (const std::uint32_t i : morton_order(points.position)) {
    out.position.push_back(points.position[i]);
    out.truth.push_back(points.truth[i]);
  }
  return out;
}

/// The share of the normals that are on the wrong side, of the normals that lie within 60 degrees
/// of the true line: a normal across it has no side.
double wrong_share(const Array<Vec3f>& normal, const Array<Vec3f>& truth, bool closed) {
  std::size_t wrong = 0;
  std::size_t sided = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const float product = normal[i].dot(truth[i]);
    if (!(std::abs(product) > 0.5F)) continue;
    ++sided;
    wrong += product < 0 ? 1 : 0;
  }
  if (!closed) wrong = std::min(wrong, sided - wrong);
  return 100 * static_cast<double>(wrong) / static_cast<double>(std::max<std::size_t>(sided, 1));
}

/// The rows that are asked for.
struct Table {
  std::string only;    ///< The scenes whose names begin with it are measured.
  std::string folder;  ///< Where clouds are written, wrong sides red; empty: they are not.

  void row(const std::string& name, const std::function<SidedPoints()>& make,
           const SideDamage& damage = {}, bool closed = true) const;
};

void write(const std::string& path, const SidedPoints& points, const Array<Vec3f>& normal) {
  SurfelCloud cloud;
  cloud.position = points.position;
  cloud.normal = normal;
  for (std::size_t i = 0; i < normal.size(); ++i) {
    cloud.color.push_back(normal[i].dot(points.truth[i]) < 0 ? Vec3f(0.8F, 0.05F, 0.02F)
                                                             : Vec3f(0.6F, 0.6F, 0.55F));
  }
  write_cloud(cloud, path);
}

void Table::row(const std::string& name, const std::function<SidedPoints()>& make,
                const SideDamage& damage, bool closed) const {
  if (name.compare(0, only.size(), only) != 0) return;
  const SidedPoints points = in_order(damaged(make(), damage));
  const auto tree = make_neighbor_search(points.position);
  const NeighborLists search(*tree, points.position, 16);
  const Array<Vec3f> normal = estimate_normals(points.position, search).normal;
  // PCL turns normals to a viewpoint, the origin unless told otherwise.
  Array<Vec3f> pcl = normal;
  for (std::size_t i = 0; i < pcl.size(); ++i) {
    if (pcl[i].dot(points.position[i]) > 0) pcl[i] = -pcl[i];
  }
  fmt::print("| {} | {} | {:.2f} % |", name, normal.size(), wrong_share(pcl, points.truth, false));
  for (const auto& [word, method] :
       {std::pair{"mst", Orientation::kMst}, std::pair{"winding", Orientation::kWinding}}) {
    OrientationOptions options;
    options.method = method;
    Array<Vec3f> turned = normal;
    const auto start = std::chrono::steady_clock::now();
    orient_normals(points.position, Vec3d(0, 0, 0), search, {}, options, turned);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    fmt::print(" {:.2f} %, {:.0f} ms |", wrong_share(turned, points.truth, closed), 1000 * seconds);
    if (!folder.empty()) write(fmt::format("{}/{}.ply", folder, word), points, turned);
  }
  fmt::print("\n");
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const Table table{argc > 1 ? argv[1] : "", argc > 2 ? argv[2] : ""};
  fmt::print(
      "## Sides\n\nNormals on the wrong side, of those within 60 degrees of the true line, and the "
      "time that turning them takes, 2 threads.\nNoise in spacings, in all directions; gaps: 40 "
      "balls of 8 % of the half diagonal without points; density: falls along x\nto a twentieth. "
      "PCL turns normals to a viewpoint, which is the origin unless one is given. Of PCL, terrain, "
      "rooms and scans, where nothing says\nwhich side is out, what differs from most. The sides "
      "of scans are those of "
      "their files' normals or viewpoints; up for the forest.\n\n"
      "| scene | points | PCL | mst | winding |\n|---|---|---|---|---|\n");
  for (const double gap : {0.5, 1.0, 1.5, 2.0}) {
    table.row(fmt::format("plate, {} spacings thick", gap), [=] { return thin_plate(40000, gap); });
    table.row(fmt::format("bowl, {} spacings thick", gap), [=] { return bowl(40000, gap); });
    table.row(fmt::format("fins, {} spacings thick", gap), [=] { return fins(100000, gap); });
  }
  table.row("bowl, 1.5 spacings thick, noise 0.15", [] { return bowl(40000, 1.5); },
            {.noise = 0.15});
  table.row("ball with a cavity", [] { return nested(40000); });
  struct Mesh {
    const char* name;
    const char* file;
  };
  for (const Mesh& m :
       {Mesh{"fandisk", "fandisk.obj"}, Mesh{"bunny", "stanford_bunny.obj"},
        Mesh{"armadillo", "armadillo.ply"}, Mesh{"dragon", "dragon_vrip_res2.ply"},
        Mesh{"head, MRI", "mri_head_surface.ply"}, Mesh{"brain", "brain_tristrips.ply"}}) {
    const std::string file = m.file;
    const auto mesh = [file] { return of_mesh(file, 60000); };
    table.row(m.name, mesh);
    table.row(fmt::format("{}, noise 0.5", m.name), mesh, {.noise = 0.5});
    table.row(fmt::format("{}, noise 1", m.name), mesh, {.noise = 1});
    table.row(fmt::format("{}, gaps", m.name), mesh, {.gaps = 40, .gap_size = 0.08});
    table.row(fmt::format("{}, noise 0.3, gaps, density", m.name), mesh,
              {.noise = 0.3, .gaps = 40, .gap_size = 0.08, .density = 0.05});
    table.row(fmt::format("{}, 3000 points", m.name), [file] { return of_mesh(file, 3000); });
  }
  table.row(
      "terrain, noise 0.3, gaps", [] { return of_scene("terrain", 100000); },
      {.noise = 0.3, .gaps = 60, .gap_size = 0.05}, false);
  table.row(
      "room, furniture 1.5 spacings thick", [] { return furnished_room(150000, 1.5); }, {}, false);
  table.row(
      "room, 2.5 spacings thick, noise 0.15, gaps", [] { return furnished_room(150000, 2.5); },
      {.noise = 0.15, .gaps = 60, .gap_size = 0.06}, false);
  struct Scan {
    const char* name;
    const char* file;
    std::optional<Vec3d> up;
  };
  for (const Scan& scan : {Scan{"scan, lion", "colour_clouds/lion_takanawa_third.ply", {}},
                           Scan{"scan, room", "colour_clouds/fragment_normals_rgb.pcd", {}},
                           Scan{"scan, oni", "raw_scans/oni.xyz", {}},
                           Scan{"scan, kitten", "raw_scans/kitten.xyz", {}},
                           Scan{"scan, bunny", "raw_scans/bun000_range_grid.ply", {}},
                           Scan{"scan, mug", "colour_clouds/table_scene_mug_stereo.pcd", {}},
                           Scan{"scan, forest", "lidar/samp11-utm.pcd", Vec3d(0, 0, 1)}}) {
    table.row(
        scan.name, [&] { return of_scan(scan.file, scan.up); }, {}, false);
  }
  const auto million = [] { return of_mesh("armadillo.ply", 1000000); };
  table.row("million points, sphere", [] { return of_scene("sphere", 1000000); });
  table.row("million points, armadillo", million);
  table.row("million points, armadillo, noise 1", million, {.noise = 1});
}
