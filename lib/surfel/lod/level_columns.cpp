#include <cstddef>
#include <utility>

#include <surfel/base/parallel.h>
#include <surfel/lod/level_columns.h>
#include <surfel/scene/amplitude.h>

namespace surfel {
namespace {

constexpr std::size_t kColumnGrain = std::size_t{1} << 13;

}  // namespace

SurfelCloud level_columns(const SurfelCloud& cloud, const Array<std::uint32_t>& source) {
  SurfelCloud out = cloud.gathered(source);
  const std::size_t size = source.size();
  // The positions of merged surfels are no floats in the world.
  out.double_positions = out.double_positions || !out.origin.isZero();
  const bool round = !cloud.anisotropic();
  if (round) {
    out.tangent.resize(size);
    out.variance_u = out.variance;
    out.variance_v = std::move(out.variance);
  }
  out.variance = {};
  const bool without_area = cloud.area.empty();
  if (without_area) out.area.resize(size);
  out.level.assign(size, 0);
  parallel_each(size, kColumnGrain, [&](std::size_t i) {
    if (round) {
      const bool oriented = !out.normal.empty() && !out.normal[i].isZero();
      out.tangent[i] = oriented ? Vec3f(out.normal[i].unitOrthogonal()) : Vec3f::UnitX();
    }
    if (without_area) out.area[i] = root_of_determinant(cloud, source[i]);
  });
  return out;
}

}  // namespace surfel
