#include "tools/texture/settings.h"

#include <vector>

#include <surfel/surface/coverage_threshold.h>
#include <surfel/texture/fit_blocks.h>

#include "tools/support/color.h"
#include "tools/support/options.h"
#include "tools/support/resume.h"
#include "tools/support/tool.h"

namespace surfel::texture_tool {
namespace {

/// Options of the least-squares fits.
void declare_systems(tool::CommandLine& app, Settings& s) {
  app.group("Systems of equations (--fit gram, render)");
  tool::add_choice(app, "--solver", s.fit.solver,
                   {{"cg", FitSolver::kConjugateGradients}, {"ceres", FitSolver::kCeres}},
                   "cg = preconditioned conjugate gradients; ceres = least squares by Ceres, to "
                   "compare with, for small systems");
  app.add_option("--tolerance", s.fit.tolerance,
                 "Of cg: relative residual; of ceres and --robust: relative change of the "
                 "coefficients in the last step; 1e-14..0.1");
  tool::add_text(app, "--lambda", "X", "auto",
                 "Weight of the distance to ewa's coefficients by the system's mean diagonal, "
                 "0..1e6, or auto: render 0.03 (from colors 0.5), gram what keeps the condition "
                 "below 1e6 and lets cg converge",
                 [&s](const std::string& text) {
                   if (text == "auto") {
                     s.fit.lambda.reset();
                   } else {
                     s.fit.lambda = tool::parse_numbers("--lambda", text, 1).front();
                   }
                 });
  tool::add_vector(app, "--bounds", s.bounds,
                   "Of cg: keep coefficients within these two, such as 0,1");
  tool::add_choice(
      app, "--right-side", s.fit.right_side,
      {{"published", GramRightSide::kPublished}, {"normalised", GramRightSide::kNormalised}},
      "Of --fit gram, the c of R w = c: published = the integrals of SS01 (11), the "
      "optimum for the plain sum of all kernels, the default; normalised = by the "
      "kernels' sum, by which the renderer divides, the only one of --from colors");
  app.add_option("--cutoff", s.fit.cutoff,
                 "Of --fit render: the --cutoff that surfel-render is going to use, 0.1..16");
  app.add_option(
      "--points", s.fit.points,
      "Of --fit render: points of the surface a surfel that are fitted, 1..256; default: "
      "6, 12 with --refine-variance");
  tool::add_text(app, "--robust", "X", "",
                 "Of --fit render: residuals longer than this, linear R G B, are outliers and "
                 "count by their length instead of its square (Huber's loss), > 0, or auto: twice "
                 "the median residual",
                 [&s](const std::string& text) {
                   s.fit.robust = true;
                   if (text == "auto") {
                     s.fit.robust_scale.reset();
                   } else {
                     s.fit.robust_scale = tool::parse_numbers("--robust", text, 1).front();
                   }
                 });
  app.add_flag(
      "--refine-variance", s.fit.refine_variance,
      "Of --fit render: fit the surfels' variances together with the coefficients, "
      "standard deviations within 1/2..2 of what they were; takes about 0.5 ms of one core "
      "a surfel");
  app.group("Options");
}

/// Options of solid textures.
void declare_solid(tool::CommandLine& app, Settings& s) {
  app.group("Solid textures (--solid)");
  app.add_option(
      "--solid", s.solid_name,
      "Texture that fills space and needs no uv: checker, noise, marble, wood, each also "
      "as NAME:FREQUENCY, features (cubes, blots, veins, rings) along the diagonal of "
      "the surfels' bounds; default: checker 16, noise 12, marble 9, wood 32");
  app.add_option("--feature-size", s.solid.feature_size,
                 "Size of a feature in scene units, instead of a frequency, > 0");
  tool::add_vector(app, "--center", s.solid.center,
                   "Where the centre of the pattern's block lies, world coordinates; default: "
                   "centre of the surfels' bounds");
  app.add_option("--octaves", s.solid.octaves,
                 "Of noise, marble and wood: octaves of the noise, 1..16");
  app.add_option("--seed", s.solid.seed, "Of noise, marble and wood: chooses the noise");
  tool::add_color(app, "--dark", s.solid.dark,
                  "Dark colour: a name, #rrggbb, or linear R,G,B; default: the pattern's own");
  tool::add_color(app, "--light", s.solid.light,
                  "Light colour: a name, #rrggbb, or linear R,G,B; default: the pattern's own");
  app.group("Options");
}

/// Completes the options of the solid texture, if there is one, and adds what is wrong with them.
void check_solid(const tool::CommandLine& app, Settings& s, std::vector<std::string>& problems) {
  using tool::append;
  using tool::without_effect;
  if (s.solid_name.empty()) {
    append(problems,
           without_effect(
               app, {"--feature-size", "--center", "--octaves", "--seed", "--dark", "--light"},
               "without --solid"));
    return;
  }
  const SolidTextureOptions named = solid_texture_options(s.solid_name);
  s.solid.pattern = named.pattern;
  s.solid.frequency = named.frequency;
  append(problems, s.solid.problems());
  append(problems, without_effect(app,
                                  {"--image", "--no-charts", "--wrap", "--reconstruction",
                                   "--prefilter", "--max-aspect", "--exact"},
                                  "with --solid"));
  if (s.normals.maps.empty()) append(problems, without_effect(app, {"--mesh"}, "with --solid"));
  if (named.pattern == SolidPattern::kChecker) {
    append(problems, without_effect(app, {"--octaves", "--seed"}, "with --solid checker"));
  }
  if (s.from == From::kColors) {
    problems.emplace_back("--solid and --from colors do not go together; leave one out");
  }
}

}  // namespace

void declare_options(tool::CommandLine& app, Settings& s) {
  app.add_option("surfels", s.input, "Surfels (PLY, PCD, LAS, LAZ; - = standard input)")
      ->required();
  app.add_option("-o,--output", s.output, "Surfels to write (- = standard output)")->required();
  app.add_option("--image", s.source.image,
                 "Image file, or checker, siemens, noise, each also as NAME:FREQUENCY; default: "
                 "the images of the mesh's materials");
  app.add_option("--mesh", s.mesh,
                 "The mesh that the surfels were sampled from: its materials' images, and its "
                 "charts, beyond whose borders no kernel takes colour");
  app.add_flag("--no-charts", s.no_charts, "Let kernels take colour from beyond their chart");
  tool::add_choice(
      app, "--wrap", s.source.wrap,
      {{"repeat", WrapMode::kRepeat}, {"mirror", WrapMode::kMirror}, {"clamp", WrapMode::kClamp}},
      "What lies beyond the image's borders; default: as the mesh's materials say, else repeat");
  tool::add_choice(app, "--from", s.from, {{"texture", From::kTexture}, {"colors", From::kColors}},
                   "What the coefficients are fitted to: an image, or the surfels' own colours");
  tool::add_choice(app, "--fit", s.fit.kind,
                   {{"ewa", TextureFitKind::kEwa},
                    {"gram", TextureFitKind::kGram},
                    {"render", TextureFitKind::kRender}},
                   "How coefficients are found: ewa = view-independent EWA; gram = R w = c, the "
                   "least squares of the plain sum of all kernels; render = least squares for what "
                   "surfel-render "
                   "makes of them: the sharpest under magnification");
  app.add_option("--reconstruction", s.fit.reconstruction,
                 "Standard deviation of a Gaussian that reconstructs the texture, texels, "
                 "0.25..16, 1 as published; default: bilinear interpolation of the texels");
  app.add_option("--prefilter", s.fit.prefilter,
                 "With --fit ewa: variance of the kernel that filters the texture, by the "
                 "surfel's own, 1/16..4. 1 is as published; 0.5 is sharper where surfels are less "
                 "than a pixel apart or magnified, and noisier where they are far away");
  app.add_option("--max-aspect", s.fit.max_aspect,
                 "Kernels longer than this many times their width are widened, 1..10000");
  app.add_flag("--exact", s.fit.exact,
               "Sum over the image's own texels whatever it takes, instead of a pyramid's");

  declare_solid(app, s);
  app.group("Normals");
  tool::add_normal_maps(app, s.normals);
  declare_systems(app, s);
  tool::add_memory(app, s.memory,
                   "Memory for surfels; a binary PLY file may be larger, and is textured block by "
                   "block; with --fit gram and render it has to be in space-filling order "
                   "(surfel-convert --sort curve)");
  tool::add_resume(app, s.resume);
}

void refuse_fits(const tool::CommandLine& app) {
  tool::require_valid(tool::without_effect(
      app,
      {"--fit", "--prefilter", "--solver", "--tolerance", "--lambda", "--bounds", "--cutoff",
       "--points", "--robust", "--refine-variance", "--right-side"},
      "with normals alone"));
}

void settle(const tool::CommandLine& app, Settings& s) {
  if (s.bounds) s.fit.bounds = {s.bounds->x(), s.bounds->y()};
  std::vector<std::string> problems = s.fit.problems();
  check_solid(app, s, problems);
  const auto refuse = [&](const std::vector<std::string>& options, const std::string& where) {
    tool::append(problems, tool::without_effect(app, options, where));
  };
  if (s.fit.kind == TextureFitKind::kEwa) {
    refuse({"--solver", "--tolerance", "--lambda", "--bounds"}, "with --fit ewa");
  }
  if (s.fit.kind != TextureFitKind::kRender) {
    refuse({"--cutoff", "--points"}, "without --fit render");
  }
  if (s.from == From::kColors) {
    refuse({"--image", "--mesh", "--no-charts", "--wrap", "--reconstruction", "--prefilter",
            "--max-aspect", "--exact", "--points", "--refine-variance"},
           "with --from colors");
    refuse(tool::normal_map_options(), "with --from colors");
    if (s.fit.kind == TextureFitKind::kEwa) {
      problems.emplace_back(
          "--from colors is for --fit gram and render: ewa leaves them as they are");
    }
  } else if (s.source.image.empty() && s.mesh.empty() && s.solid_name.empty()) {
    if (s.normals.maps.empty()) {
      problems.emplace_back(
          "there is neither --image nor --mesh nor --solid, nor a --normal-map or --bump alone; "
          "give "
          "one");
    }
    refuse_fits(app);
  }
  if (s.resume) {
    for (const std::string& problem : fit_block_problems(s.fit)) {
      problems.push_back(problem + ", and cannot be taken up: leave out --resume");
    }
  }
  tool::append(problems, s.normals.maps.problems());
  tool::require_valid(problems);
  s.fit.coverage = coverage_threshold(s.fit.cutoff);
}

}  // namespace surfel::texture_tool
