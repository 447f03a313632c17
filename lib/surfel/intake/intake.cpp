#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>
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
#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_source.h>

namespace surfel {
namespace {

/// Most samples of a mesh, roughly.
constexpr double kMostSamples = 1 << 23;

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

/// A number as commands say it.
std::string three_digits(double value) { return fmt::format("{:.3g}", value); }

/// The name of a file, without folder and extension, with another end.
std::string named_after(const std::string& path, const std::string& end) {
  const std::size_t name = path.rfind('/') + 1;
  const std::size_t dot = path.rfind('.');
  const bool extension = dot != std::string::npos && dot > name;
  return path.substr(name, extension ? dot - name : std::string::npos) + end;
}

bool has_texture(const TriangleMesh& mesh) {
  return !mesh.wedge_uv.empty() &&
         std::any_of(mesh.material.begin(), mesh.material.end(),
                     [](const MeshMaterial& m) { return !m.texture.empty(); });
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

struct Intake::File {
  std::string path;
  std::optional<TriangleMesh> mesh;
  SurfelCloud cloud;  ///< Where the file is no mesh.

  Bounds bounds() const;
  void sample(double spacing, Made& made);
  void estimate(Made& made);
};

Bounds Intake::File::bounds() const {
  if (!mesh) return cloud.bounds();
  Bounds box;
  for (const auto& face : mesh->face) {
    for (const std::uint32_t vertex : face) {
      box.add(mesh->origin + mesh->position[vertex].cast<double>());
    }
  }
  return box;
}

/// Makes surfels of the mesh.
void Intake::File::sample(double spacing, Made& made) {
  const std::string digits =
      three_digits(std::max(spacing, std::sqrt(area_of(*mesh) / kMostSamples)));
  MeshSampleOptions options;
  std::from_chars(digits.data(), digits.data() + digits.size(), options.spacing.emplace());
  cloud = sample_mesh(*mesh, options, nullptr, path);
  made.file = named_after(path, "-surfels.ply");
  std::vector<std::string> commands{fmt::format("surfel-from-mesh {} --spacing {} -o {}",
                                                shell_file(path), digits, shell_file(made.file))};
  const bool textured = has_texture(*mesh);
  if (textured) {
    TextureSet textures = load_textures({.whole = false}, &*mesh, path);
    fit_texture(cloud, textures, {}, path);
    show_coefficients(cloud);
    const std::string surfels = std::exchange(made.file, named_after(path, "-textured.ply"));
    commands.push_back(fmt::format("surfel-texture {} --mesh {} -o {}", shell_file(surfels),
                                   shell_file(path), shell_file(made.file)));
  }
  made.done.push_back(fmt::format("{}: a mesh, sampled every {}{}: {} surfels ({})", path, digits,
                                  textured ? " and textured" : "", cloud.size(),
                                  fmt::join(commands, "; ")));
  made.commands.insert(made.commands.end(), commands.begin(), commands.end());
  mesh.reset();
}

/// Makes surfels of raw points.
void Intake::File::estimate(Made& made) {
  EstimateOptions options;
  std::string side;
  if (cloud.viewpoint) {
    options.orientation = {.method = Orientation::kViewpoint,
                           .viewpoint = cloud.viewpoint->position};
    options.normals.sensor = cloud.viewpoint->position;
    side = " --orient viewpoint";
  } else if (!cloud.normal.empty()) {
    options.orientation.method = Orientation::kAlign;
    side = " --orient align";
  }
  cloud = estimate_surfels(cloud, options, nullptr, path);
  made.file = named_after(path, "-surfels.ply");
  made.commands.push_back(
      fmt::format("surfel-estimate {}{} -o {}", shell_file(path), side, shell_file(made.file)));
  made.done.push_back(fmt::format("{}: raw points, normals and sizes estimated: {} surfels ({})",
                                  path, cloud.size(), made.commands.back()));
}

Intake::Intake(const std::vector<std::string>& files) {
  for (const std::string& path : files) {
    File& file = files_.emplace_back();
    file.path = path;
    switch (file_kind(path)) {
      case FileKind::kMesh:
        file.mesh = read_mesh(path);
        break;
      case FileKind::kCloud:
        file.cloud = read_cloud(path);
        break;
      case FileKind::kImage:
        throw_input(path, "is a picture; give meshes, points or surfels");
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

Intake::Made Intake::surfels(double spacing) {
  Made made;
  std::vector<SurfelCloud> clouds;
  std::vector<std::string> names;
  std::vector<std::string> joined;
  for (File& file : files_) {
    made.file = file.path;
    if (file.mesh) {
      file.sample(spacing, made);
    } else if (!has_variance(file.cloud)) {
      file.estimate(made);
    }
    clouds.push_back(std::move(file.cloud));
    names.push_back(file.path);
    joined.push_back(shell_file(made.file));
  }
  files_.clear();
  if (clouds.size() == 1) {
    made.cloud = std::move(clouds.front());
    return made;
  }
  made.cloud = join_clouds(std::move(clouds), {}, names);
  made.file = "joined-surfels.ply";
  made.commands.push_back(
      fmt::format("surfel-convert {} -o {}", fmt::join(joined, " "), made.file));
  made.done.push_back(fmt::format("{} files joined: {} surfels ({})", names.size(),
                                  made.cloud.size(), made.commands.back()));
  return made;
}

}  // namespace surfel
