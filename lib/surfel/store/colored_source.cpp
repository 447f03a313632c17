#include <algorithm>
#include <array>
#include <cmath>

#include <surfel/base/color.h>
#include <surfel/store/colored_source.h>
#include <surfel/store/render_cloud.h>

namespace surfel {
namespace {

/// Values that are made colours of at a time.
constexpr std::size_t kPiece = 256;

Vec3f normal_color(const Vec3f& normal) {
  if (!(normal.squaredNorm() > 0)) return missing_color();
  Vec3f color;
  for (int k = 0; k < 3; ++k) {
    color[k] = srgb_to_linear(std::clamp((normal[k] + 1) / 2, 0.0F, 1.0F));
  }
  return color;
}

}  // namespace

std::optional<double> AttributeColors::value_of(const Vec3f& color) const {
  if (map != ColorMap::kGrey && (color - missing_color()).norm() < 1e-4F) return std::nullopt;
  const auto distance = [&](double t) { return (map_color(map, t) - color).squaredNorm(); };
  constexpr int kSteps = 1024;
  int nearest = 0;
  float least = distance(0);
  for (int i = 1; i <= kSteps; ++i) {
    const float here = distance(static_cast<double>(i) / kSteps);
    if (here >= least) continue;
    least = here;
    nearest = i;
  }
  // The map is all but straight between two steps, and the distance has one minimum there.
  double low = std::max(0, nearest - 1) / static_cast<double>(kSteps);
  double high = std::min(kSteps, nearest + 1) / static_cast<double>(kSteps);
  for (int i = 0; i < 12; ++i) {
    const double third = (high - low) / 3;
    if (distance(low + third) <= distance(high - third)) {
      high -= third;
    } else {
      low += third;
    }
  }
  return min + (low + high) / 2 * (max - min);
}

Vec3f category_color(AttributeKind kind, std::int64_t number) {
  return kind == AttributeKind::kLasClass ? las_class_color(number) : category_color(number);
}

ColoredSource::ColoredSource(SurfelSource& inner, const AttributeValues& values,
                             const AttributeColors& colors)
    : ForwardingSource(inner), values_(values), colors_(colors), table_(colors.map) {}

SurfelAttributes ColoredSource::attributes() const {
  SurfelAttributes known = ForwardingSource::attributes();
  known.color = true;
  return known;
}

Vec3f ColoredSource::color(double value) const {
  if (std::isnan(value)) return missing_color();
  if (values_.kind() == AttributeKind::kNumber) return table_(colors_.place(value));
  return category_color(values_.kind(), static_cast<std::int64_t>(value));
}

void ColoredSource::fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
                         std::size_t row) const {
  ForwardingSource::fill(begin, end, cloud, row);
  std::array<double, kPiece> values;
  for (; begin < end; begin += kPiece, row += kPiece) {
    const std::size_t count = std::min(kPiece, end - begin);
    const bool normals = values_.kind() == AttributeKind::kNormal;
    if (!normals) values_.values(begin, begin + count, cloud, row, values.data());
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t r = row + i;
      const Vec3f c = normals
                          ? normal_color({cloud.normal_x[r], cloud.normal_y[r], cloud.normal_z[r]})
                          : color(values[i]);
      cloud.red[r] = c.x();
      cloud.green[r] = c.y();
      cloud.blue[r] = c.z();
    }
  }
}

SurfelAttributes UncoloredSource::attributes() const {
  SurfelAttributes known = ForwardingSource::attributes();
  known.color = false;
  return known;
}

void UncoloredSource::fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
                           std::size_t row) const {
  ForwardingSource::fill(begin, end, cloud, row);
  const Vec3f grey = SurfelCloud::colorless();
  const std::size_t count = end - begin;
  std::fill_n(cloud.red.data() + row, count, grey.x());
  std::fill_n(cloud.green.data() + row, count, grey.y());
  std::fill_n(cloud.blue.data() + row, count, grey.z());
}

}  // namespace surfel
