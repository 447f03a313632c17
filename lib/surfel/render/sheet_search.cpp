// See sheet_search.h.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include <surfel/render/sheet_search.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/sheet_search.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/lane_sums-inl.h>
#include <surfel/base/vec3-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Finds surfels that lie on one smooth surface: a surface of second degree is fitted to them, from
/// which surfels that are far off are left out, again and again.
class SheetSearch {
 public:
  /// \param open  1: the surfel may be in a sheet; else 0. Gets 0 where a sheet has been found.
  SheetSearch(const SurfelColumns& surfels, float* open, std::vector<SurfaceSheet>& found)
      : in_(surfels), open_(open), found_(found) {}

  /// Finds sheets among the open surfels of [begin, end); `begin` is a multiple of 16. Surfels that
  /// are left are tried again, all together or, as they follow one another in space, halves of
  /// them, which are nearer to a plane.
  void search(std::size_t begin, std::size_t end, int round = 0) {
    if (found_.size() == kMostSheets) return;
    begin_ = begin;
    end_ = end;
    const Outcome outcome = find();
    if (outcome == Outcome::kTooFew || round == kMostRounds) return;
    if (outcome == Outcome::kFound) {
      search(begin, end, round + 1);
      return;
    }
    const std::size_t middle = begin + (end - begin) / 32 * 16;
    if (middle == begin) return;
    search(begin, middle, round + 1);
    search(middle, end, round + 1);
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  using Vec3 = HWY_NAMESPACE::Vec3<V>;
  using Sum = LaneSums<D, 16>;
  static constexpr std::size_t kLanes = hn::MaxLanes(D());
  static constexpr std::size_t kSize = kSetupSurfels + 16;

  /// Fewer surfels are not worth a sheet.
  static constexpr float kLeastSurfels = 24;
  /// The least cosine of normals to their mean, and the least length of that.
  static constexpr float kLeastCosine = 0.5F;
  /// SurfaceSheet::off of the surfels that each fit leaves, at most. The last bound is what
  /// may_sum_up() allows at any angle, at cutoff 1.
  static constexpr float kMostOff[] = {1, 0.35F, 0.12F};
  /// The square around a sheet is at most so many times as large as its surfels together: of a
  /// sheet of surfels far apart most pixels would be empty.
  static constexpr float kMostSpread = 14;
  static constexpr int kMostRounds = 4;

  enum class Outcome : std::uint8_t { kFound, kNone, kTooFew };

  /// A surface of second degree over the plane of the frame, at offsets from the mean place.
  struct Surface {
    float u, v;              ///< The mean place.
    float height;            ///< The height there ...
    float slope_u, slope_v;  ///< ... the slope ...
    float uu, uv, vu, vv;    ///< ... and how much each of its parts changes along u and v.
  };

  /// Calls body(i, open surfels' lanes as 1) for vectors of the range.
  template <class Body>
  HWY_INLINE void for_each_vector(const Body& body) const {
    const D d;
    for (std::size_t i = begin_; i < end_; i += kLanes) {
      body(i, hn::IfThenElseZero(hn::FirstN(d, end_ - i), hn::Load(d, open_ + i)));
    }
  }

  Outcome find() {
    const Outcome outcome = make_frame();
    if (outcome != Outcome::kFound) return outcome;
    for (const float most_off : kMostOff) {
      const float count = fit();
      if (count < kLeastSurfels) return Outcome::kNone;
      select(most_off);
    }
    return keep();
  }

  /// Finds the mean place and normal, and the places, heights and slopes of surfels whose normals
  /// are near to that.
  Outcome make_frame() {
    const D d;
    Sum n, sum_x, sum_y, sum_z, sum_nx, sum_ny, sum_nz;
    for_each_vector([&](std::size_t i, V is) HWY_ATTR {
      const auto add = [&](Sum& sum, const float* column)
                           HWY_ATTR { sum.add(i, hn::Mul(is, hn::LoadU(d, column + i))); };
      n.add(i, is);
      add(sum_x, in_.x);
      add(sum_y, in_.y);
      add(sum_z, in_.z);
      add(sum_nx, in_.normal_x);
      add(sum_ny, in_.normal_y);
      add(sum_nz, in_.normal_z);
    });
    if (n.total() < kLeastSurfels) return Outcome::kTooFew;
    const float each = 1 / n.total();
    const float x = sum_nx.total() * each;
    const float y = sum_ny.total() * each;
    const float z = sum_nz.total() * each;
    const float length = std::sqrt(x * x + y * y + z * z);
    if (!(length > kLeastCosine)) return Outcome::kNone;
    frame_ = Frame({sum_x.total() * each, sum_y.total() * each, sum_z.total() * each},
                   {x / length, y / length, z / length});
    const auto vector = [&](const float(&v)[3]) HWY_ATTR {
      return Vec3{hn::Set(d, v[0]), hn::Set(d, v[1]), hn::Set(d, v[2])};
    };
    const Vec3 origin = vector(frame_.origin);
    const Vec3 along_u = vector(frame_.u);
    const Vec3 along_v = vector(frame_.v);
    const Vec3 axis = vector(frame_.axis);
    for_each_vector([&](std::size_t i, V open) HWY_ATTR {
      const auto load = [&](const float* by_x, const float* by_y, const float* by_z) HWY_ATTR {
        return Vec3{hn::LoadU(d, by_x + i), hn::LoadU(d, by_y + i), hn::LoadU(d, by_z + i)};
      };
      const Vec3 normal = load(in_.normal_x, in_.normal_y, in_.normal_z);
      Vec3 place = load(in_.x, in_.y, in_.z);
      place = {hn::Sub(place.x, origin.x), hn::Sub(place.y, origin.y), hn::Sub(place.z, origin.z)};
      const V cosine = dot(normal, axis);
      const M is_near = hn::Gt(cosine, hn::Set(d, kLeastCosine));
      const V scale = hn::Div(hn::Set(d, -1.0F), hn::IfThenElse(is_near, cosine, hn::Set(d, 1.0F)));
      hn::Store(dot(place, along_u), d, u_ + i);
      hn::Store(dot(place, along_v), d, v_ + i);
      hn::Store(dot(place, axis), d, height_ + i);
      hn::Store(hn::Mul(scale, dot(normal, along_u)), d, slope_u_ + i);
      hn::Store(hn::Mul(scale, dot(normal, along_v)), d, slope_v_ + i);
      hn::Store(cosine, d, cosine_ + i);
      const V is = hn::IfThenElseZero(is_near, open);
      hn::Store(is, d, near_ + i);
      hn::Store(is, d, member_ + i);
    });
    return Outcome::kFound;
  }

  /// Fits the surface to the members: the slope as an affine function of the place, by least
  /// squares, and the surface of second degree that has it, through the mean height. Returns the
  /// number of members.
  float fit() {
    const D d;
    Sum count, sum_u, sum_v, sum_h, sum_a, sum_b;
    for_each_vector([&](std::size_t i, V) HWY_ATTR {
      const V is = hn::Load(d, member_ + i);
      const auto add = [&](Sum& sum, const float* values)
                           HWY_ATTR { sum.add(i, hn::Mul(is, hn::Load(d, values + i))); };
      count.add(i, is);
      add(sum_u, u_);
      add(sum_v, v_);
      add(sum_h, height_);
      add(sum_a, slope_u_);
      add(sum_b, slope_v_);
    });
    const float members = count.total();
    if (!(members > 0)) return 0;
    const float each = 1 / members;
    surface_.u = sum_u.total() * each;
    surface_.v = sum_v.total() * each;
    Sum uu, uv, vv, ua, va, ub, vb;
    for_each_vector([&](std::size_t i, V) HWY_ATTR {
      const V is = hn::Load(d, member_ + i);
      const V u = hn::Sub(hn::Load(d, u_ + i), hn::Set(d, surface_.u));
      const V v = hn::Sub(hn::Load(d, v_ + i), hn::Set(d, surface_.v));
      const V own_u = hn::Mul(is, u);
      const V own_v = hn::Mul(is, v);
      const V a = hn::Load(d, slope_u_ + i);
      const V b = hn::Load(d, slope_v_ + i);
      uu.add(i, hn::Mul(own_u, u));
      uv.add(i, hn::Mul(own_u, v));
      vv.add(i, hn::Mul(own_v, v));
      ua.add(i, hn::Mul(own_u, a));
      va.add(i, hn::Mul(own_v, a));
      ub.add(i, hn::Mul(own_u, b));
      vb.add(i, hn::Mul(own_v, b));
    });
    const float of_uu = uu.total();
    const float of_uv = uv.total();
    const float of_vv = vv.total();
    const float determinant = of_uu * of_vv - of_uv * of_uv;
    // All surfels in a line: the slope is taken to be the same everywhere.
    const float inverse = determinant > 1e-3F * of_uu * of_vv ? 1 / determinant : 0.0F;
    surface_.uu = inverse * (of_vv * ua.total() - of_uv * va.total());
    surface_.uv = inverse * (of_uu * va.total() - of_uv * ua.total());
    surface_.vu = inverse * (of_vv * ub.total() - of_uv * vb.total());
    surface_.vv = inverse * (of_uu * vb.total() - of_uv * ub.total());
    const float bend =
        surface_.uu * of_uu + (surface_.uv + surface_.vu) * of_uv + surface_.vv * of_vv;
    surface_.height = each * (sum_h.total() - 0.5F * bend);
    surface_.slope_u = sum_a.total() * each;
    surface_.slope_v = sum_b.total() * each;
    return members;
  }

  /// How far surfels' tangent planes are off the surface: see SurfaceSheet::off.
  HWY_INLINE V off_surface(std::size_t i) const {
    const D d;
    const V half = hn::Set(d, 0.5F);
    const V u = hn::Sub(hn::Load(d, u_ + i), hn::Set(d, surface_.u));
    const V v = hn::Sub(hn::Load(d, v_ + i), hn::Set(d, surface_.v));
    const V slope_u = hn::Set(d, surface_.slope_u);
    const V slope_v = hn::Set(d, surface_.slope_v);
    const V bend_u = mul_add(hn::Set(d, surface_.uu), u, hn::Mul(hn::Set(d, surface_.uv), v));
    const V bend_v = mul_add(hn::Set(d, surface_.vu), u, hn::Mul(hn::Set(d, surface_.vv), v));
    const V height =
        mul_add(mul_add(half, bend_u, slope_u), u,
                mul_add(mul_add(half, bend_v, slope_v), v, hn::Set(d, surface_.height)));
    const V turn_u = hn::Sub(hn::Load(d, slope_u_ + i), hn::Add(slope_u, bend_u));
    const V turn_v = hn::Sub(hn::Load(d, slope_v_ + i), hn::Add(slope_v, bend_v));
    const auto [least, most] = deviations(i);
    const V radius = hn::Mul(hn::Set(d, 1.41421356F), least);
    return hn::Add(hn::Div(hn::Abs(hn::Sub(hn::Load(d, height_ + i), height)), radius),
                   hn::Sqrt(mul_add(turn_u, turn_u, hn::Mul(turn_v, turn_v))));
  }

  struct Deviations {
    V least, most;
  };
  HWY_INLINE Deviations deviations(std::size_t i) const {
    const D d;
    const V along_u = hn::LoadU(d, in_.deviation_u + i);
    if (!in_.tangent_x) return {along_u, along_u};
    const V along_v = hn::LoadU(d, in_.deviation_v + i);
    return {hn::Min(along_u, along_v), hn::Max(along_u, along_v)};
  }

  /// Members are the surfels that are near to the surface.
  void select(float most_off) {
    const D d;
    for_each_vector([&](std::size_t i, V) HWY_ATTR {
      const M is_near = hn::Le(off_surface(i), hn::Set(d, most_off));
      hn::Store(hn::IfThenElseZero(is_near, hn::Load(d, near_ + i)), d, member_ + i);
    });
  }

  /// Makes a sheet of the members, if they are enough, and close together.
  Outcome keep() {
    const D d;
    SurfaceSheet sheet{};
    V most_off = hn::Zero(d);
    V least_cosine = hn::Set(d, 1.0F);
    V most_distance2 = hn::Zero(d);
    V most_deviation = hn::Zero(d);
    Sum area;
    for_each_vector([&](std::size_t i, V) HWY_ATTR {
      const M member = hn::Gt(hn::Load(d, member_ + i), hn::Zero(d));
      std::uint8_t bytes[8] = {};  // StoreMaskBits() may write as many.
      hn::StoreMaskBits(d, member, bytes);
      sheet.surfels[i / 64] |= std::uint64_t{bytes[0] | unsigned{bytes[1]} << 8U} << i % 64;
      const V u = hn::Sub(hn::Load(d, u_ + i), hn::Set(d, surface_.u));
      const V v = hn::Sub(hn::Load(d, v_ + i), hn::Set(d, surface_.v));
      const V h = hn::Load(d, height_ + i);
      const V distance2 = mul_add(u, u, mul_add(v, v, hn::Mul(h, h)));
      const V cosine = hn::Load(d, cosine_ + i);
      const auto raise = [&](V& most, V value)
                             HWY_ATTR { most = hn::Max(most, hn::IfThenElseZero(member, value)); };
      raise(most_off, off_surface(i));
      raise(most_distance2, distance2);
      raise(most_deviation, deviations(i).most);
      least_cosine = hn::IfThenElse(member, hn::Min(least_cosine, cosine), least_cosine);
      area.add(i, hn::IfThenElseZero(member, hn::LoadU(d, in_.area + i)));
    });
    for (const std::uint64_t bits : sheet.surfels) sheet.count += std::popcount(bits);
    if (static_cast<float>(sheet.count) < kLeastSurfels) return Outcome::kNone;
    const float square = 4 * hn::GetLane(hn::MaxOfLanes(d, most_distance2));
    if (square > kMostSpread * area.total()) return Outcome::kNone;
    for (std::size_t i = begin_; i < end_; ++i) {
      if (has_surfel(sheet.surfels, static_cast<std::uint32_t>(i))) open_[i] = 0;
    }
    for (int c = 0; c < 3; ++c) {
      sheet.center[c] = frame_.origin[c] + surface_.u * frame_.u[c] + surface_.v * frame_.v[c];
      sheet.axis[c] = frame_.axis[c];
    }
    sheet.radius = std::sqrt(square) / 2;
    sheet.cone_cosine = hn::GetLane(hn::MinOfLanes(d, least_cosine));
    sheet.max_deviation = hn::GetLane(hn::MaxOfLanes(d, most_deviation));
    sheet.off = hn::GetLane(hn::MaxOfLanes(d, most_off));
    found_.push_back(sheet);
    return Outcome::kFound;
  }

  /// A place, and three directions that are perpendicular to each other.
  struct Frame {
    float origin[3], u[3], v[3], axis[3];

    Frame() = default;
    /// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    Frame(const float (&place)[3], const float (&n)[3]) {
      const float sign = std::copysign(1.0F, n[2]);
      const float a = -1 / (sign + n[2]);
      const float b = n[0] * n[1] * a;
      const float along_u[] = {1 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]};
      const float along_v[] = {b, sign + n[1] * n[1] * a, -n[1]};
      std::copy_n(place, 3, origin);
      std::copy_n(along_u, 3, u);
      std::copy_n(along_v, 3, v);
      std::copy_n(n, 3, axis);
    }
  };

  const SurfelColumns& in_;
  float* open_;
  std::vector<SurfaceSheet>& found_;
  std::size_t begin_ = 0, end_ = 0;  ///< The range that is searched.
  Frame frame_;
  Surface surface_{};
  HWY_ALIGN float u_[kSize], v_[kSize], height_[kSize], slope_u_[kSize], slope_v_[kSize],
      cosine_[kSize];
  HWY_ALIGN float near_[kSize];    ///< 1: open, with a normal near to the axis; else 0.
  HWY_ALIGN float member_[kSize];  ///< 1: the surface is fitted to it; else 0.
};

}  // namespace

void find_sheets_simd(const SurfelColumns& surfels, float* open, int count,
                      std::vector<SurfaceSheet>& found) {
  SheetSearch(surfels, open, found).search(0, static_cast<std::size_t>(count));
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(find_sheets_simd);

std::vector<SurfaceSheet> find_sheets(const SurfelColumns& surfels, const std::uint16_t* material,
                                      int count) {
  const auto material_of = [&](int i) { return material ? material[i] : std::uint16_t{0}; };
  const auto may_be_in_one = [&](int i) {
    const auto is_zero = [&](const float* x, const float* y, const float* z) {
      return x[i] == 0 && y[i] == 0 && z[i] == 0;
    };
    for (const HalfPlaneColumns& c : surfels.clip) {
      if (c.x && !is_zero(c.x, c.y, c.z)) return false;
    }
    return !is_zero(surfels.normal_x, surfels.normal_y, surfels.normal_z);
  };
  std::vector<SurfaceSheet> found;
  std::array<bool, kSetupSurfels> searched{};
  for (int first = 0; first < count; ++first) {
    if (searched[first]) continue;
    alignas(64) float open[kSetupSurfels + 16] = {};
    for (int i = first; i < count; ++i) {
      if (material_of(i) != material_of(first)) continue;
      searched[i] = true;
      open[i] = may_be_in_one(i) ? 1.0F : 0.0F;
    }
    HWY_DYNAMIC_DISPATCH(find_sheets_simd)(surfels, open, count, found);
  }
  return found;
}

bool may_sum_up(const SurfaceSheet& sheet, const SplatView& view, float epsilon) {
  // Most pixels of a splat's side: larger splats fill vectors of pixels by themselves.
  constexpr float kMostSide = 8;
  // Most pixels of a sheet for each of its splats.
  constexpr float kMostPixelsEach = 12;
  constexpr float kMostOff = 0.5F;  // By epsilon.
  float p[3];
  float axis[3];
  for (int row = 0; row < 3; ++row) {
    const float* r = view.rotation + 3 * row;
    p[row] = r[0] * sheet.center[0] + r[1] * sheet.center[1] + r[2] * sheet.center[2] +
             view.translation[row];
    axis[row] = r[0] * sheet.axis[0] + r[1] * sheet.axis[1] + r[2] * sheet.axis[2];
  }
  const float least_z = p[2] - sheet.radius;
  if (!view.orthographic && !(least_z > std::max(view.near, sheet.radius))) return false;
  const float z = view.orthographic ? 1.0F : least_z;
  const float focal = std::max(view.focal_x, view.focal_y);
  const float reach = focal * sheet.max_deviation / z;
  if (2 * std::sqrt(2 * view.cutoff * (reach * reach + view.lowpass2)) > kMostSide) return false;
  const float side = 2 * focal * sheet.radius / z;
  if (side * side > kMostPixelsEach * static_cast<float>(sheet.count)) return false;
  const float distance =
      view.orthographic ? 1.0F : std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  const float along =
      view.orthographic ? axis[2] : (axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]) / distance;
  // The least cosine of the normals to the lines of sight: both lie within cones.
  const auto sine_of = [](float cosine) { return std::sqrt(std::max(0.0F, 1 - cosine * cosine)); };
  const auto turned = [&](float cosine, float by_sine, float by_cosine) {
    return cosine * by_cosine - sine_of(cosine) * by_sine;
  };
  const float spread = view.orthographic ? 0.0F : sheet.radius / distance;
  float cosine = turned(std::min(1.0F, std::abs(along)), spread, sine_of(spread));
  if (cosine > 0) cosine = turned(cosine, sine_of(sheet.cone_cosine), sheet.cone_cosine);
  return sheet.off <= kMostOff * epsilon * std::max(cosine, kGrazing);
}

}  // namespace surfel
#endif
