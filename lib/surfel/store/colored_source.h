#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

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
};

/// A source whose surfels are coloured by an attribute instead of by their own colours. Values
/// become colours surfel by surfel, before anything is filtered: numbers by a colour map,
/// categories by a colour each, normals (n + 1) / 2 as sRGB codes in the world's axes. Surfels
/// without a value, or without a normal, have missing_color(). All else is the inner source's.
class SURFEL_API ColoredSource final : public SurfelSource {
 public:
  /// Keeps references to the inner source, which `values` belongs to.
  ColoredSource(SurfelSource& inner, const AttributeValues& values, const AttributeColors& colors);

  std::size_t size() const override { return inner_.size(); }
  SurfelAttributes attributes() const override;
  Vec3d origin() const override { return inner_.origin(); }
  bool recenter(const Bounds& bounds) override { return inner_.recenter(bounds); }
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud, std::size_t row) const override;
  void fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const override {
    inner_.fill_sources(begin, end, to);
  }
  std::vector<std::string> columns() const override { return inner_.columns(); }
  void fill_column(std::size_t column, std::size_t begin, std::size_t end,
                   double* to) const override {
    inner_.fill_column(column, begin, end, to);
  }
  void expect(std::size_t begin, std::size_t end) const override { inner_.expect(begin, end); }

 private:
  Vec3f color(double value) const;

  SurfelSource& inner_;
  AttributeValues values_;
  AttributeColors colors_;
  ColorTable table_;
};

/// Linear colour of a number of a category.
SURFEL_API Vec3f category_color(AttributeKind kind, std::int64_t number);

}  // namespace surfel
