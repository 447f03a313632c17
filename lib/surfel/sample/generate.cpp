#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
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

void resize_columns(SurfelCloud& cloud, std::size_t count, bool with_uv, bool with_alpha) {
  cloud.position.resize(count);
  cloud.normal.resize(count);
  cloud.variance.resize(count);
  cloud.area.resize(count);
  cloud.color.resize(count);
  cloud.color_light = ColorLight::kReflectance;
  if (with_uv) {
    cloud.uv.resize(count);
    cloud.dpdu.resize(count);
    cloud.dpdv.resize(count);
  }
  if (with_alpha) cloud.alpha.resize(count);
}

/// The surfels of one part of a scene.
class PartSampler {
 public:
  /// `first` is the index of its first surfel in the scene.
  PartSampler(const SurfacePart& part, EqualAreaStrata strata, const GenerateOptions& options,
              std::size_t first)
      : part_(part), strata_(std::move(strata)), options_(options), first_(first) {
    const double area = strata_.area() / static_cast<double>(strata_.first(row_count()));
    area_ = static_cast<float>(area);
    variance_ = static_cast<float>(area * options.variance_scale * options.variance_scale);
  }

  std::size_t row_count() const { return strata_.row_count(); }
  std::size_t cells(std::size_t row) const { return strata_.first(row + 1) - strata_.first(row); }
  /// Index in the scene of a row's first surfel.
  std::size_t first(std::size_t row) const { return first_ + strata_.first(row); }
  std::vector<double> profile(std::size_t row) const { return strata_.row_profile(row); }

  /// Parameters of a cell's surfel; `row_profile` is profile(row). Dimensions of the random
  /// numbers: 0 and 1 are a surfel's offsets, 2 turns a closed row, so that the rows' first cells
  /// do not line up.
  Vec2d uv(std::size_t row, std::size_t cell, const std::vector<double>& row_profile) const {
    const double turn = part_.shape->closed_u() ? random_uniform(options_.seed, first(row), 2) : 0;
    const std::size_t i = first(row) + cell;
    const double along_u =
        0.5 + options_.jitter * (2 * random_uniform(options_.seed, i, 0) - 1) + turn;
    const double along_v = 0.5 + options_.jitter * (2 * random_uniform(options_.seed, i, 1) - 1);
    const double share = (static_cast<double>(cell) + along_u) / static_cast<double>(cells(row));
    return {strata_.u_at(row_profile, share - std::floor(share)), strata_.v_at(row, along_v)};
  }
  ParametricSurface::Point at(const Vec2d& uv) const { return part_.shape->at(uv[0], uv[1]); }

  /// Fills surfel i of the cloud.
  void store(const Vec2d& uv, const ParametricSurface::Point& point, SurfelCloud& cloud,
             std::size_t i) const {
    cloud.position[i] = point.position.cast<float>();
    cloud.normal[i] = point.normal.cast<float>();
    cloud.variance[i] = variance_;
    cloud.area[i] = area_;
    cloud.color[i] = part_.color(uv[0], uv[1], point);
    if (!cloud.uv.empty()) {
      cloud.uv[i] = uv.cast<float>();
      cloud.dpdu[i] = point.dpdu.cast<float>();
      cloud.dpdv[i] = point.dpdv.cast<float>();
    }
    if (!cloud.alpha.empty()) cloud.alpha[i] = part_.alpha;
  }

 private:
  const SurfacePart& part_;
  EqualAreaStrata strata_;
  const GenerateOptions& options_;
  std::size_t first_;
  float area_;
  float variance_;
};

/// The parts that get any surfels.
std::vector<PartSampler> make_samplers(const ProceduralScene& scene,
                                       const GenerateOptions& options) {
  require_usable(options);
  std::vector<EqualAreaStrata> strata;
  for (const SurfacePart& part : scene.parts) {
    strata.emplace_back(*part.shape, scene.parts.size() == 1 ? options.count : 1);
  }
  const std::vector<std::size_t> counts = surfels_per_part(strata, options.count);
  std::vector<PartSampler> samplers;
  std::size_t first = 0;
  for (std::size_t k = 0; k < scene.parts.size(); ++k) {
    if (counts[k] == 0) continue;
    if (scene.parts.size() > 1) strata[k] = EqualAreaStrata(*scene.parts[k].shape, counts[k]);
    samplers.emplace_back(scene.parts[k], std::move(strata[k]), options, first);
    first += counts[k];
  }
  return samplers;
}

constexpr std::size_t kRowGrain = 16;

/// Consecutive cells of a row, with bounds of their positions.
struct Segment {
  /// Cells of a segment, which takes 48 bytes: a tenth of a byte a surfel.
  static constexpr std::size_t kCells = 512;
  const PartSampler* part;
  std::uint32_t row;
  std::uint32_t begin;  ///< First cell; kCells of them, or up to the row's end.
  Vec3f min{0, 0, 0};
  Vec3f max{0, 0, 0};
  std::uint64_t first_code = 0;  ///< Bounds of their Morton codes.
  std::uint64_t last_code = 0;

  std::size_t end() const { return std::min(begin + kCells, part->cells(row)); }
};

/// All cells, a row's segments one after the other.
std::vector<Segment> measure_segments(const std::vector<PartSampler>& parts) {
  std::vector<Segment> segments;
  for (const PartSampler& part : parts) {
    for (std::size_t row = 0; row < part.row_count(); ++row) {
      for (std::size_t cell = 0; cell < part.cells(row); cell += Segment::kCells) {
        segments.push_back({.part = &part,
                            .row = static_cast<std::uint32_t>(row),
                            .begin = static_cast<std::uint32_t>(cell)});
      }
    }
  }
  parallel_for(segments.size(), 64, [&](std::size_t begin, std::size_t end, int) {
    std::vector<double> profile;
    for (std::size_t s = begin; s < end; ++s) {
      Segment& segment = segments[s];
      if (s == begin || segment.begin == 0) profile = segment.part->profile(segment.row);
      segment.min = Vec3f::Constant(std::numeric_limits<float>::infinity());
      segment.max = -segment.min;
      for (std::size_t cell = segment.begin; cell < segment.end(); ++cell) {
        const Vec3f p =
            segment.part->at(segment.part->uv(segment.row, cell, profile)).position.cast<float>();
        segment.min = segment.min.cwiseMin(p);
        segment.max = segment.max.cwiseMax(p);
      }
    }
  });
  return segments;
}

/// Codes that part the curve in stretches of about `piece` surfels: the first code of each stretch
/// but the first.
std::vector<std::uint64_t> cut_curve(const std::vector<Segment>& segments, const MortonGrid& grid,
                                     std::size_t piece) {
  std::vector<std::pair<std::uint64_t, std::size_t>> middle;  // Code, surfels.
  for (const Segment& s : segments) {
    middle.emplace_back(grid.code((s.min + s.max) / 2), s.end() - s.begin);
  }
  std::sort(middle.begin(), middle.end());
  std::vector<std::uint64_t> cuts;
  std::size_t surfels = 0;
  for (const auto& [code, count] : middle) {
    surfels += count;
    if (surfels < piece) continue;
    surfels = 0;
    if (cuts.empty() || cuts.back() < code) cuts.push_back(code);
  }
  return cuts;
}

/// A surfel of a stretch of the curve.
struct Sample {
  const PartSampler* part;
  Vec2d uv;
  ParametricSurface::Point point;
};

/// The surfels with codes in [first_code, last_code], in the order of the segments.
std::vector<Sample> samples_between(const std::vector<Segment>& segments, const MortonGrid& grid,
                                    std::uint64_t first_code, std::uint64_t last_code) {
  std::vector<const Segment*> candidates;
  for (const Segment& s : segments) {
    if (s.last_code >= first_code && s.first_code <= last_code) candidates.push_back(&s);
  }
  constexpr std::size_t kGrain = 16;
  std::vector<std::vector<Sample>> found(candidates.size() / kGrain + 1);
  parallel_for(candidates.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<double> profile;
    for (std::size_t s = begin; s < end; ++s) {
      const Segment& segment = *candidates[s];
      const bool same_row = s > begin && candidates[s - 1]->part == segment.part &&
                            candidates[s - 1]->row == segment.row;
      if (!same_row) profile = segment.part->profile(segment.row);
      for (std::size_t cell = segment.begin; cell < segment.end(); ++cell) {
        const Vec2d uv = segment.part->uv(segment.row, cell, profile);
        const ParametricSurface::Point point = segment.part->at(uv);
        const std::uint64_t code = grid.code(point.position.cast<float>());
        if (code < first_code || code > last_code) continue;
        found[begin / kGrain].push_back({segment.part, uv, point});
      }
    }
  });
  std::vector<Sample> all;
  for (std::vector<Sample>& part : found) {
    all.insert(all.end(), part.begin(), part.end());
    part = {};
  }
  return all;
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
  // Every grid point gets a vertex; vertices that another one stands for are dropped in the end.
  const std::size_t vertices = (n + 1) * (n + 1);
  Array<Vec3f> normal(vertices);
  mesh.position.resize(base + vertices);
  parallel_each(n + 1, 16, [&](std::size_t j) {
    for (std::size_t i = 0; i <= n; ++i) {
      const auto point = shape.at(scaled(i), scaled(j));
      mesh.position[base + j * (n + 1) + i] = point.position.cast<float>();
      normal[j * (n + 1) + i] = point.normal.cast<float>();
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
  check_option(found, count >= 1 && count <= std::numeric_limits<std::uint32_t>::max(), "count",
               count, "1 to 4294967295");
  check_option(found, jitter >= 0 && jitter <= 0.5, "jitter", jitter, "0 to 0.5 of the spacing");
  check_positive(found, "variance_scale", variance_scale);
  return found;
}

SurfelCloud generate_surfels(const ProceduralScene& scene, const GenerateOptions& options) {
  if (options.count > available_memory_bytes() / kSurfelBytes) {
    throw_usage(fmt::format("{} surfels do not fit into this machine's memory; ask for fewer",
                            options.count));
  }
  const std::vector<PartSampler> parts = make_samplers(scene, options);
  SurfelCloud cloud;
  resize_columns(cloud, options.count, options.uv, scene.transparent);
  for (const PartSampler& part : parts) {
    parallel_each(part.row_count(), kRowGrain, [&](std::size_t row) {
      const std::vector<double> profile = part.profile(row);
      for (std::size_t cell = 0; cell < part.cells(row); ++cell) {
        const Vec2d uv = part.uv(row, cell, profile);
        part.store(uv, part.at(uv), cloud, part.first(row) + cell);
      }
    });
  }
  return cloud;
}

void generate_surfels_in_order(const ProceduralScene& scene, const GenerateOptions& options,
                               std::size_t piece, FunctionRef<void(SurfelCloud&& piece)> consume) {
  const std::vector<PartSampler> parts = make_samplers(scene, options);
  std::vector<Segment> segments = measure_segments(parts);
  Vec3f min = segments.front().min;
  Vec3f max = segments.front().max;
  for (const Segment& segment : segments) {
    min = min.cwiseMin(segment.min);
    max = max.cwiseMax(segment.max);
  }
  const MortonGrid grid(min, max);
  for (Segment& segment : segments) {
    // Codes grow with each coordinate.
    segment.first_code = grid.code(segment.min);
    segment.last_code = grid.code(segment.max);
  }
  const std::vector<std::uint64_t> cuts = cut_curve(segments, grid, piece);
  for (std::size_t k = 0; k <= cuts.size(); ++k) {
    const std::uint64_t first_code = k == 0 ? 0 : cuts[k - 1];
    const std::uint64_t last_code =
        k == cuts.size() ? std::numeric_limits<std::uint64_t>::max() : cuts[k] - 1;
    const std::vector<Sample> samples = samples_between(segments, grid, first_code, last_code);
    if (samples.empty()) continue;
    Array<Vec3f> position(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      position[i] = samples[i].point.position.cast<float>();
    }
    const Array<std::uint32_t> order = morton_order(position, grid);
    SurfelCloud cloud;
    resize_columns(cloud, samples.size(), options.uv, scene.transparent);
    parallel_each(order.size(), 4096, [&](std::size_t i) {
      const Sample& sample = samples[order[i]];
      sample.part->store(sample.uv, sample.point, cloud, i);
    });
    consume(std::move(cloud));
  }
}

TriangleMesh generate_mesh(const ProceduralScene& scene, int resolution,
                           const std::string& texture) {
  if (resolution < 3 || resolution > 16384) {
    throw_usage(fmt::format("`resolution` is {}; it must be 3 to 16384", resolution));
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
