// Prints the first table of docs/estimation.md: normals and sizes against the truth, beside PCL's
// normals on the same points; tests/estimation.sh calls it.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include <fmt/format.h>
#include <pcl/features/normal_3d_omp.h>
#include <pcl/search/kdtree.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/pcl/conversion.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>

#include "support/range_image.h"

namespace {

using namespace surfel;
using test::DepthCamera;
using test::RangeImage;
using test::room_range_image;
using test::share_beyond;

struct Angles {
  double mean, p99;
};

Angles angles(const Array<Vec3f>& normal, const Array<Vec3f>& truth) {
  std::vector<double> all(truth.size());
  double sum = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Vec3d a = normal[i].cast<double>();
    const Vec3d b = truth[i].cast<double>();
    all[i] = std::atan2(a.cross(b).norm(), std::abs(a.dot(b))) * 180 / std::numbers::pi;
    sum += all[i];
  }
  const auto rank = all.begin() + static_cast<std::ptrdiff_t>(all.size() * 99 / 100);
  std::nth_element(all.begin(), rank, all.end());
  return {sum / static_cast<double>(all.size()), *rank};
}

Array<Vec3f> pcl_normals(const SurfelCloud& cloud, int k) {
  const pcl::PointCloud<pcl::PointXYZ>::Ptr points(
      new pcl::PointCloud<pcl::PointXYZ>(toPCL<pcl::PointXYZ>(cloud)));
  pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::Normal> estimation(
      static_cast<unsigned>(thread_count()));
  estimation.setInputCloud(points);
  estimation.setKSearch(k);
  pcl::PointCloud<pcl::Normal> normals;
  estimation.compute(normals);
  Array<Vec3f> out;
  for (const pcl::Normal& n : normals) out.emplace_back(n.normal_x, n.normal_y, n.normal_z);
  return out;
}

struct Cloud {
  SurfelCloud points;
  Array<Vec3f> truth;  ///< Normals.
  Array<Vec3f> clean;  ///< Positions without noise.
  double area = 0;
};

/// Points of a surface, moved along their normals by Gaussian noise of `noise` mean spacings.
Cloud noisy(const std::string& kind, std::size_t count, double noise) {
  GenerateOptions options;
  options.count = count;
  Cloud out;
  out.points = generate_surfels(procedural_scene(kind, 1), options);
  out.truth = out.points.normal;
  out.clean = out.points.position;
  for (const float a : out.points.area) out.area += a;
  const double spacing = std::sqrt(out.area / static_cast<double>(count));
  for (std::size_t i = 0; i < count; ++i) {
    const double u = std::max(random_uniform(11, i, 0), 1e-12);
    const double gauss =
        std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * random_uniform(11, i, 1));
    out.points.position[i] += static_cast<float>(noise * spacing * gauss) * out.truth[i];
  }
  return out;
}

/// Points of a unit sphere on circles of latitude, ten times as far apart as the points on them.
Cloud scan_lines() {
  Cloud out;
  constexpr int kLines = 100;
  for (int line = 0; line < kLines; ++line) {
    const double polar = (line + 0.5) * std::numbers::pi / kLines;
    const int points = std::max(1, static_cast<int>(20 * kLines * std::sin(polar)));
    for (int i = 0; i < points; ++i) {
      const double around = (i + random_uniform(1, line)) * 2 * std::numbers::pi / points;
      const Vec3d p(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around),
                    std::cos(polar));
      out.points.position.push_back(p.cast<float>());
    }
  }
  out.truth = out.points.position;
  out.area = 4 * std::numbers::pi;
  return out;
}

/// Random points of a unit sphere, 100 times as many a unit of area on one half as on the other.
Cloud density_jump() {
  Cloud out;
  for (std::uint64_t i = 0; i < 80000; ++i) {
    const double z = 2 * random_uniform(2, i, 0) - 1;
    if (z < 0 && random_uniform(2, i, 2) > 0.01) continue;
    const double around = 2 * std::numbers::pi * random_uniform(2, i, 1);
    const double r = std::sqrt(1 - z * z);
    out.points.position.push_back(
        Vec3d(r * std::cos(around), r * std::sin(around), z).cast<float>());
  }
  out.truth = out.points.position;
  out.area = 4 * std::numbers::pi;
  return out;
}

SurfelCloud estimated(const SurfelCloud& cloud, bool adaptive, VarianceRule rule) {
  EstimateOptions options;
  options.normals.adaptive = adaptive;
  options.orientation.method = Orientation::kMst;
  options.size.rule = rule;
  return estimate_surfels(cloud, options);
}

/// One row of the table.
void row(const std::string& name, const std::string& noise, const Cloud& cloud, bool closed) {
  const Angles pcl = angles(pcl_normals(cloud.points, 16), cloud.truth);
  const SurfelCloud fixed = estimated(cloud.points, false, VarianceRule::kCover);
  const Angles ours = angles(fixed.normal, cloud.truth);
  const Angles adaptive =
      angles(estimated(cloud.points, true, VarianceRule::kCover).normal, cloud.truth);
  std::size_t wrong = 0;
  double area = 0;
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    wrong += fixed.normal[i].dot(cloud.truth[i]) < 0 ? 1 : 0;
    area += fixed.area[i];
  }
  // An open surface has no outside: what counts is that all are on one.
  if (!closed) wrong = std::min(wrong, cloud.truth.size() - wrong);
  const auto cover = cloud_statistics(fixed).coverage;
  const auto largest =
      cloud_statistics(estimated(cloud.points, false, VarianceRule::kMaxDistance)).coverage;
  fmt::print(
      "| {}, {} | {} | {:.2f} / {:.2f} | {:.2f} / {:.2f} | {:.2f} / {:.2f} | {:.3f} % | "
      "{:.2f} / {:.2f} | {:.3f} |\n",
      name, cloud.truth.size(), noise, pcl.mean, pcl.p99, ours.mean, ours.p99, adaptive.mean,
      adaptive.p99, 100.0 * static_cast<double>(wrong) / static_cast<double>(cloud.truth.size()),
      cover ? cover->overlap : 0, largest ? largest->overlap : 0, area / cloud.area);
  std::fflush(stdout);
}

void accuracy() {
  fmt::print(
      "## Accuracy\n\nPoints of generated surfaces with Gaussian noise along the normal, in mean "
      "spacings. Angles to the true\nnormal in degrees, mean / 99th percentile. Overlap: mean "
      "number of discs (beta < 1) over a point; area: sum of the\nestimated areas by the true "
      "one. Wrong side: --orient mst; of open surfaces those that differ from most.\n\n| surface, "
      "points | noise | PCL, k = 16 | Surfelkit, -k 16 | -k auto | wrong side "
      "| overlap cover / max-distance | area |\n|---|---|---|---|---|---|---|---|\n");
  struct Surface {
    const char* kind;
    std::size_t count;
    bool closed;
  };
  for (const Surface& s : {Surface{"plane", 40000, false}, Surface{"sphere", 40000, true},
                           Surface{"torus", 40000, true}, Surface{"head", 400000, true},
                           Surface{"terrain", 1000000, false}}) {
    for (const double noise : {0.0, 0.1, 0.3}) {
      row(s.kind, fmt::format("{}", noise), noisy(s.kind, s.count, noise), s.closed);
    }
  }
  row("sphere, lines 10 : 1", "0", scan_lines(), true);
  row("sphere, density 100 : 1", "0", density_jump(), true);
}

/// RMS distance from the surface, in spacings.
double distance(const Array<Vec3f>& points, const Cloud& truth) {
  double sum = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double off =
        (points[i] - truth.clean[i]).cast<double>().dot(truth.truth[i].cast<double>());
    sum += off * off;
  }
  const auto count = static_cast<double>(points.size());
  return std::sqrt(sum / count / (truth.area / count));
}

/// Positions and normals before and after smoothing.
void smoothing() {
  struct Column {
    const char* name;
    bool smooth;
    SmoothingOptions smoothing;
    bool adaptive;
  };
  const Column columns[] = {
      {"none", false, {}, false},          {"3, 2", true, {3, 2, true}, false},
      {"4, 2", true, {4, 2, true}, false}, {"5, 2", true, {5, 2, true}, false},
      {"4, 1", true, {4, 1, true}, false}, {"4, 2, points", true, {4, 2, false}, false},
      {"none, -k auto", false, {}, true},  {"4, 2, points, -k auto", true, {4, 2, false}, true}};
  fmt::print(
      "\n## Smoothing\n\nThe same surfaces: RMS distance from the surface in mean spacings / mean "
      "angle of the normals in degrees. Columns by\n--smooth-radius, --smooth-order; `points`: "
      "--smooth-normals points. Normals without smoothing, and of points: -k 16 or auto.\n\n"
      "| surface, points | noise |");
  for (const Column& column : columns) fmt::print(" {} |", column.name);
  fmt::print("\n|---|---|---|---|---|---|---|---|---|---|\n");
  struct Surface {
    const char* kind;
    std::size_t count;
  };
  for (const Surface& s : {Surface{"plane", 40000}, Surface{"sphere", 40000},
                           Surface{"torus", 40000}, Surface{"head", 200000}}) {
    for (const double noise : {0.0, 0.1, 0.3}) {
      const Cloud cloud = noisy(s.kind, s.count, noise);
      fmt::print("| {}, {} | {} |", s.kind, s.count, noise);
      for (const Column& column : columns) {
        EstimateOptions options;
        if (column.smooth) options.smoothing = column.smoothing;
        options.normals.adaptive = column.adaptive;
        const SurfelCloud out = estimate_surfels(cloud.points, options);
        fmt::print(" {:.3f} / {:.2f} |", distance(out.position, cloud),
                   angles(out.normal, cloud.truth).mean);
      }
      fmt::print("\n");
      std::fflush(stdout);
    }
  }
}

Array<Vec3f> normals_of(const RangeImage& image, const NormalOptions& options) {
  const auto search = make_neighbor_search(image.points.position);
  return estimate_normals(image.points.position, *search, options).normal;
}

/// Percent of the normals that are more than 45 degrees off.
double flakes(const Array<Vec3f>& normal, const RangeImage& image) {
  return 100 * share_beyond(normal, image.normal, std::numbers::pi / 4);
}

void range_images() {
  fmt::print(
      "\n## Range images\n\nA room with a box, a ball and a column, 1.2 to 4.3 m away, as a depth "
      "camera of 640 x 480 pixels sees it: noise of 1.2 mm + 1.9 mm (z - 0.4 m)^2,\ndisparities "
      "in eighths of a pixel. Share of the normals that are more than 45 degrees off the true ones "
      "(smoothed over what the noise spans),\nand the mean angle of the last two columns in "
      "degrees. Columns by -k with --noise ignore; then the default, where no one knows\n"
      "where the camera stood (the file does not say, and it is not at the origin), and where it "
      "is known.\n\n| points | noise | disparities | -k 16 "
      "| -k 48 | -k 150 | -k auto | default | sensor known |\n"
      "|---|---|---|---|---|---|---|---|---|\n");
  struct Row {
    int step;
    double noise, disparity;
  };
  for (const Row& r : {Row{1, 1, 0.125}, Row{2, 1, 0.125}, Row{4, 1, 0.125}, Row{2, 1, 0},
                       Row{2, 0, 0.125}, Row{2, 0, 0}}) {
    DepthCamera camera;
    camera.step = r.step;
    camera.noise = r.noise;
    camera.lateral *= r.noise;
    camera.disparity = r.disparity;
    const RangeImage image = room_range_image(camera);
    fmt::print("| {} | {} | {} |", image.normal.size(), r.noise > 0 ? "yes" : "none",
               r.disparity > 0 ? "1/8 pixel" : "exact");
    for (const int k : {16, 48, 150, 0}) {
      NormalOptions options;
      options.grow_in_noise = false;
      options.adaptive = k == 0;
      if (k > 0) options.k = k;
      fmt::print(" {:.2f} % |", flakes(normals_of(image, options), image));
    }
    for (const bool known : {false, true}) {
      NormalOptions options;
      if (known) options.sensor = Vec3d(0, 0, 0);
      const Array<Vec3f> normal = normals_of(image, options);
      fmt::print(" {:.2f} %, {:.2f} |", flakes(normal, image), angles(normal, image.normal).mean);
    }
    fmt::print("\n");
    std::fflush(stdout);
  }
}

}  // namespace

int main() {
  accuracy();
  range_images();
  smoothing();
}
