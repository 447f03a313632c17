#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include <surfel/base/group_by_key.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/scene/clips.h>
#include <surfel/simplify/edges.h>
#include <surfel/simplify/sheet_clusters.h>

namespace surfel {
namespace {

constexpr std::size_t kEdgeGrain = 1 << 10;
/// Half the length of the piece of its line that a surfel tells of, by the root of its area:
/// surfels along an edge are about that far from each other.
constexpr float kHalfWall = 1;
/// Pieces of lines around a seed that are told apart; where there are more a cluster grows no
/// further, so that its growth takes linear time.
constexpr std::size_t kMostWalls = 64;
/// Surfels among which an image's original is looked for: there are two sides of a crease, each of
/// which may have copies.
constexpr std::size_t kOriginals = 8;
/// Least cosine between the normals of a surfel and its image.
constexpr float kImageCosine = 0.99F;

/// Where an image's original lies.
Vec3f place_of_original(CutSurfel image) {
  // The image in both lines was mirrored in the first one last.
  for (std::size_t k = 0; k < image.cut.size(); ++k) {
    if (image.cut[k].distance < 0) image = mirror_image(image, k);
  }
  return image.position.cast<float>();
}

/// Deviation of a surfel's Gaussian along a direction in its plane.
double deviation_along(const SurfelCloud& cloud, std::size_t i, const Vec3d& direction) {
  if (!cloud.anisotropic()) return std::sqrt(cloud.variance[i]);
  const double along = direction.dot(cloud.tangent[i].cast<double>());
  return std::sqrt(cloud.variance_u[i] * along * along +
                   cloud.variance_v[i] * std::max(0.0, 1 - along * along));
}

float largest_deviation(const SurfelCloud& cloud, std::size_t i) {
  return std::sqrt(cloud.anisotropic() ? std::max(cloud.variance_u[i], cloud.variance_v[i])
                                       : cloud.variance[i]);
}

}  // namespace

CloudEdges find_edges(const SurfelCloud& cloud, SurfelCloud images) {
  CloudEdges edges;
  edges.surfel.resize(cloud.size());
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    edges.surfel[i] = lined_surfel(cloud, i);
    if (!edges.surfel[i].is_cut()) continue;
    edges.clipped.push_back(i);
    edges.place.push_back(cloud.position[i]);
  }
  if (edges.clipped.empty()) return {};
  edges.search = make_neighbor_search(edges.place);
  edges.images = std::move(images);
  edges.image_of.resize(edges.images.size());
  PerWorker<std::vector<Neighbor>> scratch;
  parallel_for(edges.images.size(), kEdgeGrain, [&](std::size_t begin, std::size_t end, int w) {
    std::vector<Neighbor>& near = scratch[w];
    for (std::size_t i = begin; i < end; ++i) {
      edges.search->nearest(place_of_original(cut_surfel(edges.images, i)), kOriginals, near);
      const auto alike = std::find_if(near.begin(), near.end(), [&](const Neighbor& n) {
        return cloud.normal[edges.clipped[n.index]].dot(edges.images.normal[i]) > kImageCosine;
      });
      edges.image_of[i] = edges.clipped[(alike == near.end() ? near.front() : *alike).index];
    }
  });
  return edges;
}

void ClusterEdges::start(std::span<const LinedSurfel> surfels, std::uint32_t seed,
                         const Vec3f& normal) {
  seed_normal_ = normal;
  surfels_ = surfels;
  seed_ = surfels[seed].position;
  members_.clear();
  lines_.clear();
  walls_.clear();
  add_member(seed);
}

bool ClusterEdges::separates(const Wall& wall, const Vec3f& place) const {
  const float a = wall.line.inside(seed_);
  const float b = wall.line.inside(place);
  // Places on the line belong to both sides.
  const float least = 1e-3F * (wall.last - wall.first);
  if (!(std::min(a, b) < -least && std::max(a, b) > least)) return false;
  const Vec3f crossing = seed_ + (place - seed_) * (a / (a - b));
  const float along = wall.along.dot(crossing - wall.middle);
  return along >= wall.first && along <= wall.last;
}

/// Whether all members may end at a further line.
bool ClusterEdges::fits(const CutLine& line) const {
  return lines_.size() < 2 && std::none_of(members_.begin(), members_.end(), [&](std::uint32_t i) {
           return goes_on_beyond(surfels_[i], line);
         });
}

bool ClusterEdges::admits(std::uint32_t i) const {
  const LinedSurfel& s = surfels_[i];
  if (walls_.size() >= kMostWalls) return false;
  if (std::any_of(lines_.begin(), lines_.end(),
                  [&](const CutLine& line) { return goes_on_beyond(s, line); }) ||
      std::any_of(walls_.begin(), walls_.end(),
                  [&](const Wall& wall) { return separates(wall, s.position); })) {
    return false;
  }
  std::size_t further = 0;
  for (const CutLine& line : s.lines) {
    const auto known = [&](const CutLine& other) { return is_on_line(s, line, other); };
    if (!line.cuts() || std::any_of(lines_.begin(), lines_.end(), known)) continue;
    if (!fits(line) || lines_.size() + ++further > 2) return false;
  }
  return true;
}

void ClusterEdges::add_member(std::uint32_t i) {
  members_.push_back(i);
  const LinedSurfel& s = surfels_[i];
  for (const CutLine& line : s.lines) {
    const auto known = [&](const CutLine& other) { return is_on_line(s, line, other); };
    if (line.cuts() && std::none_of(lines_.begin(), lines_.end(), known)) lines_.push_back(line);
  }
}

void ClusterEdges::add_wall(std::uint32_t i) {
  const LinedSurfel& s = surfels_[i];
  const float half = kHalfWall * std::sqrt(s.area);
  for (const CutLine& line : s.lines) {
    if (!line.cuts()) continue;
    const Vec3f foot = s.position + line.inside(s.position) * line.direction;
    const auto extended = [&](Wall& wall) {
      const float along = wall.along.dot(foot - wall.middle);
      if (along - half > wall.last || along + half < wall.first || !is_on_line(s, line, wall.line))
        return false;
      wall.first = std::min(wall.first, along - half);
      wall.last = std::max(wall.last, along + half);
      return true;
    };
    if (walls_.size() >= kMostWalls || std::any_of(walls_.begin(), walls_.end(), extended)) {
      continue;
    }
    // The cluster's sheet is nearly a plane, in which the line runs.
    const Vec3f along = seed_normal_.cross(line.direction).normalized();
    walls_.push_back({line, foot, along, -half, half});
  }
}

void end_at_lines(const CloudEdges& edges, const SurfelCloud& cloud, const SheetClusters& clusters,
                  const SheetRules& sheets, SurfelCloud& merged) {
  if (edges.empty()) return;
  const float least_cosine = sheets.least_cosine();
  struct Worker {
    std::vector<Neighbor> near;
    std::vector<const LinedSurfel*> members;
    std::vector<const LinedSurfel*> beside;
  };
  PerWorker<Worker> workers;
  parallel_for(clusters.size(), kEdgeGrain, [&](std::size_t begin, std::size_t end, int w) {
    auto& [near, members, beside] = workers[w];
    for (std::size_t k = begin; k < end; ++k) {
      if (clusters.members(k).size() == 1) continue;
      members.clear();
      beside.clear();
      for (const std::uint32_t i : clusters.members(k)) members.push_back(&edges.surfel[i]);
      const MergeSurfel s = merge_surfel(merged, static_cast<std::uint32_t>(k));
      edges.search->within(s.position,
                           static_cast<float>(kClipReach) * largest_deviation(merged, k),
                           edges.place.size(), near);
      for (const Neighbor& neighbor : near) {
        const std::uint32_t i = edges.clipped[neighbor.index];
        if (cloud.normal[i].dot(s.normal) >= least_cosine) beside.push_back(&edges.surfel[i]);
      }
      write_lines(merged, k, merged_lines({s.position, s.normal, s.covariance}, members, beside));
    }
  });
}

Array<std::uint32_t> add_images(const CloudEdges& edges, const SheetClusters& clusters,
                                SurfelCloud& merged) {
  const std::size_t count = clusters.size();
  Array<std::uint32_t> of;
  if (edges.images.empty()) return of;
  const Grouped<std::uint32_t> images =
      group_by_key<std::uint32_t>(edges.surfel.size(), [&](const auto& add) {
        for (std::uint32_t i = 0; i < edges.image_of.size(); ++i) add(edges.image_of[i], i);
      });
  std::vector<CutSurfel> added;
  for (std::uint32_t k = 0; k < count; ++k) {
    const std::span<const std::uint32_t> members = clusters.members(k);
    if (members.size() == 1) {
      const std::uint32_t i = members[0];
      for (std::uint64_t e = images.begin[i]; e < images.begin[i + 1]; ++e) {
        added.push_back(cut_surfel(edges.images, images.item[e]));
      }
    } else if (std::any_of(members.begin(), members.end(), [&](std::uint32_t i) {
                 return images.begin[i] < images.begin[i + 1];
               })) {
      const CutSurfel s = cut_surfel(merged, k);
      const std::vector<CutSurfel> own =
          mirror_images(s, {deviation_along(merged, k, s.cut[0].direction),
                            deviation_along(merged, k, s.cut[1].direction)});
      added.insert(added.end(), own.begin(), own.end());
    }
    of.resize(added.size(), k);
  }
  Array<std::uint32_t> order(count + of.size());
  std::iota(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), 0U);
  std::copy(of.begin(), of.end(), order.begin() + static_cast<std::ptrdiff_t>(count));
  merged = merged.gathered(order);
  for (std::size_t j = 0; j < added.size(); ++j) put_cut_surfel(added[j], merged, count + j);
  return of;
}

}  // namespace surfel
