#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <tuple>
#include <unordered_map>
#include <vector>

#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel::test {

/// What brute force found of a sampling; distances in units of the spacing.
struct SheetReport {
  double least_distance = INFINITY;    ///< Between samples of one sheet that are not opposed.
  double furthest = 0;                 ///< Of a surface point from the nearest such sample.
  double furthest_agreeing_share = 0;  ///< Share of the surface further than 1 from all samples
                                       ///< that face within 90 degrees of it.
};

/// Checks a sampling independently of how it is made: the mesh is cut into tiny triangles, all
/// faces in the same barycentric grid; a point's sheet is what a flood over tiny triangles that
/// share an edge reaches without leaving a ball of 1.2 spacings.
class SheetCheck {
 public:
  SheetCheck(const TriangleMesh& mesh, int cuts, double spacing) : spacing_(spacing) {
    std::map<std::tuple<float, float, float>, std::uint32_t> first;
    const auto weld = [&](const Vec3f& p) {
      // Points of an edge come out alike up to rounding from both sides.
      const double grid = spacing * 1e-3;
      const auto snap = [grid](float x) { return static_cast<float>(std::round(x / grid)); };
      const auto key = std::tuple(snap(p.x()), snap(p.y()), snap(p.z()));
      return first.try_emplace(key, static_cast<std::uint32_t>(first.size())).first->second;
    };
    for (const auto& face : mesh.face) {
      const Vec3f a = mesh.position[face[0]];
      const Vec3f u = (mesh.position[face[1]] - a) / static_cast<float>(cuts);
      const Vec3f v = (mesh.position[face[2]] - a) / static_cast<float>(cuts);
      const Vec3f normal = u.cross(v).normalized();
      for (int i = 0; i < cuts; ++i) {
        for (int j = 0; i + j < cuts; ++j) {
          for (int flip = 0; flip <= (i + j + 1 < cuts); ++flip) {
            const auto at = [&](int di, int dj) {
              return Vec3f(a + static_cast<float>(i + di) * u + static_cast<float>(j + dj) * v);
            };
            const std::array<Vec3f, 3> p{flip ? at(1, 1) : at(0, 0), at(1, 0), at(0, 1)};
            tile_.push_back({(p[0] + p[1] + p[2]) / 3,
                             normal,
                             u.cross(v).norm() / 2,
                             {weld(p[0]), weld(p[1]), weld(p[2])}});
          }
        }
      }
    }
    for (std::uint32_t t = 0; t < tile_.size(); ++t) {
      for (int k = 0; k < 3; ++k) around_[edge(tile_[t], k)].push_back(t);
      cells_[cell(tile_[t].center)].push_back(t);
    }
  }

  SheetReport check(const SurfelCloud& cloud) const {
    std::vector<std::uint32_t> home(cloud.size());  // The tile that each sample lies on.
    std::unordered_map<std::uint32_t, std::vector<std::uint32_t>> on_tile;
    for (std::uint32_t s = 0; s < cloud.size(); ++s) {
      home[s] = nearest_tile(cloud.position[s], cloud.normal[s]);
      on_tile[home[s]].push_back(s);
    }
    SheetReport report;
    std::vector<double> distance(tile_.size(), INFINITY);
    std::vector<double> agreeing(tile_.size(), INFINITY);
    std::vector<std::uint32_t> seen(tile_.size(), UINT32_MAX);
    for (std::uint32_t s = 0; s < cloud.size(); ++s) {
      std::vector<std::uint32_t> flood{home[s]};
      seen[home[s]] = s;
      for (std::size_t i = 0; i < flood.size(); ++i) {
        const std::uint32_t t = flood[i];
        const double cosine = tile_[t].normal.dot(tile_[home[s]].normal);
        const double d = (tile_[t].center - cloud.position[s]).norm() / spacing_;
        if (cosine > -0.17) distance[t] = std::min(distance[t], d);
        if (cosine > 0) agreeing[t] = std::min(agreeing[t], d);
        if (const auto others = on_tile.find(t); others != on_tile.end() && cosine > -0.1) {
          for (const std::uint32_t other : others->second) {
            if (other == s) continue;
            const double apart = (cloud.position[other] - cloud.position[s]).norm() / spacing_;
            report.least_distance = std::min(report.least_distance, apart);
          }
        }
        for (int k = 0; k < 3; ++k) {
          for (const std::uint32_t next : around_.at(edge(tile_[t], k))) {
            if (seen[next] == s) continue;
            if ((tile_[next].center - cloud.position[s]).norm() > 1.2 * spacing_) continue;
            seen[next] = s;
            flood.push_back(next);
          }
        }
      }
    }
    double area = 0;
    for (std::size_t t = 0; t < tile_.size(); ++t) {
      report.furthest = std::max(report.furthest, distance[t]);
      report.furthest_agreeing_share += agreeing[t] > 1 ? tile_[t].area : 0;
      area += tile_[t].area;
    }
    report.furthest_agreeing_share /= area;
    return report;
  }

 private:
  struct Tile {
    Vec3f center;
    Vec3f normal;
    float area;
    std::array<std::uint32_t, 3> corner;
  };
  using Cell = std::tuple<int, int, int>;

  static std::uint64_t edge(const Tile& tile, int k) {
    const std::uint64_t a = tile.corner[k];
    const std::uint64_t b = tile.corner[(k + 1) % 3];
    return std::min(a, b) << 32 | std::max(a, b);
  }

  Cell cell(const Vec3f& p) const {
    const Vec3d c = p.cast<double>() / (0.5 * spacing_);
    return {static_cast<int>(std::floor(c.x())), static_cast<int>(std::floor(c.y())),
            static_cast<int>(std::floor(c.z()))};
  }

  /// The tile that a sample lies on; where several faces meet in a point, one that faces its way.
  std::uint32_t nearest_tile(const Vec3f& p, const Vec3f& normal) const {
    std::uint32_t best = 0;
    float best2 = INFINITY;
    const auto [x, y, z] = cell(p);
    for (int k = 0; k < 27; ++k) {
      const auto found = cells_.find({x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1});
      if (found == cells_.end()) continue;
      for (const std::uint32_t t : found->second) {
        // The plane's distance counts more: sheets may be closer than centres of tiles.
        const Vec3f to_p = p - tile_[t].center;
        const float height = 30 * to_p.dot(tile_[t].normal);
        const float turned = 1 - normal.dot(tile_[t].normal);
        const float d2 =
            to_p.squaredNorm() + height * height + turned * static_cast<float>(spacing_ * spacing_);
        if (d2 < best2) {
          best2 = d2;
          best = t;
        }
      }
    }
    return best;
  }

  double spacing_;
  std::vector<Tile> tile_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> around_;  ///< Tiles at each edge.
  std::map<Cell, std::vector<std::uint32_t>> cells_;
};

}  // namespace surfel::test
