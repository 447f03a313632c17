#pragma once

// Scans whose poses are known, for measuring how well they are found again.

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include <surfel/align/align_scans.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/transform.h>

#include "support/test_data.h"

namespace surfel::test {

/// A turn about the cloud's centre and a move, both in directions of chance.
inline Similarity perturbation(const SurfelCloud& cloud, double degrees, double distance,
                               std::uint64_t seed) {
  const auto direction = [&](std::uint64_t i) {
    Vec3d v;
    for (std::uint64_t c = 0; c < 3; ++c) v[c] = random_uniform(seed, i, c) - 0.5;
    return Vec3d(v.normalized());
  };
  const Bounds bounds = cloud.bounds();
  const Vec3d center = bounds.center();
  Similarity out;
  out.rotation = Eigen::AngleAxisd(degrees * std::numbers::pi / 180, direction(0));
  out.translation = center - out.rotation * center + distance * direction(1);
  return out;
}

struct PoseError {
  double degrees = 0;
  double distance = 0;  ///< Of the cloud's centre from its right place.
};

/// How far a pose that was found is from taking the perturbation back.
inline PoseError pose_error(const SurfelCloud& right, const Similarity& found,
                            const Similarity& perturbed) {
  const Bounds bounds = right.bounds();
  const Vec3d center = bounds.center();
  const auto apply = [](const Similarity& s, const Vec3d& p) -> Vec3d {
    return s.rotation * p + s.translation;
  };
  PoseError error;
  const Quaternion turn = (found.rotation * perturbed.rotation).normalized();
  error.degrees = Eigen::AngleAxisd(turn).angle() * 180 / std::numbers::pi;
  error.distance = (apply(found, apply(perturbed, center)) - center).norm();
  return error;
}

/// What scanners around a model would have seen of it: points whose normals look that way. No two
/// scans share a point, so that their noise and their pattern differ.
inline std::vector<SurfelCloud> scans_of(const SurfelCloud& model,
                                         const std::vector<Vec3f>& directions) {
  std::vector<Array<std::uint32_t>> points(directions.size());
  for (std::size_t i = 0; i < model.size(); ++i) {
    std::vector<std::size_t> seen;
    for (std::size_t k = 0; k < directions.size(); ++k) {
      if (model.normal[i].dot(directions[k].normalized()) > 0.2F) seen.push_back(k);
    }
    if (seen.empty()) continue;
    const auto pick =
        static_cast<std::size_t>(random_uniform(4, i, 0) * static_cast<double>(seen.size()));
    points[seen[pick]].push_back(static_cast<std::uint32_t>(i));
  }
  std::vector<SurfelCloud> scans;
  for (const Array<std::uint32_t>& of : points) scans.push_back(model.gathered(of));
  return scans;
}

inline std::vector<SurfelCloud> lion_scans() {
  const SurfelCloud lion = read_cloud(data_folder() / "colour_clouds/lion_takanawa_third.ply");
  return scans_of(lion, {{0, 0.3F, 1}, {1, 0.3F, 0}, {0, 0.3F, -1}, {-1, 0.3F, 0}});
}

/// A range scan of the bunny, after the vertices of the mesh that was made of it, in its frame, and
/// of nine more.
inline std::vector<SurfelCloud> bunny_scans() {
  std::vector<SurfelCloud> scans(2);
  scans[0].position = read_mesh(data_folder() / "meshes/stanford_bunny.obj").position;
  scans[1] = read_cloud(data_folder() / "raw_scans/bun000_range_grid.ply");
  return scans;
}

struct Perturbed {
  std::vector<SurfelCloud> scans;
  std::vector<Similarity> by;
};

/// Moves all scans but the first.
inline Perturbed perturbed(const std::vector<SurfelCloud>& right, double degrees, double distance) {
  Perturbed out{right, {Similarity{}}};
  for (std::size_t k = 1; k < right.size(); ++k) {
    out.by.push_back(perturbation(right[k], degrees, distance, k));
    transform_cloud(out.scans[k], out.by[k]);
  }
  return out;
}

}  // namespace surfel::test
