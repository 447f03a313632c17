#include <algorithm>
#include <string>

#include <surfel/base/parallel.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/point_estimates.h>

namespace surfel {
namespace {

constexpr std::size_t kEstimateGrain = 1 << 14;
/// Largest neighbourhoods of normals that are kept for the later stages: 256 bytes a point.
constexpr int kMostShared = 64;

/// Adds a property, in place of one of its name, and returns its values.
template <class T>
T* add_extra(SurfelCloud& cloud, const std::string& name, ScalarType type) {
  std::erase_if(cloud.extra, [&](const ExtraProperty& p) { return p.name == name; });
  ExtraProperty& property = cloud.extra.emplace_back(ExtraProperty{name, type, {}});
  property.data.resize(cloud.size() * sizeof(T));
  return reinterpret_cast<T*>(property.data.data());
}

/// Adds the columns of half-planes, the second ones where a surfel has two; none where none has
/// one.
void add_clips(const Array<std::uint32_t>& place, const Array<EdgeLines>& lines, SurfelCloud& out) {
  int most = 0;
  for (const EdgeLines& l : lines) most = std::max(most, l.count);
  const auto add = [&](std::size_t j, Array<Vec3f>& direction, Array<float>& distance) {
    direction.resize(out.size());
    distance.resize(out.size());
    parallel_each(out.size(), kEstimateGrain, [&](std::size_t i) {
      const EdgeLine& line = lines[place[i]].line[j];
      direction[i] = line.outward;
      distance[i] = line.distance;
    });
  };
  if (most > 0) add(0, out.clip1, out.clip1_distance);
  if (most > 1) add(1, out.clip2, out.clip2_distance);
}

}  // namespace

std::size_t shared_neighbors(const NormalOptions& normals) {
  const std::size_t least = std::max(kSplatNeighbors, kOrientationNeighbors + 1);
  if (normals.adaptive || normals.radius > 0) return least;
  return std::max(least, static_cast<std::size_t>(std::min(normals.k, kMostShared)));
}

std::size_t unusable_colors(const SurfelCloud& cloud) {
  return count_where(cloud.color.size(), [&](std::size_t i) {
    return cloud.position[i].allFinite() && !cloud.color[i].allFinite();
  });
}

std::uint64_t sum_of_confidences(const Array<float>& confidence) {
  std::uint64_t sum = 0;
  for (const float c : confidence) sum += static_cast<std::uint64_t>(c * 0x1p32F);
  return sum;
}

void set_estimates(const PointEstimates& estimates, const Array<std::uint32_t>& place,
                   SurfelCloud& out) {
  const std::size_t count = out.size();
  const bool ellipses = estimates.sizes.ellipses;
  out.normal.resize(count);
  out.shading_normal = {};     // A map bent normals that are estimated anew.
  out.clip1 = out.clip2 = {};  // Lines lay in planes that are estimated anew.
  out.clip1_distance = out.clip2_distance = {};
  out.area.resize(count);
  out.variance.resize(ellipses ? 0 : count);
  out.tangent.resize(ellipses ? count : 0);
  out.variance_u.resize(ellipses ? count : 0);
  out.variance_v.resize(ellipses ? count : 0);
  auto* curvature = add_extra<float>(out, "curvature", ScalarType::kFloat32);
  auto* confidence = add_extra<float>(out, "confidence", ScalarType::kFloat32);
  const bool sided = !estimates.side_confidence.empty();
  auto* side = sided ? add_extra<float>(out, "side_confidence", ScalarType::kFloat32) : nullptr;
  static_assert(sizeof(PointFlag) == 1);
  auto* flag = add_extra<PointFlag>(out, "flag", ScalarType::kUint8);
  parallel_each(count, kEstimateGrain, [&](std::size_t i) {
    const std::uint32_t from = place[i];
    const SplatSize& size = estimates.sizes.of[from];
    const NormalQuality& quality = estimates.normals.quality[from];
    out.normal[i] = estimates.normals.normal[from];
    out.area[i] = size.area;
    if (ellipses) {
      out.tangent[i] = size.tangent;
      out.variance_u[i] = size.variance_u;
      out.variance_v[i] = size.variance_v;
    } else {
      out.variance[i] = size.variance;
    }
    curvature[i] = quality.curvature;
    confidence[i] = quality.confidence;
    if (side) side[i] = estimates.side_confidence[from];
    flag[i] = quality.flag;
  });
  if (!estimates.lines.empty()) add_clips(place, estimates.lines, out);
}

}  // namespace surfel
