#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/sample/mesh_clips.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/mesh_face.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/sample/poisson_disk.h>
#include <surfel/sample/sample_elimination.h>
#include <surfel/sample/smooth_normals.h>

namespace surfel {
namespace {

constexpr std::size_t kSampleGrain = 1 << 14;
/// PoissonDisk counts slots in 31 bits.
constexpr std::size_t kMostSamples = std::size_t{1} << 28;

/// Squares of lengths between these, and sums of a few such squares, are numbers of single
/// precision with all their digits.
constexpr double kLargestCoordinate = 1e18;
constexpr double kLeastSpacing = 1e-18;

/// Measures of the faces, for refusals and for the variances of small components.
struct FaceMeasures {
  std::vector<double> area;
  double total_area = 0;
  double total_edge = 0;  ///< Sum of the faces' longest edges.
  double largest_coordinate = 0;
  std::size_t degenerate = 0;
};

FaceMeasures measure(const TriangleMesh& mesh) {
  FaceMeasures m;
  m.area.resize(mesh.face.size());
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    const FaceCorners corner = face_corners(mesh, f);
    for (const Vec3d& p : corner) {
      m.largest_coordinate = std::max(m.largest_coordinate, p.cwiseAbs().maxCoeff());
    }
    m.area[f] = area_vector(corner).norm() / 2;
    m.degenerate += !(m.area[f] > 0);
    m.total_area += m.area[f];
    m.total_edge += longest_edge(corner);
  }
  return m;
}

/// Area of the mesh in units of the field's spacing squared, by quadrature.
double area_in_field(const TriangleMesh& mesh, const FaceMeasures& m, const SizingField& field) {
  if (field.least() == field.largest()) return m.total_area / (field.least() * field.least());
  constexpr double kMostParts = 64;  ///< Bounds the quadrature of a face to 2080 points.
  Array<double> in_field(mesh.face.size());
  parallel_each(in_field.size(), 1 << 8, [&](std::size_t f) {
    const FaceCorners corner = face_corners(mesh, f);
    const Vec3d middle = (corner[0] + corner[1] + corner[2]) / 3;
    const double parts = longest_edge(corner) / field.at(middle.cast<float>());
    const int n = static_cast<int>(std::clamp(std::ceil(parts), 1.0, kMostParts));
    double sum = 0;
    // Centroids of the upright ones of the n^2 equal triangles.
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        const Vec3d p = corner[0] + (i + 1 / 3.0) / n * (corner[1] - corner[0]) +
                        (j + 1 / 3.0) / n * (corner[2] - corner[0]);
        const double spacing = field.at(p.cast<float>());
        sum += 1 / (spacing * spacing);
      }
    }
    in_field[f] = m.area[f] * sum * 2 / (n * (n + 1));
  });
  double total = 0;
  for (const double a : in_field) total += a;
  return total;
}

/// Where more faces meet at an edge each is sampled by itself, as none goes on in another any more
/// than in all of them.
constexpr std::size_t kMostFacesAtEdge = 64;
/// Most chunks for each triangle and sample: memory stays in proportion to them, however long
/// triangles are that have hardly any area.
constexpr double kMostPieces = 20;
/// Where triangles are cut into more chunks than these, samples by elimination are tried first,
/// whose cost does not depend on the triangles' shape. Fewer chunks than kFewChunks take no time.
constexpr double kChunksPerFace = 2;
constexpr double kChunksPerSample = 1;
constexpr double kGradedChunksPerSample = 6;
constexpr double kFewChunks = 1 << 14;
/// For a spacing, samples by elimination are taken where they leave no more of the surface
/// uncovered: loose slivers, narrower than the spacing, need samples in proportion to their length.
constexpr double kMostUncovered = 0.03;
/// Where there are more samples than faces it is asked first, of a few places, whether as much as
/// this is sure to be uncovered: elimination would be in vain.
constexpr double kSurelyUncovered = 0.25;
/// Bytes of a sample and of a chunk, all tables of PoissonDisk and the cloud's columns together.
constexpr double kSampleBytes = 300;
constexpr double kChunkBytes = 150;

/// Samples of a mesh: by dart throwing, which has yet to tell their areas, or by elimination.
struct Sampled {
  std::unique_ptr<PoissonDisk> darts;
  Array<PoissonSample> eliminated;
  bool too_many = false;  ///< There are none, as elimination would have made too many.

  Array<PoissonSample> samples() { return darts ? darts->samples() : std::move(eliminated); }
};

/// Inputs of sampling, at whatever spacing. Spacings are in units of the field's.
struct Sampling {
  const TriangleMesh& mesh;
  const Array<std::uint32_t>& rings;
  const Array<std::uint32_t>& component;
  const FaceMeasures& faces;
  const SizingField& field;
  double area;  ///< Area in units of the field's spacing squared.
  std::uint64_t seed;
  const std::string& name;

  Sampled with_spacing(double& spacing, std::size_t most_eliminated) const;
  Sampled with_count(std::size_t count, double& spacing) const;

 private:
  /// Chunks that are made without further ado.
  double chunks_at_ease(double samples) const {
    const double per_sample = field.gradient() > 0 ? kGradedChunksPerSample : kChunksPerSample;
    return std::max(kFewChunks,
                    kChunksPerFace * static_cast<double>(faces.area.size()) + per_sample * samples);
  }
  void check_precision(double factor) const;
  void check_memory(double spacing, double samples, double bytes) const;
  double estimated_chunks(double factor) const;
  double pieces_per_input(double factor) const;
  void check_chunks(double factor) const;
  std::unique_ptr<PoissonDisk> dart_throwing(double spacing) const;
  std::unique_ptr<PoissonDisk> short_dart_throwing(double spacing) const;
  EliminatedSamples elimination(double spacing, std::size_t count) const;
};

/// Throws where the spacing is beyond the precision of the samples.
void Sampling::check_precision(double factor) const {
  const double spacing = factor * field.least();
  const double samples = area / (factor * factor);
  if (samples > static_cast<double>(kMostSamples)) {
    throw_input(name, fmt::format("a spacing of {:.3g} makes about {:.3g} samples, more than the "
                                  "{} that one run makes; ask for a larger spacing",
                                  spacing, samples, kMostSamples));
  }
  if (spacing < kLeastSpacing) {
    throw_input(name, fmt::format("a spacing of {:.3g} is below {:.0e}, the least that single "
                                  "precision can square; scale the mesh up",
                                  spacing, kLeastSpacing));
  }
  if (spacing < 32 * faces.largest_coordinate * std::numeric_limits<float>::epsilon()) {
    throw_input(name,
                fmt::format("a spacing of {:.3g} is below the precision of coordinates as large "
                            "as {:.3g}; ask for a larger spacing, or move the mesh to the origin",
                            spacing, faces.largest_coordinate));
  }
}

void Sampling::check_memory(double spacing, double samples, double bytes) const {
  if (bytes > static_cast<double>(available_memory_bytes())) {
    throw_input(name, fmt::format("a spacing of {:.3g} makes about {:.3g} samples, more than fit "
                                  "into memory; ask for a larger spacing",
                                  spacing, samples));
  }
}

/// Chunks of dart throwing, roughly.
double Sampling::estimated_chunks(double factor) const {
  // Chunks have edges of 2.5 to 5 spacings, of 1 to 2 where it varies; a face is one at least, a
  // sliver a row of them.
  const double chunks_per_sample = field.gradient() > 0 ? 2 : 0.4;
  return static_cast<double>(faces.area.size()) + area / (factor * factor) * chunks_per_sample +
         faces.total_edge / (1.25 * factor * field.largest());
}

double Sampling::pieces_per_input(double factor) const {
  return estimated_chunks(factor) /
         (static_cast<double>(faces.area.size()) + area / (factor * factor));
}

/// Throws where the chunks of dart throwing are beyond memory or proportion.
void Sampling::check_chunks(double factor) const {
  const double spacing = factor * field.least();
  const double samples = area / (factor * factor);
  const double pieces = pieces_per_input(factor);
  if (pieces > kMostPieces) {
    throw_input(name,
                fmt::format("its triangles are so long and thin that a spacing of {:.3g} cuts each "
                            "into {:.3g} pieces, more than {}; ask for a larger spacing or "
                            "for a count, or remesh it",
                            spacing, pieces, kMostPieces));
  }
  check_memory(spacing, samples, kSampleBytes * samples + kChunkBytes * estimated_chunks(factor));
}

std::unique_ptr<PoissonDisk> Sampling::dart_throwing(double spacing) const {
  check_chunks(spacing);
  return PoissonDisk::make(mesh, rings, field, spacing, seed,
                           std::numeric_limits<std::size_t>::max());
}

/// Dart throwing where it takes few chunks; null otherwise.
std::unique_ptr<PoissonDisk> Sampling::short_dart_throwing(double spacing) const {
  check_precision(spacing);
  if (pieces_per_input(spacing) > kMostPieces) return nullptr;
  const double samples = area / (spacing * spacing);
  const double chunks = chunks_at_ease(samples);
  check_memory(spacing * field.least(), samples, kSampleBytes * samples + kChunkBytes * chunks);
  return PoissonDisk::make(mesh, rings, field, spacing, seed, static_cast<std::size_t>(chunks));
}

EliminatedSamples Sampling::elimination(double spacing, std::size_t count) const {
  const auto samples = static_cast<double>(count);
  check_memory(spacing * field.least(), samples, kEliminationBytes * samples);
  return eliminate_samples(mesh, component, field, spacing, count, seed);
}

/// Sets the spacing where it makes too many samples.
Sampled Sampling::with_spacing(double& spacing, std::size_t most_eliminated) const {
  Sampled out;
  out.darts = short_dart_throwing(spacing);
  if (out.darts) return out;
  const double samples = std::max(1.0, std::round(area / (spacing * spacing)));
  const auto most = static_cast<double>(most_eliminated);
  if (samples > most) {
    spacing = std::sqrt(area / most);
    out.too_many = true;
    return out;
  }
  const bool in_vain = samples > static_cast<double>(faces.area.size()) &&
                       least_uncovered(mesh, field, spacing, seed) > kSurelyUncovered;
  if (!in_vain) {
    EliminatedSamples found = elimination(spacing, static_cast<std::size_t>(samples));
    if (found.uncovered <= kMostUncovered) {
      out.eliminated = std::move(found.sample);
      return out;
    }
  }
  out.darts = dart_throwing(spacing);
  return out;
}

/// Finds the spacing that gives slightly fewer samples than asked for, then fills up. Where that
/// takes many chunks, or leaves no room for as many samples, the samples come from elimination,
/// which keeps the count and its cost whatever the triangles' shapes are.
Sampled Sampling::with_count(std::size_t count, double& spacing) const {
  const auto wanted = static_cast<double>(count);
  constexpr int kTrials = 14;       ///< Halving alone finds the spacing to 1e-4 of itself.
  constexpr int kInterpolated = 6;  ///< Trials between which the number is taken for a power.
  // Bounds of the spacing: too fine for the count, and coarse enough; and what each made.
  double fine = 0, made_fine = 0;
  double coarse = std::numeric_limits<double>::infinity(), made_coarse = 0;
  Sampled out;
  const auto eliminate = [&] {
    out.darts.reset();
    spacing = std::sqrt(area / wanted);
    out.eliminated = elimination(spacing, count).sample;
    return std::move(out);
  };
  spacing = 1.01 * std::sqrt(area / wanted);
  for (int trial = 0; trial < kTrials; ++trial) {
    out.darts.reset();
    out.darts = short_dart_throwing(spacing);
    if (!out.darts) return eliminate();
    const auto made = static_cast<double>(out.darts->size());
    if (made <= wanted && made >= 0.97 * wanted - 1) break;
    (made > wanted ? fine : coarse) = spacing;
    (made > wanted ? made_fine : made_coarse) = made;
    double next = spacing * std::sqrt(made / (0.99 * wanted));
    if (fine > 0 && !std::isinf(coarse) && trial < kInterpolated) {
      // Crowded triangles have a number that follows no square of the spacing.
      const double share =
          portable::log(made_fine / (0.985 * wanted)) / portable::log(made_fine / made_coarse);
      next = fine * portable::exp(share * portable::log(coarse / fine));
    }
    if (!(next > fine && next < coarse)) {
      next = std::isinf(coarse) ? 2 * fine : (fine + coarse) / 2;
    }
    spacing = next;
  }
  if (static_cast<double>(out.darts->size()) > wanted && !std::isinf(coarse)) {
    spacing = coarse;
    out.darts.reset();
    out.darts = short_dart_throwing(spacing);
    if (!out.darts) return eliminate();
  }
  out.darts->fill(count);
  if (out.darts->size() != count) return eliminate();
  return out;
}

/// The mesh without some of its faces, in ascending order.
TriangleMesh without_faces(const TriangleMesh& mesh, const Array<std::uint32_t>& left_out) {
  TriangleMesh rest = mesh;
  const auto keep_others = [&](auto& column) {
    if (column.empty()) return;
    std::size_t kept = 0;
    auto next = left_out.begin();
    for (std::size_t f = 0; f < column.size(); ++f) {
      if (next != left_out.end() && *next == f) {
        ++next;
      } else {
        column[kept++] = column[f];
      }
    }
    column.resize(kept);
  };
  keep_others(rest.face);
  keep_others(rest.wedge_uv);
  keep_others(rest.wedge_normal);
  keep_others(rest.face_material);
  return rest;
}

/// Area of each component, by its lowest face. It is the largest variance that a component's
/// samples may have: a disc should not outgrow the component that it stands for.
std::vector<double> component_areas(const Array<std::uint32_t>& component,
                                    const std::vector<double>& face_area) {
  std::vector<double> area(component.size(), 0);
  for (std::size_t f = 0; f < component.size(); ++f) area[component[f]] += face_area[f];
  return area;
}

/// Barycentric coordinates of a point of the face's plane, clamped to the face.
Vec3d barycentric(const FaceCorners& corner, const Vec3d& p) {
  const Vec3d normal = area_vector(corner);
  Vec3d b;
  for (int k = 0; k < 3; ++k) {
    b[k] = std::max(
        0.0,
        (corner[(k + 2) % 3] - corner[(k + 1) % 3]).cross(p - corner[(k + 1) % 3]).dot(normal));
  }
  const double sum = b.sum();
  return sum > 0 ? Vec3d(b / sum) : Vec3d::Constant(1 / 3.0);
}

template <class T>
T interpolated(const std::array<T, 3>& corner, const Vec3d& b) {
  const Vec3f w = b.cast<float>();
  return w[0] * corner[0] + w[1] * corner[1] + w[2] * corner[2];
}

/// Fills the cloud's columns from the mesh at the samples.
class AttributeTransfer {
 public:
  AttributeTransfer(const TriangleMesh& mesh, const Array<std::array<Vec3f, 3>>& wedge_normal,
                    SurfelCloud& cloud)
      : mesh_(mesh), wedge_normal_(wedge_normal), cloud_(cloud) {
    const std::size_t n = cloud.size();
    cloud.normal.resize(n);
    if (!wedge_normal.empty()) cloud.shading_normal.resize(n);
    if (!mesh.wedge_uv.empty()) {
      cloud.uv.resize(n);
      cloud.dpdu.resize(n);
      cloud.dpdv.resize(n);
    }
    const auto some_material = [&](const auto& has) {
      return !mesh.face_material.empty() &&
             std::any_of(mesh.material.begin(), mesh.material.end(), has);
    };
    const bool untextured = some_material([](const auto& m) { return m.texture.empty(); });
    if (!mesh.color.empty() || untextured) cloud.color.resize(n);
    if (some_material([](const auto& m) { return m.opacity < 1; })) cloud.alpha.resize(n);
    if (mesh.material.size() > 1 && !mesh.face_material.empty()) cloud.material.resize(n);
  }

  void transfer(std::size_t i, std::uint32_t face) {
    const FaceCorners corner = face_corners(mesh_, face);
    const Vec3d b = barycentric(corner, cloud_.position[i].cast<double>());
    set_normals(i, face, corner, b);
    if (!cloud_.uv.empty()) {
      cloud_.uv[i] = interpolated(mesh_.wedge_uv[face], b);
      const UvFrame frame = uv_frame(corner, mesh_.wedge_uv[face]);
      cloud_.dpdu[i] = frame.dpdu.cast<float>();
      cloud_.dpdv[i] = frame.dpdv.cast<float>();
    }
    if (!cloud_.color.empty()) cloud_.color[i] = mesh_.color_at(face, b.cast<float>());
    if (!cloud_.material.empty()) cloud_.material[i] = mesh_.face_material[face];
    if (!cloud_.alpha.empty()) cloud_.alpha[i] = mesh_.material[mesh_.face_material[face]].opacity;
  }

 private:
  /// The disc lies in its face, as a disc across the smooth normal covers another area on screen
  /// than the surface there: at silhouettes, where one of them is seen edge-on, all of it. The
  /// smooth normal says which side is outside, and is there to shade with.
  void set_normals(std::size_t i, std::uint32_t face, const FaceCorners& corner, const Vec3d& b) {
    const Vec3f flat = area_vector(corner).normalized().cast<float>();
    cloud_.normal[i] = flat;
    if (wedge_normal_.empty()) return;
    const Vec3f smooth = interpolated(wedge_normal_[face], b);
    const float length = smooth.norm();
    // Where smooth normals cancel each other the face's normal is taken.
    const bool usable = length > 1e-3f;
    if (usable && smooth.dot(flat) < 0) cloud_.normal[i] = -flat;
    cloud_.shading_normal[i] = usable ? Vec3f(smooth / length) : flat;
  }

  const TriangleMesh& mesh_;
  const Array<std::array<Vec3f, 3>>& wedge_normal_;
  SurfelCloud& cloud_;
};

/// Drops shading normals that all are the discs' own.
void drop_plain_shading(SurfelCloud& cloud) {
  constexpr float kSame = 1e-4F;  // Of unit vectors, in single precision.
  const std::size_t bent = count_where(cloud.shading_normal.size(), [&](std::size_t i) {
    return (cloud.shading_normal[i] - cloud.normal[i]).squaredNorm() > kSame * kSame;
  });
  if (bent == 0) cloud.shading_normal = {};
}

/// Cuts surfels at the mesh's edges and adds the surfels that go on beyond.
class EdgeCutter {
 public:
  EdgeCutter(const MeshClips& clips, const Array<PoissonSample>& samples, SurfelCloud& cloud)
      : clips_(clips), samples_(samples), cloud_(cloud) {}

  void run(MeshSampleReport& report) {
    const std::size_t count = samples_.size();
    Array<MeshClips::Lines> lines(count);
    parallel_each(count, kSampleGrain, [&](std::size_t i) {
      const double reach = kClipReach * std::sqrt(cloud_.variance[i]);
      lines[i] = clips_.around(samples_[i].face, cloud_.position[i].cast<double>(),
                               cloud_.normal[i].cast<double>(), reach);
    });
    Array<std::uint32_t> order(count);
    std::iota(order.begin(), order.end(), 0U);
    std::vector<CutSurfel> own;  // Parallel to the samples that lines cut.
    std::vector<CutSurfel> images;
    for (std::uint32_t i = 0; i < count; ++i) {
      if (lines[i].count == 0) continue;
      ++report.clipped;
      const double deviation = std::sqrt(cloud_.variance[i]);
      const CutSurfel surfel{cloud_.position[i].cast<double>(), {0, 0, 0}, lines[i].line};
      std::vector<CutSurfel> parts;
      if (lines[i].either) {
        parts = within_either(surfel, deviation);
      } else {
        parts = mirror_images(surfel, {deviation, deviation});
        parts.insert(parts.begin(), surfel);
      }
      own.push_back(parts.front());
      images.insert(images.end(), parts.begin() + 1, parts.end());
      order.insert(order.end(), parts.size() - 1, i);
    }
    if (report.clipped == 0) return;
    if (!images.empty()) cloud_ = cloud_.gathered(order);
    report.clipped += images.size();
    report.mirrored = images.size();
    cloud_.clip1.assign(order.size(), Vec3f(0, 0, 0));
    cloud_.clip2 = cloud_.clip1;
    cloud_.clip1_distance.assign(order.size(), 0.0F);
    cloud_.clip2_distance = cloud_.clip1_distance;
    std::size_t cut = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if (lines[i].count > 0) put_cut_surfel(own[cut++], cloud_, i);
    }
    for (std::size_t k = 0; k < images.size(); ++k) put_cut_surfel(images[k], cloud_, count + k);
  }

 private:
  const MeshClips& clips_;
  const Array<PoissonSample>& samples_;
  SurfelCloud& cloud_;
};

void report_distances(const Array<PoissonSample>& samples, MeshSampleReport& report) {
  report.least_distance = std::numeric_limits<double>::infinity();
  double sum = 0;
  std::size_t with_neighbor = 0;
  for (const PoissonSample& sample : samples) {
    if (std::isinf(sample.nearest)) continue;
    report.least_distance = std::min<double>(report.least_distance, sample.nearest);
    sum += sample.nearest;
    ++with_neighbor;
  }
  report.mean_distance = with_neighbor > 0 ? sum / static_cast<double>(with_neighbor) : 0;
}

std::size_t count_flat_uv(const TriangleMesh& mesh) {
  std::size_t flat = 0;
  for (std::size_t f = 0; f < mesh.wedge_uv.size(); ++f) {
    flat += uv_frame(face_corners(mesh, f), mesh.wedge_uv[f]).dpdu.isZero(0);
  }
  return flat;
}

}  // namespace

std::vector<std::string> MeshSampleOptions::problems() const {
  std::vector<std::string> found;
  if (spacing.has_value() == count.has_value()) {
    found.emplace_back("either `spacing` or `count` must be given, and not both");
  }
  if (spacing) check_positive(found, "spacing", *spacing);
  if (count) {
    check_option(found, *count >= 1 && *count <= kMostSamples, "count", *count,
                 fmt::format("1 to {}", kMostSamples));
  }
  check_positive(found, "variance_scale", variance_scale);
  if (!(crease_angle >= 0 && crease_angle <= std::numbers::pi)) {
    found.emplace_back("`crease_angle` must be 0 to 180 degrees");
  }
  return found;
}

void require_sampleable(const TriangleMesh& mesh, const std::string& name) {
  for (std::size_t v = 0; v < mesh.position.size(); ++v) {
    const float largest = mesh.position[v].cwiseAbs().maxCoeff();
    if (largest <= kLargestCoordinate) continue;
    throw_input(name, fmt::format("vertex {} has a coordinate as large as {:.3g}; meshes with "
                                  "coordinates up to {:.0e} are taken, scale the mesh down",
                                  v, largest, kLargestCoordinate));
  }
}

ColorLight color_light(const TriangleMesh& mesh) {
  if (mesh.material.empty()) return ColorLight::kReflectance;
  std::size_t unlit = 0;
  for (const std::uint16_t material : mesh.face_material) unlit += mesh.material[material].unlit;
  if (unlit == 0) return ColorLight::kReflectance;
  return unlit == mesh.face.size() ? ColorLight::kRecorded : ColorLight::kMixed;
}

SurfelCloud sample_mesh(const TriangleMesh& whole, const MeshSampleOptions& options,
                        MeshSampleReport* report, const std::string& name) {
  require_usable(options);
  MeshSampleReport unused;
  MeshSampleReport& out = report ? *report : unused;
  out = {};
  StageTimer stage(out.times);

  whole.check_columns(name);
  if (!whole.material.empty()) whole.check_materials(name);
  require_sampleable(whole, name);
  Array<std::array<std::uint32_t, 3>> welded = welded_faces(whole);
  const Array<std::uint32_t> repeated = repeated_faces(welded);
  std::optional<TriangleMesh> once;
  if (!repeated.empty()) {
    once = without_faces(whole, repeated);
    welded = welded_faces(*once);
  }
  const TriangleMesh& mesh = once ? *once : whole;
  const FaceMeasures faces = measure(mesh);
  if (!(faces.total_area > 0)) {
    throw_input(name, fmt::format("the mesh has no area ({} faces); there is nothing to sample",
                                  whole.face.size() + mesh.degenerate_faces));
  }
  Array<std::uint32_t> rings = edge_rings(welded);
  welded = {};
  const Array<std::uint32_t> component = face_components(rings);
  out.edges = count_edges(mesh, rings);
  cut_crowded_edges(rings, kMostFacesAtEdge);
  stage.end("topology");

  const SizingField uniform(1);
  const SizingField& field = options.field ? *options.field : uniform;
  const double area = area_in_field(mesh, faces, field);
  std::optional<MeshClips> clips;
  Array<std::uint32_t> cut;
  if (options.clip) {
    clips.emplace(mesh, rings, options.crease_angle);
    const double factor =
        options.spacing.value_or(std::sqrt(area / static_cast<double>(options.count.value_or(1))));
    const double reach = kClipReach * options.variance_scale * factor;
    cut = clips->cut_creases(mesh, rings,
                             [&](const Vec3d& p) { return reach * field.at(p.cast<float>()); });
  }
  const Sampling sampling{mesh, clips ? cut : rings, component, faces, field,
                          area, options.seed,        name};
  out.spacing = options.spacing.value_or(0);
  Sampled sampled = options.count ? sampling.with_count(*options.count, out.spacing)
                                  : sampling.with_spacing(out.spacing, options.most_eliminated);
  stage.end("sample");
  if (sampled.too_many) return {};
  out.eliminated = !sampled.darts;
  const Array<PoissonSample> samples = sampled.samples();
  sampled.darts.reset();
  stage.end("areas");

  SurfelCloud cloud;
  cloud.origin = mesh.origin;
  cloud.color_light = color_light(mesh);
  cloud.up = mesh.up;
  cloud.position.resize(samples.size());
  cloud.area.resize(samples.size());
  cloud.variance.resize(samples.size());
  const std::vector<double> component_area = component_areas(component, faces.area);
  Array<std::array<Vec3f, 3>> computed;
  if (!options.flat && mesh.wedge_normal.empty()) {
    computed = smooth_normals(mesh, options.crease_angle);
  }
  const bool from_file = !options.flat && !mesh.wedge_normal.empty();
  AttributeTransfer attributes(mesh, from_file ? mesh.wedge_normal : computed, cloud);
  // The samples' areas were measured on chunks with rounded corners, which shows in slivers.
  double sampled_area = 0;
  for (const PoissonSample& sample : samples) sampled_area += sample.area;
  const double to_exact = faces.total_area / sampled_area;
  const double scale2 = options.variance_scale * options.variance_scale;
  parallel_each(samples.size(), kSampleGrain, [&](std::size_t i) {
    const PoissonSample& sample = samples[i];
    const double spacing = out.spacing * sample.size;
    const double cell = spacing * spacing;
    cloud.position[i] = sample.position;
    cloud.area[i] = static_cast<float>(to_exact * sample.area);
    cloud.variance[i] =
        static_cast<float>(scale2 * std::min(cell, component_area[component[sample.face]]));
    attributes.transfer(i, sample.face);
  });
  drop_plain_shading(cloud);
  stage.end("attributes");
  if (clips) {
    if (!clips->empty()) EdgeCutter(*clips, samples, cloud).run(out);
    stage.end("edges");
  }

  if (options.field)
    out.spacing = std::sqrt(faces.total_area / static_cast<double>(samples.size()));
  out.faces = whole.face.size();
  out.repeated_faces = repeated.size();
  out.degenerate_faces = mesh.degenerate_faces + faces.degenerate;
  out.flat_uv_faces = count_flat_uv(mesh);
  for (std::size_t f = 0; f < component.size(); ++f) out.components += component[f] == f;
  out.area = faces.total_area;
  report_distances(samples, out);
  return cloud;
}

}  // namespace surfel
