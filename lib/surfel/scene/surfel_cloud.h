#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/base/scalar_type.h>
#include <surfel/base/types.h>
#include <surfel/scene/cluster_tree.h>

namespace surfel {

/// A column that this library gives no meaning to; tools carry it through unchanged.
struct ExtraProperty {
  std::string name;
  ScalarType type = ScalarType::kFloat32;
  Array<std::byte>
      data;  ///< size() values of scalar_size(type) bytes, in this machine's byte order.
};

/// How `color` stood in the file, and will be written: integers are sRGB-encoded, floats linear.
enum class ColorEncoding : std::uint8_t { kUint8Srgb, kUint16Srgb, kFloatLinear };

/// What the colours of surfels are, which decides whether lighting them makes sense.
enum class ColorLight : std::uint8_t {
  kUnsaid,       ///< Nobody has said.
  kRecorded,     ///< Light as a camera or scanner recorded it, shades included.
  kReflectance,  ///< The surface's own colours, as of a mesh or its textures.
  kMixed,        ///< Some surfels have recorded light, some have not.
};

/// What colours are for which a cloud says `said`: recorded light where it says nothing, as files
/// of scanners do; kUnsaid where there are no colours.
constexpr ColorLight meaning_of_colors(ColorLight said, bool colors) {
  if (!colors) return ColorLight::kUnsaid;
  return said == ColorLight::kUnsaid ? ColorLight::kRecorded : said;
}

/// Sensor position and orientation of a scan (PCD's VIEWPOINT).
struct Viewpoint {
  Vec3d position{0, 0, 0};
  Vec4d orientation{1, 0, 0, 0};  ///< Unit quaternion w x y z.
};

/// Is this the viewpoint that PCD files have which know none?
inline bool is_default(const Viewpoint& v) {
  return v.position == Viewpoint{}.position && v.orientation == Viewpoint{}.orientation;
}

/// A block of bytes that a LAS file holds beside its points.
struct LasRecord {
  std::string user;  ///< Who defines its meaning.
  std::uint16_t id = 0;
  std::string description;
  std::string bytes;
};

/// How a LAS file stores its points, so that another LAS file can store them with the same
/// integers: a coordinate is offset + integer * scale.
struct LasStorage {
  Vec3d scale{1, 1, 1};
  Vec3d offset{0, 0, 0};
  int point_format = 0;               ///< 0..10.
  std::uint16_t global_encoding = 0;  ///< What the times count from, what the system is told in.
  std::vector<LasRecord> records;     ///< Such as the coordinate reference system.
};

/// Surfels: oriented points with a Gaussian each, a structure of arrays. `position` is always
/// there, every other column either is empty (the attribute is absent) or has size() values.
/// docs/format.md lists the columns as files have them; colours here are linear light.
struct SURFEL_API SurfelCloud {
  Vec3d origin{0, 0, 0};  ///< World position = origin + position, so that far-away scenes keep
                          ///< their precision in float; see `exact`.
  bool double_positions = false;  ///< Write x y z as double whatever the origin.
  /// Digits behind the decimal point of the file's coordinates, where these have double precision
  /// and few digits: coordinates are written with the same digits, which offsets from the origin
  /// tell apart where there is no `exact`. Unset: not so, or moved since.
  std::optional<int> decimals;

  Array<Vec3f> position;  ///< Scene units, relative to `origin`.
  /// The world position to the last bit that the file had, there where floats about the origin do
  /// not tell it. It counts while `position` is what it rounds to, so that surfels are moved by
  /// their `position` alone; see world().
  Array<Vec3d> exact;
  Array<Vec3f> normal;  ///< Unit length; all zero = unknown. The disc lies across it.
  /// Mean of a normal map's normals under the surfel's Gaussian, for shading: its length, 1 at
  /// most, tells how much they vary. All zero = as `normal`.
  Array<Vec3f> shading_normal;
  Array<float> variance;    ///< Isotropic: V = variance * I in the tangent plane, unit^2.
  Array<Vec3f> tangent;     ///< Anisotropic: unit tangent t, V = diag(variance_u, variance_v) in
  Array<float> variance_u;  ///< the frame (t, n x t). These three come together and win over
  Array<float> variance_v;  ///< `variance`.
  Array<float> area;        ///< Surface that the sample stands for, unit^2: the amplitude a_k.
  /// Half-planes that surfels are cut by: what lies further than `clip1_distance` (scene units, may
  /// be negative) from the centre along the unit vector `clip1` in the tangent plane is no part of
  /// the surfel. A vector that is zero cuts nothing. Each pair of columns comes together.
  Array<Vec3f> clip1;
  Array<float> clip1_distance;
  Array<Vec3f> clip2;  ///< A second half-plane: what both leave is the surfel.
  Array<float> clip2_distance;
  Array<Vec3f> color;  ///< Colour sample c_k, linear.
  ColorEncoding color_encoding = ColorEncoding::kUint8Srgb;
  Array<float> alpha;           ///< Opacity 0..1, straight.
  bool alpha_as_uint8 = false;  ///< Write alpha as uchar.
  Array<Vec3f> coefficient;     ///< Texture coefficients w_k, linear, unbounded; win over `color`.
  Array<Vec2f> uv;              ///< Texture coordinate, v = 0 at the image's bottom row.
  Array<Vec3f> dpdu;            ///< Surface derivative by u, units per uv unit.
  Array<Vec3f> dpdv;
  Array<std::uint16_t> material;  ///< Row of the material table.
  Array<std::uint16_t> group;     ///< Group S_k (SP06).
  Array<float> group_radius;      ///< Enlarged radius of SP06, unit.
  Array<std::uint32_t> source;    ///< Copies of one splat share it.
  Array<std::uint8_t> level;      ///< Level of detail, 0 = finest.
  std::vector<ExtraProperty> extra;
  /// Levels of detail (surfel-lod); empty where there is one level only. It fits the order of the
  /// surfels: a function that changes the order drops it, as gathered() does.
  ClusterTree tree;

  ColorLight color_light = ColorLight::kUnsaid;  ///< As the file says; see meaning_of_colors().
  std::optional<double> basis_cutoff;   ///< Cutoff c of the truncated basis that w_k was fitted in.
  std::vector<std::string> provenance;  ///< One line a tool that made or changed the cloud.
  std::vector<std::string> comments;    ///< The file's other comments.
  std::optional<Viewpoint> viewpoint;   ///< Unset: unknown, or several.
  /// Of a cloud of several scans each one's viewpoint: the property `scan` of a point tells which.
  /// Empty where there is one viewpoint, or where the viewpoint of a scan is unknown.
  std::vector<Viewpoint> scan_viewpoints;
  std::optional<Vec3d> up;  ///< Upward direction, where the file says it.
  /// Unset: not of a LAS file, or moved since. Of several files the first one's.
  std::optional<LasStorage> las;
  /// Surfels of coarser levels of detail that the file holds as well and that were not asked for.
  std::size_t coarser_skipped = 0;
  /// Points of the file that were not measured, as the file itself says, and were left out.
  std::size_t unmeasured_skipped = 0;
  /// Elements of the file that are no points and were not read, such as faces, by their number.
  std::vector<std::pair<std::string, std::size_t>> skipped_elements;

  std::size_t size() const { return position.size(); }
  bool empty() const { return position.empty(); }
  bool anisotropic() const { return !tangent.empty(); }
  /// Linear colour of surfels that have none: a light grey that the default lights do not drive
  /// into saturation.
  static Vec3f colorless() { return {0.55F, 0.55F, 0.55F}; }
  /// Column of linear colours to render: `coefficient`, else `color`, else null.
  const Array<Vec3f>* render_color() const;

  /// The viewpoint of the scan that each surfel belongs to, by scan_viewpoints and the property
  /// `scan`, in world coordinates; empty where they do not tell it of every surfel.
  Array<Vec3d> sensors() const;

  double world(std::size_t i, int axis) const {
    const float offset = position[i][axis];
    if (!exact.empty() && static_cast<float>(exact[i][axis] - origin[axis]) == offset) {
      return exact[i][axis];
    }
    // Not 0 + x, which makes 0 of -0.
    return origin[axis] == 0 ? static_cast<double>(offset)
                             : origin[axis] + static_cast<double>(offset);
  }
  Vec3d world(std::size_t i) const { return {world(i, 0), world(i, 1), world(i, 2)}; }
  /// Moves a surfel to a place that is told to the last bit; `exact` is there.
  void place(std::size_t i, const Vec3d& at) {
    exact[i] = at;
    position[i] = (at - origin).cast<float>();
  }
  /// Bounds of the finite positions, in world coordinates.
  Bounds bounds() const;

  /// The surfels order[0], order[1], ... with all their attributes; indices may repeat.
  SurfelCloud gathered(const Array<std::uint32_t>& order) const;
  /// Throws Error(kInput) if a column is neither empty nor of size(); `name` starts the message.
  void check_columns(const std::string& name) const;
  /// Calls visit(column) for every array with a value per surfel, `extra` excluded.
  template <class Cloud, class Visit>
  static void visit_columns(Cloud& cloud, Visit&& visit);
};

template <class Cloud, class Visit>
void SurfelCloud::visit_columns(Cloud& cloud, Visit&& visit) {
  visit(cloud.position);
  visit(cloud.exact);
  visit(cloud.normal);
  visit(cloud.shading_normal);
  visit(cloud.variance);
  visit(cloud.tangent);
  visit(cloud.variance_u);
  visit(cloud.variance_v);
  visit(cloud.area);
  visit(cloud.clip1);
  visit(cloud.clip1_distance);
  visit(cloud.clip2);
  visit(cloud.clip2_distance);
  visit(cloud.color);
  visit(cloud.alpha);
  visit(cloud.coefficient);
  visit(cloud.uv);
  visit(cloud.dpdu);
  visit(cloud.dpdv);
  visit(cloud.material);
  visit(cloud.group);
  visit(cloud.group_radius);
  visit(cloud.source);
  visit(cloud.level);
}

}  // namespace surfel
