// Points that are coincident, on a line, alone, not finite, few, or of uneven density.

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include <surfel/estimate/estimate.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/surface/neighbor_search.h>

#include "stability/views.h"

namespace surfel::test {
namespace {

constexpr std::size_t kNeighbors = 16;

/// Hoppe et al. 1992 and SS01 section 5 as they are: the normal of the covariance's smallest
/// eigenvalue, V = h^2 I with h the maximum distance in the neighbourhood; in single precision, and
/// without looking at what comes. Signs are given by the truth, outwards.
SurfelCloud estimate_as_published(const SurfelCloud& points) {
  SurfelCloud cloud = points;
  // No search defines an order for what is not a number; such a point has no neighbourhood.
  Array<Vec3f> finite;
  for (const Vec3f& p : points.position) {
    if (p.allFinite()) finite.push_back(p);
  }
  const auto search = make_neighbor_search(finite);
  std::vector<Neighbor> neighbors;
  for (const Vec3f& p : points.position) {
    neighbors.clear();
    if (p.allFinite()) search->nearest(p, kNeighbors, neighbors);
    Vec3f mean = Vec3f::Zero();
    for (const Neighbor& n : neighbors) mean += finite[n.index];
    mean /= static_cast<float>(neighbors.size());
    Eigen::Matrix3f covariance = Eigen::Matrix3f::Zero();
    for (const Neighbor& n : neighbors) {
      const Vec3f d = finite[n.index] - mean;
      covariance += d * d.transpose();
    }
    Vec3f normal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f>(covariance).eigenvectors().col(0);
    if (normal.dot(p) < 0) normal = -normal;
    cloud.normal.push_back(normal);
    const float h2 = neighbors.empty() ? 0 : neighbors.back().distance2;
    cloud.variance.push_back(h2);
    cloud.area.push_back(h2);
  }
  return cloud;
}

/// What `surfel-estimate --orient outward` makes of them.
SurfelCloud estimate_as_ours(const SurfelCloud& points) {
  EstimateOptions options;
  options.orientation.method = Orientation::kOutward;
  return estimate_surfels(points, options);
}

/// The points of a case that lie on the unit sphere, each once, with their true normals and a
/// variance that closes the surface.
SurfelCloud true_sphere(const SurfelCloud& points) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < std::min<std::size_t>(points.size(), 3000); ++i) {
    const Vec3f& p = points.position[i];
    if (!p.allFinite() || std::abs(p.norm() - 1) > 1e-4F) continue;
    cloud.position.push_back(p);
    cloud.normal.push_back(p);
    cloud.color.push_back(points.color[i]);
    cloud.area.push_back(static_cast<float>(4 * M_PI / 3000));
    cloud.variance.push_back(cloud.area.back());
  }
  return cloud;
}

/// Root mean square error within the sphere's silhouette, its rim left out.
double sphere_error(const SurfelCloud& cloud, const Image& truth, const Camera& camera) {
  const Image image = draw(cloud, camera);
  const double radius = 0.9 * camera.focal_x * std::tan(std::asin(1 / camera.eye.norm()));
  return rms(image, truth, [&](int x, int y) {
    return std::hypot(x + 0.5 - camera.center_x, y + 0.5 - camera.center_y) < radius;
  });
}

Place bad_points(Effort effort) {
  Place place{.title = "Coincident, collinear, isolated, NaN points",
              .measure = "RMS error of colour and alpha over the sphere that the others lie on",
              .slack = 1e-3,
              .published =
                  "covariance of 16 points, V = h^2 I with h their largest distance "
                  "(Hoppe et al. 1992, SS01 section 5)",
              .ours = "`surfel-estimate --orient outward`",
              .why =
                  "neighbourhoods that span no plane are flagged and looked at again with more "
                  "points; sizes follow cells, not the farthest neighbour"};
  for (const char* name : {"coincident", "collinear", "isolated", "not-finite"}) {
    const HardScene scene = make_hard_case(name);
    const Camera camera = case_camera(scene.view, effort);
    const Image truth = draw(true_sphere(scene.cloud), camera);
    place.rows.push_back({name, sphere_error(estimate_as_published(scene.cloud), truth, camera),
                          sphere_error(estimate_as_ours(scene.cloud), truth, camera), 0.03});
  }
  return place;
}

/// Share of the points that no splat stands for.
double unseen(const SurfelCloud& surfels, std::size_t points) {
  std::size_t usable = 0;
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    usable += surfels.position[i].allFinite() && surfels.normal[i].allFinite() &&
                      surfels.variance[i] > 0 && std::isfinite(surfels.variance[i])
                  ? 1
                  : 0;
  }
  return 1 - static_cast<double>(usable) / static_cast<double>(points);
}

Place few_points(Effort) {
  Place place{.title = "Fewer points than neighbours",
              .measure = "share of the points that have no splat",
              .published = "the same",
              .ours = "`surfel-estimate`",
              .why =
                  "what has no normal faces the eye; one point alone has no size, "
                  "in neither"};
  for (const double count : {1, 2, 3, 5}) {
    const HardScene scene = make_hard_case(named("few-points", count));
    const auto points = static_cast<std::size_t>(count);
    place.rows.push_back(
        {named("few-points", count), unseen(estimate_as_published(scene.cloud), points),
         unseen(estimate_surfels(scene.cloud, {}), points), count == 1 ? 1.0 : 0.0});
  }
  return place;
}

/// With one h for all, that of the mean density.
SurfelCloud with_global_size(const SurfelCloud& points, double total_area) {
  SurfelCloud cloud = points;
  const auto h2 = static_cast<float>(total_area / static_cast<double>(points.size()));
  cloud.normal.assign(points.size(), Vec3f(0, 0, 1));
  cloud.variance.assign(points.size(), h2);
  cloud.area.assign(points.size(), h2);
  return cloud;
}

Place density_holes(Effort effort) {
  Place place{.title = "Density jump: holes",
              .measure = "share of the pixels that let half of what is behind through",
              .published = "SS01 section 5: one h for all, of the mean density",
              .ours = "`surfel-estimate`",
              .why = "each disc covers its own Voronoi cell"};
  for (const double ratio : {4.0, 100.0}) {
    const HardScene scene = make_hard_case(named("density", ratio));
    const Camera camera = case_camera(scene.view, effort);  // Sees no border.
    const auto share = [&](const SurfelCloud& cloud) {
      const Image image = draw(cloud, camera);
      int holes = 0;
      for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) holes += image.pixel(x, y)[3] < 0.5F ? 1 : 0;
      }
      return static_cast<double>(holes) / (image.width * image.height);
    };
    place.rows.push_back({named("density", ratio), share(with_global_size(scene.cloud, 2)),
                          share(estimate_surfels(scene.cloud, {})), 0.002});
  }
  return place;
}

Place density_overlap(Effort effort) {
  Place place{.title = "Density jump: overlap",
              .measure = "mean number of discs over a point of the surface",
              .slack = 0.1,
              .published = "SS01 section 5: h the largest distance, `--variance max-distance`",
              .ours = "`surfel-estimate`",
              .why =
                  "the largest of six distances reaches across several cells, and far across the "
                  "jump; every disc over a point costs time and blurs"};
  for (const double ratio : {4.0, 100.0}) {
    if (effort == Effort::kTest && ratio != 4) continue;
    const HardScene scene = make_hard_case(named("density", ratio));
    EstimateOptions largest;
    largest.size.rule = VarianceRule::kMaxDistance;
    const auto overlap = [](const SurfelCloud& cloud) {
      return cloud_statistics(cloud).coverage.value_or(Coverage{.overlap = 1e9}).overlap;
    };
    place.rows.push_back({named("density", ratio), overlap(estimate_surfels(scene.cloud, largest)),
                          overlap(estimate_surfels(scene.cloud, {})), 3});
  }
  return place;
}

}  // namespace

std::vector<Measurement> point_places() {
  return {{"BadPoints", one<bad_points>},
          {"FewPoints", one<few_points>},
          {"DensityHoles", one<density_holes>},
          {"DensityOverlap", one<density_overlap>}};
}

}  // namespace surfel::test
