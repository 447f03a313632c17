#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <tuple>

#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/scene/surface_sample.h>

namespace surfel {
namespace {

constexpr std::size_t kSampleGrain = 1 << 16;

/// One round of SplitMix64's mixing over the coordinates' bits: the choice needs no better
/// randomness, and millions of points are hashed for a picture.
std::uint64_t hash_of(const Vec3f& p) {
  std::uint64_t z = std::bit_cast<std::uint32_t>(p.x());
  z = z * 0x9e3779b97f4a7c15ULL + std::bit_cast<std::uint32_t>(p.y());
  z = z * 0xbf58476d1ce4e5b9ULL + std::bit_cast<std::uint32_t>(p.z());
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

}  // namespace

SurfaceSampler::SurfaceSampler(std::size_t total)
    : threshold_(total <= kPoints ? std::numeric_limits<std::uint64_t>::max()
                                  : std::numeric_limits<std::uint64_t>::max() / total * kPoints) {}

void SurfaceSampler::add(const SurfaceSample::Point& point) {
  if (!point.position.allFinite() || hash_of(point.position) > threshold_) return;
  chosen_.push_back({point.position, point.normal.allFinite() ? point.normal : Vec3f(0, 0, 0),
                     std::isfinite(point.area) && point.area > 0 ? point.area : 0});
}

void SurfaceSampler::add(const SurfaceSampler& other) {
  chosen_.insert(chosen_.end(), other.chosen_.begin(), other.chosen_.end());
}

SurfaceSample SurfaceSampler::sample(const Vec3d& origin) const {
  SurfaceSample out{origin, chosen_};
  const auto key = [](const SurfaceSample::Point& p) {
    return std::tuple(p.position.x(), p.position.y(), p.position.z(), p.normal.x(), p.normal.y(),
                      p.normal.z(), p.area);
  };
  std::sort(out.points.begin(), out.points.end(),
            [&](const auto& a, const auto& b) { return key(a) < key(b); });
  const bool no_area = std::all_of(out.points.begin(), out.points.end(),
                                   [](const SurfaceSample::Point& p) { return !(p.area > 0); });
  if (no_area) {
    for (SurfaceSample::Point& point : out.points) point.area = 1;
  }
  return out;
}

SurfaceSample sample_surface(std::size_t count, std::size_t total, const Vec3d& origin,
                             FunctionRef<SurfaceSample::Point(std::size_t)> point) {
  PerWorker<SurfaceSampler> parts([total] { return std::make_unique<SurfaceSampler>(total); });
  parallel_for(count, kSampleGrain, [&](std::size_t begin, std::size_t end, int worker) {
    SurfaceSampler& part = parts[worker];
    for (std::size_t i = begin; i < end; ++i) part.add(point(i));
  });
  SurfaceSampler all(total);
  parts.for_each([&](const SurfaceSampler& part) { all.add(part); });
  return all.sample(origin);
}

SurfaceSample sample_surface(const SurfelCloud& cloud) {
  return sample_surface(
      cloud.size(), cloud.size(), cloud.origin, [&](std::size_t i) -> SurfaceSample::Point {
        return {cloud.position[i], cloud.normal.empty() ? Vec3f(0, 0, 0) : cloud.normal[i],
                cloud.area.empty() ? 1 : cloud.area[i]};
      });
}

SurfaceSample sample_surface(const TriangleMesh& mesh) {
  const auto cross = [&](const std::array<std::uint32_t, 3>& face) -> Vec3d {
    const Vec3d a = mesh.position[face[0]].cast<double>();
    const Vec3d b = mesh.position[face[1]].cast<double>();
    const Vec3d c = mesh.position[face[2]].cast<double>();
    return (b - a).cross(c - a);
  };
  // Points of faces, the areas' sum over their number: those are as many as wanted, and all stay.
  double area = 0;
  for (const auto& face : mesh.face) {
    const double twice = cross(face).norm();
    if (std::isfinite(twice)) area += twice / 2;
  }
  SurfaceSampler sampler(0);
  if (!(area > 0)) return sampler.sample(mesh.origin);
  const double share = area / static_cast<double>(SurfaceSampler::kPoints);
  for (const auto& face : mesh.face) {
    const Vec3d normal = cross(face);
    const double wanted = normal.norm() / 2 / share;
    if (!(wanted > 0) || !std::isfinite(wanted)) continue;
    const Vec3f& a = mesh.position[face[0]];
    const Vec3f& b = mesh.position[face[1]];
    const Vec3f& c = mesh.position[face[2]];
    const std::uint64_t seed = hash_of((a + b + c) / 3);
    const auto whole = static_cast<std::uint64_t>(wanted);
    const bool one_more = random_uniform(seed, 0) < wanted - static_cast<double>(whole);
    const std::uint64_t count = whole + (one_more ? 1 : 0);
    for (std::uint64_t i = 0; i < count; ++i) {
      const double root = std::sqrt(random_uniform(seed, i + 1, 0));
      const double along = random_uniform(seed, i + 1, 1);
      const auto u = static_cast<float>(1 - root);
      const auto v = static_cast<float>(along * root);
      sampler.add({u * a + v * b + (1 - u - v) * c, normal.normalized().cast<float>(),
                   static_cast<float>(share)});
    }
  }
  return sampler.sample(mesh.origin);
}

}  // namespace surfel
