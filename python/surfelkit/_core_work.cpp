// What makes surfels, by the library's options: estimation, sampling, textures.

#include <algorithm>
#include <cmath>

#include <surfel/estimate/estimate.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/texture/fit_blocks.h>
#include <surfel/texture/surface_lookup.h>
#include <surfel/texture/texture_source.h>

#include "_core.h"
#include "_pictures.h"

namespace surfel::python {
namespace {

const Choices<Orientation> kOrientations{{"auto", Orientation::kAuto},
                                         {"winding", Orientation::kWinding},
                                         {"mst", Orientation::kMst},
                                         {"outward", Orientation::kOutward},
                                         {"viewpoint", Orientation::kViewpoint},
                                         {"up", Orientation::kUp},
                                         {"align", Orientation::kAlign},
                                         {"none", Orientation::kNone}};

struct EstimateArguments {
  EstimateOptions options;
  std::optional<Vec3d> viewpoint;
  bool clip = false;
  CreaseOptions creases;
  bool remove_outliers = false;
  OutlierOptions outliers;
  std::optional<double> voxel;
  bool smooth = false;
  SmoothingOptions smoothing;
};

void visit(Options& o, EstimateArguments& a) {
  NormalOptions& normals = a.options.normals;
  o("k", normals.k);
  o("adaptive", normals.adaptive);
  o("k_min", normals.k_min);
  o("k_max", normals.k_max);
  o("radius", normals.radius);
  o("grow_in_noise", normals.grow_in_noise);
  o("search", a.options.search,
    {{"exact", SearchMethod::kExact},
     {"flann", SearchMethod::kFlann},
     {"flann-approx", SearchMethod::kFlannApproximate}});
  o("orient", a.options.orientation.method, kOrientations);
  o("viewpoint", a.viewpoint);
  o("up", a.options.orientation.up);
  o("variance", a.options.size.rule,
    {{"cover", VarianceRule::kCover}, {"max-distance", VarianceRule::kMaxDistance}});
  o("anisotropy", a.options.size.anisotropy,
    {{"auto", Anisotropy::kAuto}, {"on", Anisotropy::kOn}, {"off", Anisotropy::kOff}});
  o("cutoff", a.options.size.cutoff);
  o("max_radius", a.options.size.max_radius);
  o("clip", a.clip);
  o("crease_angle", a.creases.crease_angle);
  o("remove_outliers", a.remove_outliers);
  o("outlier_neighbors", a.outliers.neighbors);
  o("outlier_deviations", a.outliers.deviations);
  o("voxel", a.voxel);
  o("smooth", a.smooth);
  o("smooth_spacings", a.smoothing.spacings);
  o("smooth_order", a.smoothing.order);
  o("smooth_normals", a.smoothing.normals);
}

EstimateOptions complete(const Options& taken, EstimateArguments& a, const SurfelCloud& cloud) {
  EstimateOptions& o = a.options;
  taken.refuse(!o.normals.adaptive, {"k_min", "k_max"}, "without `adaptive`");
  taken.refuse(!a.clip, {"crease_angle"}, "without `clip`");
  taken.refuse(!a.remove_outliers, {"outlier_neighbors", "outlier_deviations"},
               "without `remove_outliers`");
  taken.refuse(!a.smooth, {"smooth_spacings", "smooth_order", "smooth_normals"},
               "without `smooth`");
  taken.refuse(o.orientation.method != Orientation::kUp, {"up"}, "unless `orient` is 'up'");
  taken.refuse(o.size.rule != VarianceRule::kCover, {"cutoff", "max_radius"},
               "unless `variance` is 'cover'");
  if (a.clip) o.edges = a.creases;
  if (a.remove_outliers) o.outliers = a.outliers;
  if (a.smooth) o.smoothing = a.smoothing;
  if (a.voxel) o.voxels = VoxelOptions{*a.voxel};
  o.orientation.viewpoint = a.viewpoint;
  o.normals.sensor = a.viewpoint;
  if (!a.viewpoint && cloud.viewpoint) o.normals.sensor = cloud.viewpoint->position;
  return o;
}

py::tuple estimate(HeldCloud& held, const py::dict& given, const Call& call) {
  const SurfelCloud& cloud = ready(held);
  EstimateArguments arguments;
  Options take(given);
  visit(take, arguments);
  const EstimateOptions options = complete(take, arguments, cloud);
  EstimateReport report;
  const InUse use(held);
  std::shared_ptr<HeldCloud> surfels;
  with_names({{"neighbors", "outlier_neighbors"},
              {"deviations", "outlier_deviations"},
              {"edge", "voxel"},
              {"spacings", "smooth_spacings"},
              {"order", "smooth_order"}},
             [&] {
               surfels =
                   hold(made(call, [&] { return estimate_surfels(cloud, options, &report); }));
             });
  py::dict figures;
  figures["points"] = report.points;
  figures["nonfinite"] = report.nonfinite;
  figures["outliers"] = report.outliers;
  figures["averaged"] = report.averaged;
  figures["voxel"] = report.voxel_edge;
  figures["unknown_normals"] = report.orientation.unknown;
  for (const auto& [name, method] : kOrientations) {
    if (method == report.orientation.method) figures["orient"] = name;
  }
  figures["side_confidence"] = report.side_confidence;
  figures["noise"] = report.noise;
  figures["border"] = report.border;
  figures["anisotropic"] = report.anisotropic;
  figures["mean_shift"] = report.mean_shift;
  return py::make_tuple(surfels, figures);
}

void visit(Options& o, MeshSampleOptions& a) {
  o("spacing", a.spacing);
  o("count", a.count);
  o("seed", a.seed);
  o("flat", a.flat);
  o("variance_scale", a.variance_scale);
  o("crease_angle", a.crease_angle);
  o("clip", a.clip);
}

py::tuple sample(HeldMesh& held, const py::dict& given, const Call& call) {
  const TriangleMesh& mesh = ready(held);
  MeshSampleOptions options;
  Options take(given);
  visit(take, options);
  MeshSampleReport report;
  const InUse use(held);
  const auto surfels = hold(made(call, [&] { return sample_mesh(mesh, options, &report); }));
  py::dict figures;
  figures["spacing"] = report.spacing;
  figures["area"] = report.area;
  figures["faces"] = report.faces;
  figures["degenerate_faces"] = report.degenerate_faces;
  figures["components"] = report.components;
  figures["mirrored"] = report.mirrored;
  figures["mean_distance"] = report.mean_distance;
  return py::make_tuple(surfels, figures);
}

struct FitArguments {
  TextureFitOptions fit;
  std::optional<WrapMode> wrap;
  bool charts = TextureSourceOptions().charts;
  std::optional<std::pair<double, double>> bounds;
};

void visit(Options& o, FitArguments& a) {
  o("fit", a.fit.kind,
    {{"ewa", TextureFitKind::kEwa},
     {"gram", TextureFitKind::kGram},
     {"render", TextureFitKind::kRender}});
  o("cutoff", a.fit.cutoff);
  o("wrap", a.wrap,
    {{"repeat", WrapMode::kRepeat}, {"mirror", WrapMode::kMirror}, {"clamp", WrapMode::kClamp}});
  o("charts", a.charts);
  o("reconstruction", a.fit.reconstruction);
  o("prefilter", a.fit.prefilter);
  o("max_aspect", a.fit.max_aspect);
  o("exact", a.fit.exact);
  o("solver", a.fit.solver, {{"cg", FitSolver::kConjugateGradients}, {"ceres", FitSolver::kCeres}});
  o("tolerance", a.fit.tolerance);
  o("lambda_", a.fit.lambda);
  o("bounds", a.bounds);
  o("points", a.fit.points);
  o("robust", a.fit.robust);
}

/// The textures of a call: an image in memory or its name, or the images of a mesh.
TextureSet textures_of(const FitArguments& a, const std::optional<std::string>& image,
                       std::optional<Image> pixels, const TriangleMesh* mesh) {
  if (!pixels) {
    TextureSourceOptions source{
        .image = image.value_or(""), .wrap = a.wrap, .charts = a.charts, .whole = false};
    return load_textures(source, mesh, "mesh");
  }
  TextureSet textures;
  textures.maps.emplace_back(std::move(*pixels), a.wrap.value_or(WrapMode::kRepeat));
  if (mesh && mesh->wedge_uv.empty()) {
    throw_input("mesh", "the mesh has no texture coordinates, so no image can be put on it");
  }
  if (mesh && a.charts) textures.charts.emplace(*mesh);
  return textures;
}

/// Throws Error(kInput) where surfels do not lie on the mesh that they are said to be of.
void require_near(const SurfelCloud& cloud, const TriangleMesh& mesh) {
  if (cloud.empty() || (cloud.variance.empty() && !cloud.anisotropic())) return;
  constexpr std::size_t kFew = 1000;
  if (mesh_proximity(cloud, mesh, std::min(kFew, cloud.size())).near > 0) return;
  const MeshProximity found = mesh_proximity(cloud, mesh, cloud.size());
  if (found.near > 0) return;
  throw_input("", "none of the " + std::to_string(cloud.size()) +
                      " surfels lies on the mesh: the nearest is " +
                      std::to_string(found.least_distance) +
                      " away; give the mesh that they were sampled from, at its own place");
}

py::dict figures_of(const TextureFitReport& report) {
  py::dict figures;
  figures["surfels"] = report.surfels;
  figures["without_uv"] = report.without_uv;
  figures["without_kernel"] = report.without_kernel;
  figures["charts"] = report.charts;
  if (report.system) {
    figures["iterations"] = report.system->iterations;
    figures["residual"] = report.system->residual;
    figures["converged"] = report.system->converged;
    figures["condition"] = report.system->condition();
    figures["lambda"] = report.system->lambda;
    figures["error_ewa"] = report.system->error_ewa;
    figures["error"] = report.system->error;
  }
  return figures;
}

const std::vector<std::pair<std::string, std::string>> kFitNames{{"lambda", "lambda_"},
                                                                 {"kind", "fit"}};

FitArguments fit_arguments(const py::dict& given) {
  FitArguments arguments;
  Options take(given);
  visit(take, arguments);
  if (arguments.bounds) {
    arguments.fit.bounds = {arguments.bounds->first, arguments.bounds->second};
  }
  const bool solves = arguments.fit.kind != TextureFitKind::kEwa;
  take.refuse(!solves, {"solver", "tolerance", "lambda_", "bounds"}, "if `fit` is 'ewa'");
  take.refuse(arguments.fit.kind != TextureFitKind::kRender, {"cutoff", "points", "robust"},
              "unless `fit` is 'render'");
  return arguments;
}

py::tuple fit_texture(HeldCloud& held, const py::object& image, HeldMesh* held_mesh,
                      const py::dict& given, const Call& call) {
  const SurfelCloud& cloud = ready(held);
  const FitArguments arguments = fit_arguments(given);
  const TriangleMesh* const mesh = held_mesh ? &ready(*held_mesh) : nullptr;
  std::optional<std::string> name;
  std::optional<Image> pixels;
  if (py::isinstance<py::bytes>(image)) {
    name = image.cast<std::string>();
  } else if (!image.is_none()) {
    pixels = texture_image(image);
  }
  const InUse use(held);
  std::optional<InUse<TriangleMesh>> use_mesh;
  if (held_mesh) use_mesh.emplace(*held_mesh);
  TextureFitReport report;
  std::shared_ptr<HeldCloud> textured;
  with_names(kFitNames, [&] {
    textured = hold(made(call, [&] {
      SurfelCloud result = cloud;
      if (mesh) require_near(result, *mesh);
      if (mesh && result.uv.empty()) locate_on_mesh(result, *mesh, "mesh");
      TextureSet textures = textures_of(arguments, name, std::move(pixels), mesh);
      report = fit_coefficients(result, {.textures = &textures}, arguments.fit, "surfels");
      show_coefficients(result);
      return result;
    }));
  });
  return py::make_tuple(textured, figures_of(report));
}

py::tuple fit_colors(HeldCloud& held, const py::dict& given, const Call& call) {
  const SurfelCloud& cloud = ready(held);
  const FitArguments arguments = fit_arguments(given);
  const InUse use(held);
  TextureFitReport report;
  std::shared_ptr<HeldCloud> fitted;
  with_names(kFitNames, [&] {
    fitted = hold(made(call, [&] {
      SurfelCloud result = cloud;
      report = fit_coefficients(result, {}, arguments.fit, "surfels");
      return result;
    }));
  });
  return py::make_tuple(fitted, figures_of(report));
}

}  // namespace

void bind_work(py::module_& module) {
  module.def("estimate", [](HeldCloud& cloud, const py::dict& given, const py::object& progress,
                            std::optional<int> threads) {
    return estimate(cloud, given, {progress, threads});
  });
  module.def("sample", [](HeldMesh& mesh, const py::dict& given, const py::object& progress,
                          std::optional<int> threads) {
    return sample(mesh, given, {progress, threads});
  });
  module.def("fit_texture",
             [](HeldCloud& cloud, const py::object& image, HeldMesh* mesh, const py::dict& given,
                const py::object& progress, std::optional<int> threads) {
               return fit_texture(cloud, image, mesh, given, {progress, threads});
             });
  module.def("fit_colors", [](HeldCloud& cloud, const py::dict& given, const py::object& progress,
                              std::optional<int> threads) {
    return fit_colors(cloud, given, {progress, threads});
  });
  module.def("estimate_defaults", [] { return defaults<EstimateArguments>(&visit); });
  module.def("sample_defaults", [] { return defaults<MeshSampleOptions>(&visit); });
  module.def("fit_defaults", [] { return defaults<FitArguments>(&visit); });
}

}  // namespace surfel::python
