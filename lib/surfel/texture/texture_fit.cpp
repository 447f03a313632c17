#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/stage_timer.h>
#include <surfel/texture/coefficient_fit.h>
#include <surfel/texture/ewa_fit.h>
#include <surfel/texture/kernel_overlap.h>
#include <surfel/texture/reach_tree.h>
#include <surfel/texture/robust_fit.h>
#include <surfel/texture/solid_fit.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {
namespace {

/// What every fit but kEwa of colours needs.
void check_kernels_present(const SurfelCloud& cloud, const std::string& name) {
  if (cloud.empty()) return;
  const bool frame = !cloud.variance_u.empty() && !cloud.variance_v.empty();
  if (cloud.anisotropic() ? !frame : cloud.variance.empty()) {
    throw_input(name,
                "the surfels have no variance; surfel-from-mesh and surfel-estimate write one");
  }
}

void check_columns_present(const SurfelCloud& cloud, const std::string& name) {
  if (cloud.empty()) return;
  if (cloud.uv.empty()) {
    throw_input(name,
                "the surfels have no texture coordinates (u, v); sample them with surfel-from-mesh "
                "from a mesh that has some, or name the mesh that they lie on");
  }
  if (cloud.dpdu.empty() || cloud.dpdv.empty()) {
    throw_input(name,
                "the surfels have no surface derivatives (dpdu_x ... dpdv_z); sample them with "
                "surfel-from-mesh or surfel-generate");
  }
  check_kernels_present(cloud, name);
}

void check_materials(const SurfelCloud& cloud, const TextureSet& textures, const std::string& name,
                     std::size_t first) {
  if (textures.maps.empty()) throw_usage("there is no texture");
  const std::size_t materials = textures.map_of_material.size();
  if (materials == 0 || cloud.empty()) return;
  if (cloud.material.empty()) {
    if (materials == 1) return;
    throw_input(name, fmt::format("the surfels have no material to tell {} of the mesh apart; "
                                  "sample them with surfel-from-mesh, or give one image",
                                  materials));
  }
  const auto largest = std::max_element(cloud.material.begin(), cloud.material.end());
  if (*largest >= materials) {
    throw_input(name,
                fmt::format("surfel {} has material {}, but the mesh has {}; give the mesh "
                            "that the surfels were sampled from",
                            first + static_cast<std::size_t>(largest - cloud.material.begin()),
                            *largest, materials));
  }
}

/// The surfels whose colours multiply the texture.
Array<std::uint32_t> multiplied_surfels(const SurfelCloud& cloud, const TextureSet& textures) {
  Array<std::uint32_t> found;
  if (textures.multiplied.empty()) return found;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const std::uint16_t material = cloud.material.empty() ? std::uint16_t{0} : cloud.material[k];
    if (textures.takes_colors(material)) found.push_back(static_cast<std::uint32_t>(k));
  }
  return found;
}

/// Counts the surfels, and finds the range of their coefficients.
void measure(const SurfelCloud& cloud, const TextureFitOptions& options, TextureFitReport& report) {
  const std::size_t begin = options.part ? options.part->begin : 0;
  const std::size_t end = options.part ? options.part->end : cloud.size();
  report.surfels = end - begin;
  if (begin == end) return;
  report.coefficient_min = report.coefficient_max = cloud.coefficient[begin];
  for (std::size_t k = begin; k < end; ++k) {
    const Vec3f& w = cloud.coefficient[k];
    report.coefficient_min = report.coefficient_min.cwiseMin(w);
    report.coefficient_max = report.coefficient_max.cwiseMax(w);
  }
}

/// Takes out the surfels without uv. Their colour is made up: in R w = c, neighbours would have to
/// make up for it with coefficients of any size.
void leave_out_without_uv(const SurfelCloud& cloud, SurfelBasis& basis) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < basis.size(); ++i) {
    if (!cloud.uv[basis.surfel[i]].allFinite()) continue;
    basis.function[kept] = basis.function[i];
    if (!basis.cut.empty()) basis.cut[kept] = basis.cut[i];
    basis.surfel[kept++] = basis.surfel[i];
  }
  basis.unusable += basis.size() - kept;
  basis.function.resize(kept);
  if (!basis.cut.empty()) basis.cut.resize(kept);
  basis.surfel.resize(kept);
}

/// Points a surfel of the render fit of a texture.
int fit_points(const TextureFitOptions& options) {
  return options.points.value_or(options.refine_variance ? 12 : 6);
}

/// Options of the render fit of a texture.
RenderSystemOptions render_options(const TextureFitOptions& options) {
  RenderSystemOptions render;
  render.cutoff = options.cutoff;
  render.regularization = options.lambda.value_or(render.regularization);
  // w_0 carries the outliers; refine_variance() says why it has no such term.
  if (options.robust || options.refine_variance) render.minified = 0;
  return render;
}

/// The right side of a texture's gram fit is that of SS01 (11).
bool published_side(const TextureFitOptions& options) {
  return options.right_side.value_or(GramRightSide::kPublished) == GramRightSide::kPublished;
}

/// The integral of every r_k over its tangent plane, unit^2: c_k / w_ewa of textures that fill
/// space, whose mean under r_k w_ewa is.
Array<double> kernel_integrals(const SurfelBasis& basis) {
  Array<double> integrals(basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) integrals[i] = basis.function[i].area;
  return integrals;
}

/// The cutoff of functions that have a pair in the fit's equations: products of whole Gaussians are
/// coupled within 3 standard deviations of their sum at least.
double fit_reach(const TextureFitOptions& options) {
  constexpr double kGramReach = 9;
  return options.kind == TextureFitKind::kGram ? kGramReach : kPlanarReach2 * options.cutoff;
}

}  // namespace

std::vector<std::string> TextureFitOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, !reconstruction || (*reconstruction >= 0.25 && *reconstruction <= 16),
               "reconstruction", reconstruction.value_or(0), "0.25 to 16 texels");
  check_option(found, prefilter >= 1.0 / 16 && prefilter <= 4, "prefilter", prefilter,
               "1/16 to 4 times the surfels' variance");
  check_rule(found, prefilter == 1 || kind == TextureFitKind::kEwa,
             "`prefilter` has no effect without the ewa fit; leave it out");
  check_option(found, max_aspect >= 1 && max_aspect <= 10000, "max_aspect", max_aspect,
               "1 to 10000");
  check_option(found, tolerance >= 1e-14 && tolerance <= 0.1, "tolerance", tolerance,
               "1e-14 to 0.1");
  check_option(found, !lambda || (*lambda >= 0 && *lambda <= 1e6), "lambda", lambda.value_or(0),
               "0 to 1e6");
  check_rule(found, kind != TextureFitKind::kRender || lambda != 0.0,
             "`lambda` is 0; the render fit needs more, as points may not reach every surfel");
  check_rule(found, !right_side || kind == TextureFitKind::kGram,
             "`right_side` has no effect without the gram fit; leave it out");
  check_option(found, cutoff >= 0.1 && cutoff <= 16, "cutoff", cutoff, "0.1 to 16");
  check_option(found, !points || (*points >= 1 && *points <= 256), "points", points.value_or(0),
               "1 to 256");
  check_rule(found,
             !bounds || (std::isfinite(bounds->lower) && std::isfinite(bounds->upper) &&
                         bounds->lower < bounds->upper),
             "`bounds` must be two numbers, the lower first");
  check_rule(found, !bounds || solver == FitSolver::kConjugateGradients,
             "`bounds` need the solver cg; ceres knows none");
  const auto needs_render = [&](bool used, const char* option) {
    check_rule(found, !used || kind == TextureFitKind::kRender,
               fmt::format("`{}` has no effect without the render fit; leave it out", option));
    check_rule(found, !used || !bounds,
               fmt::format("`{}` and `bounds` do not go together", option));
  };
  needs_render(robust, "robust");
  if (robust_scale) check_positive(found, "robust_scale", *robust_scale);
  needs_render(refine_variance, "refine_variance");
  check_rule(found, !robust || !refine_variance,
             "`robust` and `refine_variance` do not go together");
  check_option(found, coverage >= 0 && coverage <= 1e6, "coverage", coverage, "0 to 1e6");
  check_rule(found,
             !part || (!robust && !refine_variance && solver == FitSolver::kConjugateGradients),
             "a part is fitted by the solver cg alone, and neither `robust` nor with "
             "`refine_variance`");
  return found;
}

void check_textured(const SurfelCloud& cloud, const TextureSet& textures, const std::string& name,
                    std::size_t first) {
  check_columns_present(cloud, name);
  check_materials(cloud, textures, name, first);
}

void TextureFitReport::add(const TextureFitReport& more) {
  if (more.surfels == 0) return;
  if (surfels == 0) {
    coefficient_min = more.coefficient_min;
    coefficient_max = more.coefficient_max;
  }
  coefficient_min = coefficient_min.cwiseMin(more.coefficient_min);
  coefficient_max = coefficient_max.cwiseMax(more.coefficient_max);
  surfels += more.surfels;
  without_uv += more.without_uv;
  without_kernel += more.without_kernel;
  widened += more.widened;
  charts = more.charts;
  std::vector<std::uint32_t> all;
  std::set_union(too_large.begin(), too_large.end(), more.too_large.begin(), more.too_large.end(),
                 std::back_inserter(all));
  too_large = std::move(all);
  charts_too_large = too_large.size();
  outside_charts += more.outside_charts;
  levels = std::max(levels, more.levels);
  alpha = more.alpha;
  if (more.system && system) {
    system->add(*more.system);
  } else if (more.system) {
    system = more.system;
  }
  for (const auto& [stage, milliseconds] : more.times.stages()) times.add(stage, milliseconds);
}

void SystemReport::add(const SystemReport& more) {
  const auto covered = [](const SystemReport& r) {
    return static_cast<double>(r.points - r.uncovered);
  };
  const double points_before = covered(*this);
  const double points_more = covered(more);
  const auto mean = [&](double& value, double other) {
    if (points_more == 0) return;
    value = std::sqrt((points_before * value * value + points_more * other * other) /
                      (points_before + points_more));
  };
  mean(error_ewa, more.error_ewa);
  mean(error, more.error);
  functions += more.functions;
  entries += more.entries;
  lambda = std::max(lambda, more.lambda);
  eigen_min = std::min(eigen_min, more.eigen_min);
  eigen_max = std::max(eigen_max, more.eigen_max);
  iterations = std::max(iterations, more.iterations);
  rough_iterations = std::max(rough_iterations, more.rough_iterations);
  residual = std::max(residual, more.residual);
  converged = converged && more.converged;
  points += more.points;
  uncovered += more.uncovered;
  unresolved += more.unresolved;
  min_reach = std::min(min_reach, more.min_reach);
  max_reach = std::max(max_reach, more.max_reach);
}

void request_kernels(SurfelCloud& piece, TextureSet& textures, const TextureFitOptions& options,
                     const std::string& name, std::size_t first) {
  require_usable(options);
  check_textured(piece, textures, name, first);
  if (options.kind != TextureFitKind::kRender) return request_ewa(piece, textures, options);
  const SurfelBasis basis = make_basis(piece, options.part.has_value());
  require_bounded_overlap(basis, fit_reach(options), name);
  PointColors points{.basis = basis, .quadrature = cover_surface(basis, fit_points(options))};
  request_ewa(piece, textures, options, &points);
}

void load_requested(TextureSet& textures) {
  for (TextureMap& map : textures.maps) map.load();
  textures.loaded = true;
}

double gram_lambda(const SurfelCloud& cloud, bool textured, const TextureFitOptions& options,
                   const std::string& name) {
  check_kernels_present(cloud, name);
  SurfelBasis basis = make_basis(cloud, options.part.has_value());
  require_bounded_overlap(basis, fit_reach(options), name);
  if (textured) leave_out_without_uv(cloud, basis);
  return gram_lambda(basis, options);
}

TextureFitReport fit_texture(SurfelCloud& cloud, TextureSet& textures,
                             const TextureFitOptions& options, const std::string& name) {
  require_usable(options);
  check_textured(cloud, textures, name);

  const Array<std::uint32_t> multiplied = multiplied_surfels(cloud, textures);
  if (!multiplied.empty() && (cloud.color.empty() || !cloud.coefficient.empty())) {
    throw_input(name,
                "the mesh's vertex colours multiply its texture, and the surfels do not have "
                "them, or not any more; sample them anew with surfel-from-mesh");
  }
  cloud.color_light = textures.light;
  TextureFitReport report;
  if (options.kind == TextureFitKind::kEwa) {
    fit_ewa(cloud, textures, options, report);
  } else {
    SurfelBasis basis = make_basis(cloud, options.part.has_value());
    require_bounded_overlap(basis, fit_reach(options), name);
    if (options.kind == TextureFitKind::kGram) {
      leave_out_without_uv(cloud, basis);
      fit_ewa(cloud, textures, options, report);
      fit_gram(cloud, basis,
               published_side(options) ? texture_integrals(cloud, basis, textures, options)
                                       : Array<double>(),
               options, report);
    } else {
      StageTimer timer(report.times);
      PointColors colors{.basis = basis, .quadrature = cover_surface(basis, fit_points(options))};
      timer.end("points");
      fit_ewa(cloud, textures, options, report, &colors);
      fit_render(cloud, std::move(colors), render_options(options), options, report);
    }
  }
  for (const std::uint32_t k : multiplied) {
    cloud.coefficient[k] = cloud.coefficient[k].cwiseProduct(cloud.color[k]);
  }
  measure(cloud, options, report);
  return report;
}

TextureFitReport fit_colors(SurfelCloud& cloud, const TextureFitOptions& options,
                            const std::string& name) {
  require_usable(options);
  if (options.refine_variance) {
    throw_usage(
        "`refine_variance` needs a texture: one colour a surfel does not tell its variance");
  }
  if (options.right_side == GramRightSide::kPublished) {
    throw_usage(
        "the `right_side` published is an integral over a texture, and the surfels' colours are "
        "none; choose normalised");
  }
  check_kernels_present(cloud, name);
  if (!cloud.empty() && cloud.color.empty()) {
    throw_input(name, "the surfels have no colours (red, green, blue) to fit");
  }
  for (std::size_t k = 0; k < cloud.color.size(); ++k) {
    if (cloud.color[k].allFinite()) continue;
    throw_input(name, fmt::format("the colour of surfel {} is not finite", k));
  }
  TextureFitReport report;
  cloud.coefficient = cloud.color;
  cloud.basis_cutoff.reset();
  if (options.kind != TextureFitKind::kEwa) {
    const SurfelBasis basis = make_basis(cloud, options.part.has_value());
    require_bounded_overlap(basis, fit_reach(options), name);
    if (options.kind == TextureFitKind::kGram) {
      fit_gram(cloud, basis, {}, options, report);
    } else {
      PointColors colors{.basis = basis, .quadrature = at_functions(basis)};
      for (const std::uint32_t k : basis.surfel) {
        Channels color;
        color << cloud.color[k].cast<double>().array(), 0;
        colors.color.push_back(color);
      }
      colors.known.assign(basis.size(), 1);
      if (options.robust) {
        const Array<Channels> target = winsorized(basis, colors.color, options.robust_scale);
        for (std::size_t i = 0; i < basis.size(); ++i) {
          cloud.coefficient[basis.surfel[i]] = target[i].head<3>().matrix().cast<float>();
        }
      }
      // The samples are not filtered: there is nothing to minify to.
      const RenderSystemOptions render{
          .cutoff = options.cutoff,
          .minified = 0,
          .regularization = options.lambda.value_or(kColorRegularization)};
      fit_render(cloud, std::move(colors), render, options, report);
    }
  }
  measure(cloud, options, report);
  return report;
}

TextureFitReport fit_solid(SurfelCloud& cloud, const SolidTexture& texture,
                           const TextureFitOptions& options, const std::string& name) {
  require_usable(options);
  check_kernels_present(cloud, name);
  cloud.color_light = ColorLight::kReflectance;
  TextureFitReport report;
  const SurfelBasis basis = make_basis(cloud, options.part.has_value());
  if (options.kind != TextureFitKind::kEwa) {
    require_bounded_overlap(basis, fit_reach(options), name);
  }
  if (options.kind == TextureFitKind::kRender) {
    StageTimer timer(report.times);
    PointColors colors{.basis = basis, .quadrature = cover_surface(basis, fit_points(options))};
    timer.end("points");
    fit_solid_ewa(cloud, texture, basis, options, report, &colors);
    fit_render(cloud, std::move(colors), render_options(options), options, report);
  } else {
    fit_solid_ewa(cloud, texture, basis, options, report);
    if (options.kind == TextureFitKind::kGram) {
      fit_gram(cloud, basis, published_side(options) ? kernel_integrals(basis) : Array<double>(),
               options, report);
    }
  }
  measure(cloud, options, report);
  return report;
}

void show_coefficients(SurfelCloud& cloud) {
  cloud.color_encoding = ColorEncoding::kUint8Srgb;
  cloud.color.resize(cloud.coefficient.size());
  std::transform(cloud.coefficient.begin(), cloud.coefficient.end(), cloud.color.begin(),
                 [](const Vec3f& w) {
                   return Vec3f(w.unaryExpr([](float c) { return c > 0 ? std::min(c, 1.0F) : 0; }));
                 });
}

}  // namespace surfel
