#include <surfel/base/parallel.h>
#include <surfel/simplify/shown_surface.h>

namespace surfel {
namespace {

constexpr std::size_t kShownGrain = 1 << 12;

}  // namespace

Channels shown_color(const SurfelCloud& cloud, std::size_t surfel) {
  const Array<Vec3f>* color = cloud.render_color();
  Channels c;
  c << (color ? (*color)[surfel] : SurfelCloud::colorless()).cast<double>().array(),
      cloud.alpha.empty() ? 1.0 : static_cast<double>(cloud.alpha[surfel]);
  return c;
}

ShownSurface shown_surface(const SurfelCloud& places, const SurfelBasis& basis,
                           const Array<Channels>& w, const EvaluatedBasis& evaluated,
                           const Array<std::uint32_t>& place) {
  ShownSurface out;
  out.color.resize(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) out.color[i] = shown_color(places, i);
  out.normal = places.normal;
  out.height.assign(places.size(), 0.0F);
  out.coverage.assign(places.size(), 0.0F);
  const SparseMatrix& A = evaluated.A;
  parallel_each(place.size(), kShownGrain, [&](std::size_t q) {
    if (A.row_begin[q] == A.row_begin[q + 1]) return;
    const std::uint32_t i = place[q];
    const Vec3d position = places.position[i].cast<double>();
    Channels color = Channels::Zero();
    Vec3d normal = Vec3d::Zero();
    double height = 0;
    for (std::size_t e = A.row_begin[q]; e < A.row_begin[q + 1]; ++e) {
      const SurfelBasis::Function& f = basis.function[A.column[e]];
      color += A.value[e] * w[A.column[e]];
      normal += A.value[e] * f.normal;
      // Distance from the place to the function's plane along the function's normal, which hardly
      // differs from the surface's.
      height += A.value[e] * f.normal.dot(f.position - position);
    }
    out.color[i] = color;
    const double length = normal.norm();
    if (length > 0) out.normal[i] = (normal / length).cast<float>();
    out.height[i] = static_cast<float>(height);
    out.coverage[i] = evaluated.coverage[q];
  });
  return out;
}

}  // namespace surfel
