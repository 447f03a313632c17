#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/estimate/estimate.h>
#include <surfel/intake/intake.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/input_file.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/ply.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/join.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/texture/normal_fit.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_source.h>

namespace surfel {
namespace {

/// Most samples of a mesh, roughly.
constexpr double kMostSamples = 1 << 23;
/// Up to here all points are estimated, which takes a few seconds.
constexpr std::size_t kFewPoints = 1 << 20;
/// Edge of the cells in which more points are averaged, in spacings of a mesh's samples: splats
/// reach over gaps that are as wide as a cell.
constexpr double kCellSpacings = 0.5;
/// Most samples of a mesh in units of what the surface of the box around it would have. Scans and
/// parts have about one; triangles that fill space, one behind the other, have any number. The more
/// of them there are the more are hidden, and the fewer samples are needed, down to kLeastOfBox.
constexpr double kMostOfBox = 4;
constexpr double kLeastOfBox = 1;
/// Largest area of a mesh in units of the surface of the box around it. Samples of more are further
/// apart than eight pixels, where they were to be half a pixel apart.
constexpr double kLargestOfBox = 256;
/// As kMostOfBox, of samples by elimination, each of which takes several times the time and memory
/// of others.
constexpr double kMostEliminatedOfBox = 0.25;

/// TextureFitOptions::prefilter of samples that are `spacing` pixels apart: kernels of variance V
/// that end at a cutoff are narrower than the pixel filter h, by which the texture itself is
/// filtered then so that both together have h^2. Within 0.5, which is sharper where the surfels are
/// coarse or magnified, and 4.
double prefilter_for(double spacing, const IntakeOptions& options) {
  const double lost = portable::exp(-options.cutoff);
  // The share of a kernel's variance that lies within the cutoff.
  const double kept = 1 - options.cutoff * lost / (1 - lost);
  const double filter = portable::squared(options.lowpass);
  const double own = portable::squared(MeshSampleOptions{}.variance_scale * spacing);
  return std::clamp((filter - kept * (filter + own)) / own, 0.5, 4.0);
}

double area_of(const TriangleMesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.face) {
    const Vec3d origin = mesh.position[a].cast<double>();
    const Vec3d u = mesh.position[b].cast<double>() - origin;
    const Vec3d v = mesh.position[c].cast<double>() - origin;
    area += u.cross(v).norm() / 2;
  }
  return area;
}

/// Bounds of the points without the outermost hundredth on each side, told from some of them.
Bounds inner_bounds(const SurfelCloud& cloud) {
  constexpr std::size_t kLooks = 1 << 16;
  const std::size_t step = cloud.size() / kLooks + 1;
  Bounds box;
  std::vector<float> values;
  for (int axis = 0; axis < 3; ++axis) {
    values.clear();
    for (std::size_t i = 0; i < cloud.size(); i += step) {
      if (cloud.position[i].allFinite()) values.push_back(cloud.position[i][axis]);
    }
    if (values.empty()) return {};
    const auto outer = static_cast<std::ptrdiff_t>(values.size() / 100);
    std::nth_element(values.begin(), values.begin() + outer, values.end());
    box.min[axis] = static_cast<double>(values[static_cast<std::size_t>(outer)]);
    std::nth_element(values.begin(), values.end() - 1 - outer, values.end());
    box.max[axis] = static_cast<double>(*(values.end() - 1 - outer));
  }
  box.min += cloud.origin;
  box.max += cloud.origin;
  return box;
}

double surface_of(const Bounds& box) {
  const Vec3d side = box.max - box.min;
  return 2 * (side.x() * side.y() + side.y() * side.z() + side.z() * side.x());
}

/// A number as commands say it.
std::string three_digits(double value) { return fmt::format("{:.3g}", value); }

double number_of(const std::string& digits) {
  double value = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return value;
}

/// The name of a file or folder, without the folder that it is in and without extension, with
/// another end.
std::string named_after(std::string path, const std::string& end) {
  while (path.size() > 1 && path.ends_with('/')) path.pop_back();
  const std::size_t name = path.rfind('/') + 1;
  const std::size_t dot = path.rfind('.');
  const bool extension = dot != std::string::npos && dot > name;
  return path.substr(name, extension ? dot - name : std::string::npos) + end;
}

bool names_images(const TriangleMesh& mesh) {
  return std::any_of(mesh.material.begin(), mesh.material.end(),
                     [](const MeshMaterial& m) { return !m.texture.empty(); });
}

bool has_texture(const TriangleMesh& mesh) { return !mesh.wedge_uv.empty() && names_images(mesh); }

/// What a mesh has of a texture although it does not get one.
const char* missing_texture(const TriangleMesh& mesh, bool textured) {
  if (mesh.wedge_uv.empty() && names_images(mesh)) {
    return ", without the images of its materials, as it has no texture coordinates";
  }
  const bool bare = !textured && !mesh.wedge_uv.empty() && mesh.color.empty();
  return bare ? ", without a texture, as it names no image for its texture coordinates" : "";
}

/// The side that estimating takes for a cloud's normals.
Orientation side_of(const SurfelCloud& points) {
  if (points.viewpoint || !points.sensors().empty()) return Orientation::kViewpoint;
  // Some programs write normals that are all zero.
  const bool known =
      std::any_of(points.normal.begin(), points.normal.end(),
                  [](const Vec3f& normal) { return normal.allFinite() && !normal.isZero(0); });
  return known ? Orientation::kAlign : OrientationOptions().method;
}

/// The name of the surfels that are made of a file.
std::string surfels_of(const std::string& path) { return named_after(path, "-surfels.ply"); }

/// The options that ask for the same part of a file, each after a blank.
std::string part_words(const CloudReadOptions& part) {
  std::string words;
  if (!part.columns.empty()) words += fmt::format(" --columns={}", fmt::join(part.columns, ","));
  if (part.level) words += fmt::format(" --level={}", *part.level);
  if (part.bounds) {
    words += fmt::format(" --bounds={},{}", fmt::join(part.bounds->min, ","),
                         fmt::join(part.bounds->max, ","));
  }
  if (part.every > 1) words += fmt::format(" --every={}", part.every);
  return words;
}

/// The options of surfel-texture that ask for the same, each after a blank.
std::string texture_words(const IntakeOptions& options, const std::string& prefilter) {
  std::string words = " --prefilter=" + prefilter;
  const auto add = [&](const std::string& option, const std::string& value) {
    if (!value.empty()) words += fmt::format(" --{}={}", option, shell_quoted(value));
  };
  add("image", options.image);
  if (options.wrap == WrapMode::kRepeat) add("wrap", "repeat");
  if (options.wrap == WrapMode::kMirror) add("wrap", "mirror");
  if (options.wrap == WrapMode::kClamp) add("wrap", "clamp");
  add("normal-map", options.relief.normal_map);
  add("bump", options.relief.bump);
  if (options.relief.bump_scale) add("bump-scale", fmt::format("{}", *options.relief.bump_scale));
  if (options.relief.y_down) add("normal-y", "down");
  if (options.no_relief) words += " --no-normal-maps";
  return words;
}

/// The relief of a mesh, where it has one.
std::optional<NormalMaps> relief_of(const TriangleMesh& mesh, const IntakeOptions& options,
                                    const std::string& path) {
  if (options.relief.empty() && (options.no_relief || mesh.wedge_uv.empty())) return std::nullopt;
  NormalMapOptions chosen = options.relief;
  chosen.wrap = options.wrap;
  chosen.charts = true;
  NormalMaps maps = load_normal_maps(chosen, &mesh, path);
  if (maps.empty()) return std::nullopt;
  return maps;
}

}  // namespace

bool holds_surfels(const std::string& path) {
  if (file_kind(path) != FileKind::kCloud) return false;
  InputFile input(path);
  if (!PlyFile::matches(input.head(4))) return false;
  const PlyFile ply(std::move(input));
  const PlyElement* const vertex = ply.header().find("vertex");
  return vertex && std::any_of(vertex->properties.begin(), vertex->properties.end(),
                               [](const PlyProperty& property) {
                                 return property.name == "variance" ||
                                        property.name == "variance_u" || property.name == "radius";
                               });
}

std::string estimate_command(const SurfelCloud& points, const std::string& path,
                             const CloudReadOptions& part, const std::string& voxel) {
  const Orientation side = side_of(points);
  return fmt::format("surfel-estimate {}{}{}{} -o {}", shell_file(path), part_words(part),
                     voxel.empty() ? "" : " --voxel " + voxel,
                     side == Orientation::kViewpoint ? " --orient viewpoint"
                     : side == Orientation::kAlign   ? " --orient align"
                                                     : "",
                     shell_file(surfels_of(path)));
}

std::string picture_command(const std::string& path) {
  return fmt::format("surfel-render {} -o {}", shell_file(path),
                     shell_file(path == "-" ? "picture.png" : named_after(path, "-picture.png")));
}

/// Which maps the meshes have.
struct Intake::ReliefKinds {
  bool normals = false;
  bool heights = false;
};

struct Intake::File {
  std::string path;
  std::optional<TriangleMesh> mesh;
  SurfelCloud cloud;  ///< Where the file is no mesh.

  Bounds bounds() const;
  void sample(double spacing, const IntakeOptions& options, Made& made, ReliefKinds& kinds);
  bool texture(const IntakeOptions& options, double prefilter, ReliefKinds& kinds);
  void estimate(double spacing, const CloudReadOptions& part, Made& made);
};

Bounds Intake::File::bounds() const {
  if (!mesh) return inner_bounds(cloud);
  Bounds box;
  for (const auto& face : mesh->face) {
    for (const std::uint32_t vertex : face) {
      box.add(mesh->origin + mesh->position[vertex].cast<double>());
    }
  }
  return box;
}

/// Gives surfels of the mesh its images and its relief. False where it has neither.
bool Intake::File::texture(const IntakeOptions& options, double prefilter, ReliefKinds& kinds) {
  std::optional<NormalMaps> relief = relief_of(*mesh, options, path);
  if (!options.image.empty() || has_texture(*mesh) || (relief && !mesh->material.empty())) {
    TextureSet textures =
        load_textures({.image = options.image, .wrap = options.wrap, .whole = false}, &*mesh, path);
    fit_texture(cloud, textures, {.prefilter = prefilter}, path);
    show_coefficients(cloud);
  } else if (!relief) {
    return false;
  }
  if (relief) {
    for (const ReliefKind kind : relief->kind) {
      kinds.normals = kinds.normals || kind == ReliefKind::kNormals;
      kinds.heights = kinds.heights || kind == ReliefKind::kHeights;
    }
    fit_normals(cloud, *relief, {}, path);
  }
  return true;
}

/// Makes surfels of the mesh.
void Intake::File::sample(double spacing, const IntakeOptions& options, Made& made,
                          ReliefKinds& kinds) {
  for (const std::string& note : mesh->notes) made.warnings.push_back(path + ": " + note);
  for (std::string& missing : leave_out_missing_images(*mesh, path, options.image)) {
    made.warnings.push_back(std::move(missing));
  }
  const double area = area_of(*mesh);
  const double box_area = surface_of(bounds());
  const double of_box = area / box_area;
  if (of_box > kLargestOfBox) {
    throw_input(path, fmt::format("its triangles have {:.3g} times the area of the box around "
                                  "them, more than {}, and hide each other; remove those that "
                                  "nobody sees, or make surfels of them with surfel-from-mesh",
                                  of_box, kLargestOfBox));
  }
  std::string why =
      of_box > kMostOfBox
          ? fmt::format(" as its triangles have {:.3g} times the area of the box around them",
                        of_box)
          : "";
  const double most_of_box = std::clamp(kMostOfBox * kMostOfBox / of_box, kLeastOfBox, kMostOfBox);
  std::string digits = three_digits(std::max(
      {spacing, spacing * std::sqrt(of_box / most_of_box), std::sqrt(area / kMostSamples)}));
  MeshSampleOptions samples;
  samples.spacing = number_of(digits);
  samples.most_eliminated = static_cast<std::size_t>(
      std::max(1.0, kMostEliminatedOfBox * box_area / (spacing * spacing)));
  MeshSampleReport report;
  cloud = sample_mesh(*mesh, samples, &report, path);
  if (cloud.empty()) {
    why = " as its triangles are long and thin";
    digits = three_digits(report.spacing);
    samples.spacing = number_of(digits);
    samples.most_eliminated = MeshSampleOptions{}.most_eliminated;
    cloud = sample_mesh(*mesh, samples, &report, path);
  }
  made.file = surfels_of(path);
  std::vector<std::string> commands{fmt::format("surfel-from-mesh {} --spacing {} -o {}",
                                                shell_file(path), digits, shell_file(made.file))};
  const std::string prefilter = fmt::format(
      "{:.2g}", prefilter_for(*samples.spacing / spacing / 2 / options.nearest, options));
  const bool textured = texture(options, number_of(prefilter), kinds);
  made.textured = made.textured || textured;
  if (textured) {
    const std::string surfels = std::exchange(made.file, named_after(path, "-textured.ply"));
    commands.push_back(fmt::format("surfel-texture {} --mesh {}{} -o {}", shell_file(surfels),
                                   shell_file(path), texture_words(options, prefilter),
                                   shell_file(made.file)));
  }
  made.done.push_back(fmt::format("{}: a mesh, sampled every {}{}{}{}: {} surfels ({})", path,
                                  digits, why, textured ? " and textured" : "",
                                  missing_texture(*mesh, textured), cloud.size(),
                                  fmt::join(commands, "; ")));
  made.commands.insert(made.commands.end(), commands.begin(), commands.end());
  mesh.reset();
}

/// Makes surfels of raw points.
void Intake::File::estimate(double spacing, const CloudReadOptions& part, Made& made) {
  EstimateOptions options;
  std::string voxel;
  const double edge = kCellSpacings * spacing;
  if (cloud.size() > kFewPoints && voxels_are_countable(cloud.bounds(), edge)) {
    voxel = three_digits(edge);
    options.voxels.emplace().edge = number_of(voxel);
  }
  options.orientation.method = side_of(cloud);
  if (cloud.viewpoint) options.normals.sensor = cloud.viewpoint->position;
  made.file = surfels_of(path);
  made.commands.push_back(estimate_command(cloud, path, part, voxel));
  EstimateReport report;
  const std::size_t unmeasured = cloud.unmeasured_skipped;
  cloud = estimate_surfels(cloud, options, &report, path);
  const auto has_size = [](float variance) { return variance > 0; };
  if (std::none_of(cloud.variance.begin(), cloud.variance.end(), has_size) &&
      std::none_of(cloud.variance_u.begin(), cloud.variance_u.end(), has_size)) {
    throw_input(path,
                cloud.size() == 1
                    ? "holds one point, of which no size can be told; give more points"
                    : fmt::format("no size can be told of any of the {} points, as each one's "
                                  "neighbours are all at its own place; export the points "
                                  "again, without duplicates",
                                  cloud.size()));
  }
  made.done.push_back(fmt::format(
      "{}: raw points, {}normals and sizes estimated{}{}: {} surfels ({})", path,
      voxel.empty() ? "" : fmt::format("averaged in cells of {}, ", voxel),
      unmeasured > 0
          ? fmt::format(", {} were not measured, as the file says, and are left out", unmeasured)
          : "",
      report.nonfinite > 0 ? fmt::format(", {} of {} points are not finite and left out",
                                         report.nonfinite, report.points)
                           : "",
      cloud.size(), made.commands.back()));
}

Intake::Intake(const std::vector<std::string>& files, const CloudReadOptions& part) : part_(part) {
  for (const std::string& path : files) {
    File& file = files_.emplace_back();
    file.path = path;
    switch (file_kind(path)) {
      case FileKind::kMesh:
        file.mesh = read_mesh(path);
        require_sampleable(*file.mesh, path);
        break;
      case FileKind::kCloud:
        file.cloud = read_cloud(path, part);
        break;
      case FileKind::kImage:
        throw_input(path, "is a picture; give meshes, points or surfels");
      case FileKind::kVolume:
        refuse_volume(path);
      case FileKind::kGaussians:
        throw_input(path,
                    "holds Gaussians in space (trained splats), which are not drawn together with "
                    "surfels; give meshes, points or surfels");
    }
  }
}

Intake::~Intake() = default;

Bounds Intake::bounds() const {
  Bounds box;
  for (const File& file : files_) {
    const Bounds own = file.bounds();
    if (own.empty()) continue;
    box.add(own.min);
    box.add(own.max);
  }
  return box;
}

bool Intake::has_meshes() const {
  return std::any_of(files_.begin(), files_.end(),
                     [](const File& file) { return file.mesh.has_value(); });
}

std::vector<std::string> Intake::images() const {
  std::vector<std::string> names;
  for (const File& file : files_) {
    if (!file.mesh) continue;
    for (std::string& image : image_files(*file.mesh)) names.push_back(std::move(image));
  }
  return names;
}

Intake::Made Intake::surfels(double spacing, const IntakeOptions& options) {
  Made made;
  ReliefKinds kinds;
  std::vector<SurfelCloud> clouds;
  std::vector<std::string> names;
  std::vector<std::string> joined;
  for (File& file : files_) {
    made.file = file.path;
    if (file.mesh) {
      file.sample(spacing, options, made, kinds);
    } else if (!has_variance(file.cloud)) {
      file.estimate(spacing, part_, made);
    } else if (const std::string words = part_words(part_); files_.size() > 1 && !words.empty()) {
      made.file = named_after(file.path, "-part.ply");
      made.commands.push_back(fmt::format("surfel-convert {}{} -o {}", shell_file(file.path), words,
                                          shell_file(made.file)));
    }
    clouds.push_back(std::move(file.cloud));
    names.push_back(file.path);
    joined.push_back(shell_file(made.file));
  }
  files_.clear();
  if (options.relief.bump_scale && !kinds.heights) {
    throw_usage("`bump_scale` has no effect where there is no bump map; leave it out");
  }
  if (options.relief.y_down && !kinds.normals) {
    throw_usage("`y_down` has no effect where there is no normal map; leave it out");
  }
  if (clouds.size() == 1) {
    made.cloud = std::move(clouds.front());
    return made;
  }
  JoinReport joint;
  made.cloud = join_clouds(std::move(clouds), {}, names, &joint);
  for (const JoinReport::Filled& filled : joint.filled) {
    made.filled.emplace_back(names[filled.cloud], filled.column);
  }
  made.file = "joined-surfels.ply";
  made.commands.push_back(
      fmt::format("surfel-convert {} -o {}", fmt::join(joined, " "), made.file));
  made.done.push_back(fmt::format("{} files joined: {} surfels ({})", names.size(),
                                  made.cloud.size(), made.commands.back()));
  return made;
}

}  // namespace surfel
