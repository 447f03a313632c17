#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include <surfel/base/box_tree.h>
#include <surfel/base/disjoint_sets.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/texture/texel_kernel.h>
#include <surfel/texture/uv_charts.h>

namespace surfel {
namespace {

constexpr std::uint32_t kNoChart = std::numeric_limits<std::uint32_t>::max();

/// Twice the signed area.
double signed_area(const UvCharts::Triangle& t) {
  const Vec2d a = (t[1] - t[0]).cast<double>();
  const Vec2d b = (t[2] - t[0]).cast<double>();
  return a.x() * b.y() - a.y() * b.x();
}

bool has_area(const UvCharts::Triangle& t) {
  return t[0].allFinite() && t[1].allFinite() && t[2].allFinite() && signed_area(t) != 0;
}

/// One side of an edge, its ends in a fixed order: equal sides belong to one chart.
struct Side {
  std::array<std::uint32_t, 2> vertex;
  std::array<float, 4> uv;
  std::uint16_t material;
  std::uint32_t face;

  auto edge() const { return std::tie(vertex, uv, material); }
};

Side make_side(const TriangleMesh& mesh, std::uint32_t face, int corner) {
  int a = corner;
  int b = (corner + 1) % 3;
  const auto& vertex = mesh.face[face];
  if (vertex[a] > vertex[b]) std::swap(a, b);
  const auto& uv = mesh.wedge_uv[face];
  const std::uint16_t material = mesh.face_material.empty() ? 0 : mesh.face_material[face];
  return {{vertex[a], vertex[b]}, {uv[a].x(), uv[a].y(), uv[b].x(), uv[b].y()}, material, face};
}

/// Corners in an order of their own, so that mirrored triangles are equal.
std::array<float, 6> canonical(UvCharts::Triangle t) {
  std::sort(t.begin(), t.end(), [](const Vec2f& a, const Vec2f& b) {
    return std::make_pair(a.x(), a.y()) < std::make_pair(b.x(), b.y());
  });
  return {t[0].x(), t[0].y(), t[1].x(), t[1].y(), t[2].x(), t[2].y()};
}

Vec2d closest_on_segment(const Vec2d& p, const Vec2d& a, const Vec2d& b) {
  const Vec2d ab = b - a;
  const double length2 = ab.squaredNorm();
  const double s = length2 > 0 ? std::clamp((p - a).dot(ab) / length2, 0.0, 1.0) : 0.0;
  return a + s * ab;
}

Vec3d barycentric(const Vec2d& p, const std::array<Vec2d, 3>& t) {
  const auto cross = [](const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); };
  const double area = cross(t[1] - t[0], t[2] - t[0]);
  const double b1 = cross(p - t[0], t[2] - t[0]) / area;
  const double b2 = cross(t[1] - t[0], p - t[0]) / area;
  return {1 - b1 - b2, b1, b2};
}

/// Point of the triangle nearest to p, as barycentric coordinates.
Vec3d closest_in_triangle(const Vec2d& p, const std::array<Vec2d, 3>& t) {
  Vec3d inside = barycentric(p, t);
  if (inside.minCoeff() >= 0) return inside;
  Vec2d best = t[0];
  for (int i = 0; i < 3; ++i) {
    const Vec2d q = closest_on_segment(p, t[i], t[(i + 1) % 3]);
    if ((q - p).squaredNorm() < (best - p).squaredNorm()) best = q;
  }
  return barycentric(best, t).cwiseMax(0);
}

}  // namespace

/// Boxes of faces in uv, along a curve.
struct UvCharts::Tree {
  struct Box {
    Vec2f min = Vec2f::Constant(std::numeric_limits<float>::infinity());
    Vec2f max = -min;

    void add(const Box& other) {
      min = min.cwiseMin(other.min);
      max = max.cwiseMax(other.max);
    }
  };

  Tree(const TriangleMesh& mesh, const Array<std::uint32_t>& faces) {
    Array<Vec3f> center;
    for (const std::uint32_t f : faces) {
      const Vec2f sum = mesh.wedge_uv[f][0] + mesh.wedge_uv[f][1] + mesh.wedge_uv[f][2];
      center.emplace_back(sum.x(), sum.y(), 0.0F);
    }
    face = morton_order(center);
    for (std::uint32_t& f : face) f = faces[f];
    boxes = {face.size(), [&](std::size_t i) {
               const Triangle& t = mesh.wedge_uv[face[i]];
               return Box{t[0].cwiseMin(t[1]).cwiseMin(t[2]), t[0].cwiseMax(t[1]).cwiseMax(t[2])};
             }};
  }

  Array<std::uint32_t> face;  ///< Faces in the order of the boxes' items.
  BoxTree<Box, 2, 4> boxes;
};

UvCharts::UvCharts(const TriangleMesh& mesh) : mesh_(&mesh) {
  if (mesh.wedge_uv.empty()) {
    throw Error(ErrorKind::kInput, "the mesh has no texture coordinates, so it has no charts");
  }
  find_charts();
  merge_equal_charts();
  tree_ = std::make_shared<const Tree>(mesh, faces_.item);
}

void UvCharts::find_charts() {
  const auto faces = static_cast<std::uint32_t>(mesh_->face.size());
  std::vector<Side> sides;
  sides.reserve(std::size_t{3} * faces);
  for (std::uint32_t face = 0; face < faces; ++face) {
    if (!has_area(mesh_->wedge_uv[face])) continue;
    for (int corner = 0; corner < 3; ++corner) sides.push_back(make_side(*mesh_, face, corner));
  }
  std::sort(sides.begin(), sides.end(),
            [](const Side& a, const Side& b) { return a.edge() < b.edge(); });

  DisjointSets sets(faces);
  for (std::size_t i = 1; i < sides.size(); ++i) {
    if (sides[i - 1].edge() == sides[i].edge()) sets.unite(sides[i - 1].face, sides[i].face);
  }
  chart_of_face_.assign(faces, kNoChart);
  std::uint32_t charts = 0;
  for (std::uint32_t face = 0; face < faces; ++face) {
    if (!has_area(mesh_->wedge_uv[face])) continue;
    const std::uint32_t root = sets.root(face);
    chart_of_face_[face] = root == face ? charts++ : chart_of_face_[root];
  }
  group_faces(charts);
}

void UvCharts::group_faces(std::size_t charts) {
  faces_ = group_by_key<std::uint32_t>(charts, [&](const auto& add) {
    for (std::uint32_t face = 0; face < chart_of_face_.size(); ++face) {
      if (chart_of_face_[face] != kNoChart) add(chart_of_face_[face], face);
    }
  });
}

void UvCharts::merge_equal_charts() {
  struct Key {
    std::uint16_t material;
    std::vector<std::array<float, 6>> triangles;
    std::uint32_t chart;
    auto content() const { return std::tie(material, triangles); }
  };
  std::vector<Key> keys(count());
  for (std::uint32_t chart = 0; chart < count(); ++chart) {
    Key& key = keys[chart];
    const std::uint32_t face = faces_.item[faces_.begin[chart]];
    key.material = mesh_->face_material.empty() ? 0 : mesh_->face_material[face];
    key.chart = chart;
    for (const Triangle& t : triangles(chart)) key.triangles.push_back(canonical(t));
    std::sort(key.triangles.begin(), key.triangles.end());
  }
  std::sort(keys.begin(), keys.end(),
            [](const Key& a, const Key& b) { return a.content() < b.content(); });
  std::vector<std::uint32_t> merged(count());
  std::uint32_t charts = 0;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const bool again = i > 0 && keys[i - 1].content() == keys[i].content();
    merged[keys[i].chart] = again ? charts - 1 : charts++;
  }
  for (std::uint32_t& chart : chart_of_face_) {
    if (chart != kNoChart) chart = merged[chart];
  }
  group_faces(charts);
}

std::vector<UvCharts::Triangle> UvCharts::triangles(std::uint32_t chart) const {
  std::vector<Triangle> found;
  for (std::size_t i = faces_.begin[chart]; i < faces_.begin[chart + 1]; ++i) {
    found.push_back(mesh_->wedge_uv[faces_.item[i]]);
  }
  return found;
}

std::optional<std::uint32_t> UvCharts::find(const Vec2f& uv, const Vec3d& position,
                                            std::optional<std::uint16_t> material,
                                            const Vec2f& tolerance) const {
  const Vec2d p = uv.cast<double>();
  const Vec3d in_mesh = position - mesh_->origin;
  std::optional<std::uint32_t> chart;
  std::pair<double, std::uint32_t> nearest{std::numeric_limits<double>::infinity(), 0};

  const auto try_face = [&](std::uint32_t face) {
    if (material && !mesh_->face_material.empty() && mesh_->face_material[face] != *material) {
      return;
    }
    std::array<Vec2d, 3> t;
    for (int i = 0; i < 3; ++i) t[i] = mesh_->wedge_uv[face][i].cast<double>();
    const Vec3d b = closest_in_triangle(p, t);
    const Vec2d miss = (b[0] * t[0] + b[1] * t[1] + b[2] * t[2] - p).cwiseAbs();
    if (!(miss.x() <= tolerance.x() && miss.y() <= tolerance.y())) return;
    Vec3d point = Vec3d::Zero();
    for (int i = 0; i < 3; ++i) {
      point += b[i] * mesh_->position[mesh_->face[face][i]].cast<double>();
    }
    const std::pair<double, std::uint32_t> distance{(point - in_mesh).squaredNorm(), face};
    if (distance < nearest) {
      nearest = distance;
      chart = chart_of_face_[face];
    }
  };

  tree_->boxes.for_each_leaf(
      [&](const Tree::Box& box) {
        return ((uv + tolerance).array() >= box.min.array()).all() &&
               ((uv - tolerance).array() <= box.max.array()).all();
      },
      [&](std::size_t leaf) {
        tree_->boxes.for_each_item(leaf, [&](std::size_t i) { try_face(tree_->face[i]); });
      });
  return chart;
}

std::optional<CoverageRaster> coverage_box(const std::vector<UvCharts::Triangle>& triangles,
                                           int width, int height, double max_texels) {
  Vec2d low = Vec2d::Constant(std::numeric_limits<double>::infinity());
  Vec2d high = -low;
  for (const UvCharts::Triangle& t : triangles) {
    for (const Vec2f& uv : t) {
      low = low.cwiseMin(texel_position(uv, width, height));
      high = high.cwiseMax(texel_position(uv, width, height));
    }
  }
  low = low.array().floor();
  high = high.array().floor() + 1;
  constexpr double kMaxIndex = 1e9;  // Indices of texels fit 32 bits with a sign.
  if (!((high - low).prod() <= max_texels && low.minCoeff() >= -kMaxIndex &&
        high.maxCoeff() <= kMaxIndex)) {
    return std::nullopt;
  }
  CoverageRaster box;
  box.first_x = static_cast<int>(low.x());
  box.first_y = static_cast<int>(low.y());
  box.width = static_cast<int>(high.x() - low.x());
  box.height = static_cast<int>(high.y() - low.y());
  return box;
}

namespace {

/// Half-plane a x + b y + c >= 0.
struct HalfPlane {
  double a, b, c;
};

/// Columns of texels, in [0, width), whose centre (i + 1/2, y) satisfies all half-planes, each
/// moved outwards by `margin` times the half-diagonal of a texel in its norm: 0 for centres in the
/// triangle, 1 for texels that touch it (together with the triangle's box).
std::pair<int, int> covered_columns(const std::array<HalfPlane, 3>& planes, double y, double low,
                                    double high, double margin, int width) {
  for (const HalfPlane& plane : planes) {
    const double rest =
        plane.b * y + plane.c + margin * (std::abs(plane.a) + std::abs(plane.b)) / 2;
    if (plane.a > 0) {
      low = std::max(low, -rest / plane.a);
    } else if (plane.a < 0) {
      high = std::min(high, -rest / plane.a);
    } else if (rest < 0) {
      return {0, 0};
    }
  }
  const double begin = std::max(0.0, std::ceil(low - 0.5));
  const double end = std::min<double>(width, std::floor(high - 0.5) + 1);
  if (!(begin < end)) return {0, 0};
  return {static_cast<int>(begin), static_cast<int>(end)};
}

void rasterize_triangle(const std::array<Vec2d, 3>& t, CoverageRaster& raster) {
  const Vec2d low = t[0].cwiseMin(t[1]).cwiseMin(t[2]);
  const Vec2d high = t[0].cwiseMax(t[1]).cwiseMax(t[2]);
  const Vec2d ab = t[1] - t[0];
  const Vec2d ac = t[2] - t[0];
  const double orientation = ab.x() * ac.y() - ab.y() * ac.x() < 0 ? -1 : 1;
  std::array<HalfPlane, 3> planes{};
  for (int i = 0; i < 3; ++i) {
    const Vec2d edge = orientation * (t[(i + 1) % 3] - t[i]);
    planes[i] = {-edge.y(), edge.x(), edge.y() * t[i].x() - edge.x() * t[i].y()};
  }
  const int row_begin = std::max(0, static_cast<int>(std::floor(low.y())));
  const int row_end = std::min(raster.height, static_cast<int>(std::floor(high.y())) + 1);
  for (int y = row_begin; y < row_end; ++y) {
    float* row = raster.weight.data() + static_cast<std::size_t>(y) * raster.width;
    const auto fill = [&](std::pair<int, int> columns, float weight) {
      for (int x = columns.first; x < columns.second; ++x) row[x] = std::max(row[x], weight);
    };
    // A texel touches the triangle's box where its centre is within half a texel of it.
    fill(covered_columns(planes, y + 0.5, low.x() - 0.5, high.x() + 0.5, 1, raster.width),
         kPartialCoverage);
    if (y + 0.5 < low.y() || y + 0.5 > high.y()) continue;
    fill(covered_columns(planes, y + 0.5, low.x(), high.x(), 0, raster.width), 1);
  }
}

}  // namespace

void rasterize_coverage(const std::vector<UvCharts::Triangle>& triangles, int width, int height,
                        CoverageRaster& raster) {
  raster.weight.assign(static_cast<std::size_t>(raster.width) * raster.height, 0.0F);
  const Vec2d first(raster.first_x, raster.first_y);
  for (const UvCharts::Triangle& t : triangles) {
    std::array<Vec2d, 3> texels;
    for (int i = 0; i < 3; ++i) texels[i] = texel_position(t[i], width, height) - first;
    rasterize_triangle(texels, raster);
  }
}

}  // namespace surfel
