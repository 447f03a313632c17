#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/sample/equal_area_strata.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_image.h>

namespace surfel {
namespace {

/// Bytes of a surfel's columns.
constexpr std::size_t kSurfelBytes = 6 * sizeof(Vec3f);

/// How many of `count` surfels each part gets: its share of the area, and `count` in sum.
std::vector<std::size_t> surfels_per_part(const std::vector<EqualAreaStrata>& measured,
                                          std::size_t count) {
  double total = 0;
  for (const EqualAreaStrata& strata : measured) total += strata.area();
  std::vector<std::size_t> counts;
  double area = 0;
  std::size_t given = 0;
  for (const EqualAreaStrata& strata : measured) {
    area += strata.area();
    const auto up_to =
        static_cast<std::size_t>(std::llround(area / total * static_cast<double>(count)));
    counts.push_back(up_to - given);
    given = up_to;
  }
  return counts;
}

void resize_columns(SurfelCloud& cloud, std::size_t count, bool with_alpha) {
  cloud.position.resize(count);
  cloud.normal.resize(count);
  cloud.variance.resize(count);
  cloud.area.resize(count);
  cloud.color.resize(count);
  cloud.uv.resize(count);
  cloud.dpdu.resize(count);
  cloud.dpdv.resize(count);
  if (with_alpha) cloud.alpha.resize(count);
}

/// Fills the surfels [first, first + strata's count) of the cloud.
void sample_part(const SurfacePart& part, const EqualAreaStrata& strata,
                 const GenerateOptions& options, std::size_t first, SurfelCloud& cloud) {
  const std::size_t count = strata.first(strata.row_count());
  const double area = strata.area() / static_cast<double>(count);
  const auto variance = static_cast<float>(area * options.variance_scale * options.variance_scale);
  // Dimensions of the random numbers: 0 and 1 are a surfel's offsets, 2 turns a closed row, so
  // that the rows' first cells do not line up.
  parallel_for(strata.row_count(), 16, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t row = begin; row < end; ++row) {
      const std::vector<double> profile = strata.row_profile(row);
      const std::size_t row_first = strata.first(row);
      const auto cells = static_cast<double>(strata.first(row + 1) - row_first);
      const double turn =
          part.shape->closed_u() ? random_uniform(options.seed, first + row_first, 2) : 0;
      for (std::size_t cell = row_first; cell < strata.first(row + 1); ++cell) {
        const std::size_t i = first + cell;
        const double along_u =
            0.5 + options.jitter * (2 * random_uniform(options.seed, i, 0) - 1) + turn;
        const double along_v = 0.5 + options.jitter * (2 * random_uniform(options.seed, i, 1) - 1);
        const double share = (static_cast<double>(cell - row_first) + along_u) / cells;
        const double u = strata.u_at(profile, share - std::floor(share));
        const double v = strata.v_at(row, along_v);
        const ParametricSurface::Point point = part.shape->at(u, v);
        cloud.position[i] = point.position.cast<float>();
        cloud.normal[i] = point.normal.cast<float>();
        cloud.variance[i] = variance;
        cloud.area[i] = static_cast<float>(area);
        cloud.color[i] = part.color(u, v, point);
        cloud.uv[i] = Vec2d(u, v).cast<float>();
        cloud.dpdu[i] = point.dpdu.cast<float>();
        cloud.dpdv[i] = point.dpdv.cast<float>();
        if (!cloud.alpha.empty()) cloud.alpha[i] = part.alpha;
      }
    }
  });
}

/// Vertices and faces of one part, a grid of `n` x `n` cells, appended to the mesh.
void tessellate(const ParametricSurface& shape, std::size_t n, TriangleMesh& mesh) {
  const auto base = static_cast<std::uint32_t>(mesh.position.size());
  const auto vertex = [&](std::size_t i, std::size_t j) {
    if (shape.closed_u()) i %= n;
    if (shape.closed_v()) j %= n;
    if (shape.has_poles() && (j == 0 || j == n)) i = 0;
    return base + static_cast<std::uint32_t>(j * (n + 1) + i);
  };
  const auto scaled = [n](std::size_t i) {
    return static_cast<double>(i) / static_cast<double>(n);
  };
  // Every grid point gets a place; those that stand for another one are dropped in the end.
  const std::size_t vertices = (n + 1) * (n + 1);
  Array<Vec3f> normal(vertices);
  mesh.position.resize(base + vertices);
  parallel_for(n + 1, 16, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t j = begin; j < end; ++j) {
      for (std::size_t i = 0; i <= n; ++i) {
        const auto point = shape.at(scaled(i), scaled(j));
        mesh.position[base + j * (n + 1) + i] = point.position.cast<float>();
        normal[j * (n + 1) + i] = point.normal.cast<float>();
      }
    }
  });
  using Corner = std::array<std::size_t, 2>;
  const auto add_triangle = [&](const std::array<Corner, 3>& corners) {
    std::array<std::uint32_t, 3> face;
    std::array<Vec2f, 3> uv;
    std::array<Vec3f, 3> normals;
    for (int k = 0; k < 3; ++k) {
      const auto [i, j] = corners[k];
      face[k] = vertex(i, j);
      uv[k] = Vec2d(scaled(i), scaled(j)).cast<float>();
      normals[k] = normal[face[k] - base];
    }
    if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) return;
    mesh.face.push_back(face);
    mesh.wedge_uv.push_back(uv);
    mesh.wedge_normal.push_back(normals);
  };
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = 0; i < n; ++i) {
      add_triangle({Corner{i, j}, Corner{i + 1, j}, Corner{i + 1, j + 1}});
      add_triangle({Corner{i, j}, Corner{i + 1, j + 1}, Corner{i, j + 1}});
    }
  }
}

/// Drops the vertices that no face uses.
void drop_unused_vertices(TriangleMesh& mesh) {
  constexpr std::uint32_t kUnused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> renumbered(mesh.position.size(), kUnused);
  for (const auto& face : mesh.face) {
    for (const std::uint32_t v : face) renumbered[v] = 0;
  }
  std::uint32_t used = 0;
  for (std::size_t v = 0; v < renumbered.size(); ++v) {
    if (renumbered[v] == kUnused) continue;
    mesh.position[used] = mesh.position[v];
    renumbered[v] = used++;
  }
  mesh.position.resize(used);
  for (auto& face : mesh.face) {
    for (std::uint32_t& v : face) v = renumbered[v];
  }
}

}  // namespace

std::vector<std::string> GenerateOptions::problems() const {
  std::vector<std::string> found;
  if (count < 1 || count > std::numeric_limits<std::uint32_t>::max()) {
    found.push_back(fmt::format("count is {}; it must be 1 to 4294967295", count));
  }
  if (!(jitter >= 0 && jitter <= 0.5)) {
    found.push_back(fmt::format("jitter is {}; it must be 0 to 0.5 of the spacing", jitter));
  }
  if (!(variance_scale > 0 && std::isfinite(variance_scale))) {
    found.push_back(fmt::format("variance-scale is {}; it must be positive", variance_scale));
  }
  return found;
}

SurfelCloud generate_surfels(const ProceduralScene& scene, const GenerateOptions& options) {
  for (const std::string& problem : options.problems()) throw_usage(problem);
  if (options.count > available_memory_bytes() / kSurfelBytes) {
    throw_usage(fmt::format("{} surfels do not fit into this machine's memory; ask for fewer",
                            options.count));
  }
  std::vector<EqualAreaStrata> strata;
  for (const SurfacePart& part : scene.parts) {
    strata.emplace_back(*part.shape, scene.parts.size() == 1 ? options.count : 1);
  }
  const std::vector<std::size_t> counts = surfels_per_part(strata, options.count);

  SurfelCloud cloud;
  resize_columns(cloud, options.count, scene.transparent);
  std::size_t first = 0;
  for (std::size_t k = 0; k < scene.parts.size(); ++k) {
    if (counts[k] == 0) continue;
    if (scene.parts.size() > 1) strata[k] = EqualAreaStrata(*scene.parts[k].shape, counts[k]);
    sample_part(scene.parts[k], strata[k], options, first, cloud);
    first += counts[k];
  }
  return cloud;
}

TriangleMesh generate_mesh(const ProceduralScene& scene, int resolution,
                           const std::string& texture) {
  if (resolution < 3 || resolution > 16384) {
    throw_usage(fmt::format("resolution is {}; it must be 3 to 16384", resolution));
  }
  TriangleMesh mesh;
  for (const SurfacePart& part : scene.parts) {
    tessellate(*part.shape, static_cast<std::size_t>(resolution), mesh);
  }
  drop_unused_vertices(mesh);
  if (!texture.empty()) {
    mesh.material.push_back({"surface", Vec3f(1, 1, 1), texture});
    mesh.face_material.assign(mesh.face.size(), 0);
  }
  return mesh;
}

Image generate_texture(const ProceduralScene& scene, int width, int height) {
  const SurfacePart& part = scene.parts.front();
  return rasterize([&](double u, double v) { return part.color(u, v, part.shape->at(u, v)); },
                   width, height);
}

}  // namespace surfel
