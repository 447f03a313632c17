#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/base/export.h>
#include <surfel/io/record_table.h>
#include <surfel/scene/exact_coordinates.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Attributes of a surfel that a file's records may hold, named as the columns of SurfelCloud.
enum class SurfelAttribute : std::uint8_t {
  kPosition,
  kNormal,
  kShadingNormal,
  kTangent,
  kVarianceU,
  kVarianceV,
  kVariance,
  kArea,
  kClip1,
  kClip1Distance,
  kClip2,
  kClip2Distance,
  kColor,
  kAlpha,
  kCoefficient,
  kUv,
  kDpdu,
  kDpdv,
  kMaterial,
  kGroup,
  kGroupRadius,
  kSource,
  kLevel
};
inline constexpr std::size_t kSurfelAttributes = 23;

/// Where decoded values are written: component k of the i-th surfel goes to at[k][i * stride].
template <class T>
struct ComponentColumns {
  std::array<T*, 3> at;
  std::size_t stride = 1;
};

/// The one decoder from a file's records to columns of surfels, for whole files, pieces of them and
/// levels of detail alike. The constructor resolves which property stands for which attribute:
/// docs/format.md names the properties, which may be of any type and either byte order and
/// have several spellings, case aside. An integer attribute whose values do not fit is taken for a
/// property of another meaning. Internal to the library.
class SurfelDecoder {
 public:
  /// Records decoded at a time: so few that they and their columns stay in the first-level cache
  /// while column after column is filled.
  static constexpr std::size_t kPiece = 256;

  /// Throws Error(kInput) naming `file` where there are no records or a coordinate is missing.
  /// Keeps a reference to the table. Reads all records where the type of an integer attribute is
  /// wider than the attribute.
  SurfelDecoder(const RecordTable& table, const std::string& file);
  SurfelDecoder(RecordTable&& table, const std::string& file) = delete;

  bool has(SurfelAttribute attribute) const { return fields_[index(attribute)].columns[0]; }
  bool anisotropic() const { return has(SurfelAttribute::kTangent); }
  bool double_positions() const;
  ColorEncoding color_encoding() const { return color_encoding_; }
  bool alpha_as_uint8() const { return alpha_as_uint8_; }
  /// Properties that stand for no attribute.
  const std::vector<const RecordColumn*>& others() const { return others_; }

  /// Positions are decoded relative to the origin, which is zero at first.
  const Vec3d& origin() const { return origin_; }
  void set_origin(const Vec3d& origin) { origin_ = origin; }

  /// Writes the attribute of `count` consecutive records in memory. T is what SurfelCloud stores:
  /// float, or for integer attributes their type. Normals and tangents become unit, or zero without
  /// a direction, but stay bit for bit where they are unit; colours linear light; alpha 0..1; a
  /// radius the variance at cutoff 1, radius^2 / 2. Callable from any thread.
  template <class T>
  void decode(SurfelAttribute attribute, const std::byte* records, std::size_t count,
              const ComponentColumns<T>& to) const;
  /// Writes a property as it is, in this machine's byte order.
  void decode(const RecordColumn& column, const std::byte* records, std::size_t count,
              std::byte* to) const;
  /// Extends the box by the finite coordinates of `count` records, in world coordinates.
  void measure(const std::byte* records, std::size_t count, Bounds& box) const;
  /// Adds the coordinates of `count` records, kPiece at most, in world coordinates.
  void measure(const std::byte* records, std::size_t count, CoordinateSpread& spread) const;
  /// Writes the world coordinates of `count` records to the last bit.
  void decode_exact(const std::byte* records, std::size_t count, Vec3d* to) const;
  /// Do float offsets from an origin tell the finite coordinates of `count` records to the last
  /// bit?
  bool offsets_are_exact(const std::byte* records, std::size_t count, const Vec3d& origin) const;
  /// Raises `decimals` to the digits behind the decimal point that the finite coordinates of
  /// `count` records have; kManyDecimals if they have so many or more.
  void count_decimals(const std::byte* records, std::size_t count, int& decimals) const;

 private:
  /// The properties of an attribute's components, null where it has none, and how to decode them.
  struct Field {
    std::array<const RecordColumn*, 3> columns{};
    bool radius = false;           ///< The column of kVariance holds radii.
    const float* table = nullptr;  ///< Linear light of each sRGB code.
    float scale = 1;               ///< Divisor of alpha.
  };
  using Names = std::array<const char*, 3>;

  static constexpr std::size_t index(SurfelAttribute a) { return static_cast<std::size_t>(a); }
  Field* find(SurfelAttribute attribute, const Names& names);
  void release(Field& field);
  void find_vector(SurfelAttribute attribute, std::initializer_list<Names> spellings);
  template <class T>
  void find_integer(SurfelAttribute attribute, const char* name);
  void find_variances();
  void find_clip(SurfelAttribute direction, const Names& names, SurfelAttribute distance,
                 const char* name);
  void find_colors();
  void find_alpha();
  template <class T>
  bool fit(const Field& field) const;
  template <class To>
  void decode_component(SurfelAttribute attribute, int component, const std::byte* records,
                        std::size_t count, To* to, std::size_t stride) const;

  const RecordTable& table_;
  const std::string file_;
  std::array<Field, kSurfelAttributes> fields_{};
  std::vector<bool> taken_;  ///< Does a column of the table stand for an attribute?
  std::vector<const RecordColumn*> others_;
  ColorEncoding color_encoding_ = ColorEncoding::kUint8Srgb;
  bool alpha_as_uint8_ = false;
  Vec3d origin_{0, 0, 0};
};

/// Linear light of every 8-bit sRGB value.
const float* srgb8_table();
/// Linear light of every 16-bit sRGB value.
SURFEL_API const float* srgb16_table();

}  // namespace surfel
