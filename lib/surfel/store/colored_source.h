#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/scene/color_map.h>
#include <surfel/store/attribute_values.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// How the values of an attribute become colours.
struct AttributeColors {
  ColorMap map = ColorMap::kViridis;  ///< Of numbers.
  double min = 0, max = 1;            ///< Values of the map's ends; max >= min, or both the same.

  /// Place in the map, 0..1: 1/2 for all values where min = max.
  double place(double value) const { return max > min ? (value - min) / (max - min) : 0.5; }
  /// The number whose colour is nearest to a linear colour: the one that has become it, within
  /// 0.1 % of max - min, or an end of the map where that number lies beyond it. Unset for
  /// missing_color(), but of kGrey, which has that colour.
  SURFEL_API std::optional<double> value_of(const Vec3f& color) const;
};

/// A source whose surfels are coloured by an attribute instead of by their own colours. Values
/// become colours surfel by surfel, before anything is filtered: numbers by a colour map,
/// categories by a colour each, normals (n + 1) / 2 as sRGB codes in the world's axes. Surfels
/// without a value, or without a normal, have missing_color(). All else is the inner source's.
class SURFEL_API ColoredSource final : public ForwardingSource {
 public:
  /// Keeps references to the inner source, which `values` belongs to.
  ColoredSource(SurfelSource& inner, const AttributeValues& values, const AttributeColors& colors);

  SurfelAttributes attributes() const override;
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud, std::size_t row) const override;

 private:
  Vec3f color(double value) const;

  AttributeValues values_;
  AttributeColors colors_;
  ColorTable table_;
};

/// A source whose surfels have no colours, whatever the inner source has.
class SURFEL_API UncoloredSource final : public ForwardingSource {
 public:
  using ForwardingSource::ForwardingSource;

  SurfelAttributes attributes() const override;
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud, std::size_t row) const override;
};

/// Linear colour of a number of a category.
SURFEL_API Vec3f category_color(AttributeKind kind, std::int64_t number);

}  // namespace surfel
