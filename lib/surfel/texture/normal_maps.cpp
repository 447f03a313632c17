#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/io/image_io.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texel_kernel.h>
#include <surfel/texture/texture_source.h>

namespace surfel {
namespace {

constexpr std::size_t kReliefRows = 16;  ///< Rows that a thread works on at a time.

/// Calls set(x, y, first, second) for all texels, with the three values of each map to be set, and
/// makes maps of them.
template <class Set>
std::pair<TextureMap, TextureMap> make_maps(const Image& size, WrapMode wrap, const Set& set) {
  Image first = rgba_image(size.width, size.height);
  Image second = rgba_image(size.width, size.height);
  parallel_for(static_cast<std::size_t>(size.height), kReliefRows,
               [&](std::size_t begin, std::size_t end, int) {
                 for (int y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
                   for (int x = 0; x < size.width; ++x) {
                     float* const a = first.pixel(x, y);
                     float* const b = second.pixel(x, y);
                     std::fill_n(b, 3, 0.0F);
                     set(x, y, a, b);
                     a[3] = b[3] = 1;
                   }
                 }
               });
  return {TextureMap(std::move(first), wrap), TextureMap(std::move(second), wrap)};
}

WrapMode wrap_of(const std::optional<WrapMode>& said) { return said.value_or(WrapMode::kRepeat); }

/// Makes the maps of images and adds them to a set.
class ReliefReader {
 public:
  explicit ReliefReader(const NormalMapOptions& options) : options_(options) {}

  void add_none() {
    add(ReliefKind::kNone, TextureMap::constant({0, 0, 1}), TextureMap::constant({0, 0, 0}));
  }

  /// \param path  for messages.
  void add_normals(const Image& image, const std::string& path, WrapMode wrap) {
    const std::array<int, 3> rgb = channels(image, {"R", "G", "B"});
    if (*std::min_element(rgb.begin(), rgb.end()) < 0) {
      throw_input(path, fmt::format("a normal map needs the channels R, G and B, and this image "
                                    "has {}; if it is a height map, give it as bump map",
                                    fmt::join(image.channels, ", ")));
    }
    const float up = options_.y_down ? -1.0F : 1.0F;
    const auto set = [&](int x, int y, float* first, float*) {
      const float* p = image.pixel(x, y);
      Vec3f n(2 * p[rgb[0]] - 1, up * (2 * p[rgb[1]] - 1), 2 * p[rgb[2]] - 1);
      const float length = n.norm();
      // Codes of 8 bits are off by up to half of a percent in length, which would count as variance
      // of the normals.
      n = std::isfinite(length) && length > 0 ? Vec3f(n / length) : Vec3f(0, 0, 1);
      std::copy_n(n.data(), 3, first);
    };
    auto [first, second] = make_maps(image, wrap, set);
    add(ReliefKind::kNormals, std::move(first), TextureMap::constant({0, 0, 0}));
  }

  /// \param scale  height of white above black.
  void add_heights(const Image& image, float scale, WrapMode wrap) {
    std::array<int, 3> rgb = channels(image, {"R", "G", "B"});
    if (*std::min_element(rgb.begin(), rgb.end()) < 0) rgb.fill(channels(image, {"Y", "", ""})[0]);
    if (rgb[0] < 0) rgb.fill(0);
    const auto height = [&](int x, int y) {
      const float* p = image.pixel(x, y);
      const float h = scale * (p[rgb[0]] + p[rgb[1]] + p[rgb[2]]) / 3;
      return std::isfinite(h) ? h : 0.0F;
    };
    const TexelAxis across{.count = image.width};
    const TexelAxis down{.count = image.height};
    const auto column = [&](int x) { return stored_offset(x, across, wrap); };
    const auto row = [&](int y) { return stored_offset(y, down, wrap); };
    const auto set = [&](int x, int y, float* first, float* second) {
      const float h_x = (height(column(x + 1), y) - height(column(x - 1), y)) / 2;
      const float h_y = (height(x, row(y + 1)) - height(x, row(y - 1))) / 2;
      first[0] = h_x;
      first[1] = h_y;
      first[2] = h_x * h_x;
      second[0] = h_y * h_y;
      second[1] = h_x * h_y;
    };
    auto [first, second] = make_maps(image, wrap, set);
    add(ReliefKind::kHeights, std::move(first), std::move(second));
  }

  /// One map per image and height, however many materials share it.
  void add_materials(const TriangleMesh& mesh, const std::string& mesh_name) {
    std::map<std::tuple<ReliefKind, std::string, float, WrapMode>, std::size_t> known;
    for (const MeshMaterial& material : mesh.material) {
      std::tuple<ReliefKind, std::string, float, WrapMode> key{ReliefKind::kNone, "", 0,
                                                               WrapMode::kRepeat};
      const WrapMode said = wrap_of(options_.wrap ? options_.wrap : material.wrap);
      if (!material.normal_map.empty()) {
        key = {ReliefKind::kNormals, material.normal_map, 0, said};
      } else if (!material.bump_map.empty()) {
        const double scale = options_.bump_scale.value_or(material.bump_scale);
        key = {ReliefKind::kHeights, material.bump_map, static_cast<float>(scale), said};
      }
      const auto [place, is_new] = known.try_emplace(key, maps_.kind.size());
      maps_.first.map_of_material.push_back(place->second);
      maps_.second.map_of_material.push_back(place->second);
      if (!is_new) continue;
      const auto& [kind, path, scale, wrap] = key;
      if (kind == ReliefKind::kNone) {
        add_none();
        continue;
      }
      const Image image = read_data_image(material_image(mesh, material, path, mesh_name));
      if (kind == ReliefKind::kNormals) add_normals(image, path, wrap);
      if (kind == ReliefKind::kHeights) add_heights(image, scale, wrap);
    }
  }

  NormalMaps take() { return std::move(maps_); }

 private:
  /// Numbers of the image's channels of these names; -1: it has none.
  static std::array<int, 3> channels(const Image& image, const std::array<const char*, 3>& names) {
    std::array<int, 3> found{-1, -1, -1};
    for (std::size_t k = 0; k < names.size(); ++k) {
      const auto at = std::find(image.channels.begin(), image.channels.end(), names[k]);
      if (at != image.channels.end()) found[k] = static_cast<int>(at - image.channels.begin());
    }
    return found;
  }

  void add(ReliefKind kind, TextureMap&& first, TextureMap&& second) {
    maps_.kind.push_back(kind);
    maps_.first.maps.push_back(std::move(first));
    maps_.second.maps.push_back(std::move(second));
  }

  const NormalMapOptions& options_;
  NormalMaps maps_;
};

/// Nodes and weights of Gauss and Hermite's rule of five points, for a Gaussian of variance 1
/// (Abramowitz and Stegun, table 25.10, scaled by sqrt 2 and 1 / sqrt pi).
constexpr std::array<double, 5> kNode{0, 1.355626179974266, -1.355626179974266, 2.856970013872806,
                                      -2.856970013872806};
constexpr std::array<double, 5> kNodeWeight{0.533333333333333, 0.222075922005613, 0.222075922005613,
                                            0.011257411327721, 0.011257411327721};

/// A root of a symmetric matrix that is positive semi-definite but for rounding.
Mat2d lower_root(const Mat2d& variance) {
  Mat2d root = Mat2d::Zero();
  root(0, 0) = std::sqrt(std::max(0.0, variance(0, 0)));
  const double most = std::sqrt(std::max(0.0, variance(1, 1)));
  // Rounding may leave a covariance beside a variance of nothing.
  if (root(0, 0) > 0) root(1, 0) = std::clamp(variance(0, 1) / root(0, 0), -most, most);
  root(1, 1) = std::sqrt(std::max(0.0, variance(1, 1) - root(1, 0) * root(1, 0)));
  return root;
}

}  // namespace

std::vector<std::string> NormalMapOptions::problems() const {
  std::vector<std::string> found;
  check_rule(found, normal_map.empty() || bump.empty(),
             "`normal_map` and `bump` both tell the surface's normals; give one");
  check_rule(found, !bump_scale || std::isfinite(*bump_scale), "`bump_scale` must be finite");
  check_rule(found, !bump_scale || normal_map.empty(),
             "`bump_scale` has no effect on a normal map; leave it out");
  check_rule(found, !y_down || bump.empty(), "`y_down` has no effect on a bump map; leave it out");
  check_rule(found, wrap != WrapMode::kNothing,
             "`wrap` must say what lies beyond the image's borders; it cannot be nothing");
  return found;
}

bool NormalMaps::empty() const {
  return std::all_of(kind.begin(), kind.end(), [](ReliefKind k) { return k == ReliefKind::kNone; });
}

NormalMaps load_normal_maps(const NormalMapOptions& options, const TriangleMesh* mesh,
                            const std::string& mesh_name) {
  require_usable(options);
  if (!mesh && options.empty()) {
    throw_usage("there is neither a normal map nor a mesh whose materials name some");
  }
  ReliefReader reader(options);
  if (!options.normal_map.empty()) {
    reader.add_normals(read_data_image(options.normal_map), options.normal_map,
                       wrap_of(options.wrap));
  } else if (!options.bump.empty()) {
    const Image heights = is_procedural_image(options.bump) ? load_texture_image(options.bump)
                                                            : read_data_image(options.bump);
    reader.add_heights(heights, static_cast<float>(options.bump_scale.value_or(1)),
                       wrap_of(options.wrap));
  } else {
    reader.add_materials(*mesh, mesh_name);
  }
  NormalMaps maps = reader.take();
  if (maps.empty() || !mesh) return maps;
  if (mesh->wedge_uv.empty()) {
    throw_input(mesh_name,
                "the mesh has no texture coordinates, so no normal map can be put on it");
  }
  if (options.charts) maps.first.charts.emplace(*mesh);
  return maps;
}

std::optional<Vec3d> normal_in_scene(const ReliefBase& base, const Vec3d& normal) {
  const Vec3d& n = base.normal;
  const Vec3d along = base.dpdu - n * n.dot(base.dpdu);
  const double length = along.norm();
  const double side = n.cross(along).dot(base.dpdv);
  if (!(length > 0) || !(std::abs(side) > 0)) return std::nullopt;
  const Vec3d x = along / length;
  const Vec3d y = n.cross(x) * (side > 0 ? 1 : -1);
  return normal.x() * x + normal.y() * y + normal.z() * n;
}

std::optional<Vec3d> raised_normal(const ReliefBase& base, const HeightSlopes& slopes, int width,
                                   int height) {
  const auto L = texels_per_unit(base.dpdu, base.dpdv, width, height);
  if (!L) return std::nullopt;
  const Vec3d& n = base.normal;
  const Vec3d t = n.unitOrthogonal();
  const Vec3d b = n.cross(t);
  // T^-T of the frame (t, b).
  Mat2d A;
  A << t.transpose() * L->transpose(), b.transpose() * L->transpose();
  const Vec2d mean = A * slopes.mean;
  const auto raised = [&](const Vec2d& slope) -> Vec3d {
    return (n - slope.x() * t - slope.y() * b).normalized();
  };
  if (slopes.covariance.isZero(0)) return raised(mean);
  const Mat2d root = lower_root(A * slopes.covariance * A.transpose());
  Vec3d sum(0, 0, 0);
  for (std::size_t i = 0; i < kNode.size(); ++i) {
    for (std::size_t j = 0; j < kNode.size(); ++j) {
      sum += kNodeWeight[i] * kNodeWeight[j] * raised(mean + root * Vec2d(kNode[i], kNode[j]));
    }
  }
  return sum;
}

}  // namespace surfel
