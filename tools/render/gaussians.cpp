#include "tools/render/gaussians.h"

#include <algorithm>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/gaussian/gaussian_extent.h>
#include <surfel/io/gaussian_io.h>

#include "tools/support/normal_maps.h"
#include "tools/support/options.h"
#include "tools/support/surfels.h"

namespace surfel::render_tool {
namespace {

const char* name_of(GaussianProfile profile) {
  for (const auto& [name, choice] : gaussian_profiles()) {
    if (choice == profile) return name.c_str();
  }
  return "";
}

/// Trained files have the axes of their cameras, whose y points down.
const Vec3d kTrainedUp(0, -1, 0);
constexpr const char* kTrainedReason = "as trained splats mostly have it; --up sets another";

/// Options that say nothing of Gaussians.
std::vector<std::string> options_of_surfels() {
  std::vector<std::string> options{"--kernel",      "--kernel-tolerance",
                                   "--filter",      "--cutoff",
                                   "--method",      "--voronoi",
                                   "--layers-by",   "--peel",
                                   "--layers",      "--depth-epsilon",
                                   "--cull",        "--coverage-threshold",
                                   "--lod",         "--lod-error",
                                   "--progressive", "--image",
                                   "--wrap",        "--reference",
                                   "--shading",     "--relief",
                                   "--scene",       "--refraction",
                                   "--bounces",     "--color-by",
                                   "--color-map",   "--color-range",
                                   "--legend",      "--contact-sheet",
                                   "--keep",        "--print-commands",
                                   "--explain",     "--memory",
                                   "--columns",     "--level",
                                   "--bounds",      "--every"};
  for (const std::string& option : tool::normal_map_options()) options.push_back(option);
  return options;
}

/// Options that a profile has no use for: the pixel filter of a trained renderer is its own, and
/// only exact pictures are filtered after they are blended.
std::vector<std::string> options_without(GaussianProfile profile) {
  if (profile == GaussianProfile::kExact) return {};
  if (profile == GaussianProfile::kSurfel) return {"--samples"};
  return {"--lowpass", "--samples"};
}

}  // namespace

bool draws_gaussians(const CLI::App& app, Settings& s) {
  const bool gaussians =
      s.mesh.empty() && std::any_of(s.inputs.begin(), s.inputs.end(),
                                    [](const std::string& file) { return holds_gaussians(file); });
  if (!gaussians) {
    tool::require_valid(
        tool::without_effect(app, {"--profile"}, "on what is no file of Gaussians"));
    if (!s.reference && s.mesh.empty()) {
      tool::require_valid(tool::without_effect(app, {"--samples"}, "with the fast renderer"));
    }
    return false;
  }
  tool::require_valid(tool::without_effect(app, options_of_surfels(), "on Gaussians"));
  if (s.profile) {
    tool::require_valid(tool::without_effect(app, options_without(*s.profile),
                                             std::string("with --profile ") + name_of(*s.profile)));
  }
  if (app.get_option("--lowpass")->count() > 0) {
    s.gaussians.lowpass = s.render.lowpass;
  } else {
    s.render.lowpass = s.gaussians.lowpass;
  }
  if (app.get_option("--samples")->count() > 0) {
    s.gaussians.samples = s.rays.samples;
    tool::require_valid(s.gaussians.problems());
  }
  return true;
}

GaussianPainter::GaussianPainter(tool::Tool& tool, const Settings& s)
    : cloud_(tool::read_gaussians(tool, s.inputs)) {
  GaussianOptions options = s.gaussians;
  options.profile = s.profile.value_or(profile_of(cloud_));
  options.background = s.render.background;
  options.depth = s.render.aovs;
  renderer_ = std::make_shared<GaussianRenderer>(cloud_, options);
  profile_ = name_of(options.profile);
  tool::require_valid(
      tool::without_effect(tool.app(), options_without(options.profile),
                           "with --profile " + profile_ + ", which the file asks for"));
  tool.note(fmt::format("{}: {} Gaussians, drawn as --profile {} does", fmt::join(s.inputs, ", "),
                        cloud_.size(), profile_));
  tool.report()["gaussians"] = cloud_.size();
  tool.report()["profile"] = profile_;
}

SceneExtent GaussianPainter::extent() const { return gaussian_extent(cloud_); }

void GaussianPainter::aim(tool::Tool& tool, const Settings& s,
                          std::vector<AskedView>& views) const {
  const Vec3d up = cloud_.up.value_or(kTrainedUp);
  const char* reason = cloud_.up ? "as the file says" : kTrainedReason;
  bool said = false;
  for (AskedView& asked : views) {
    asked.likely_up = up;
    if (asked.known || asked.options.up || s.view.guess_up) continue;
    if (s.view.needs_guess(asked.options)) continue;
    asked.options.up = up;
    if (!said) tool.note(fmt::format("up {:g},{:g},{:g} ({})", up.x(), up.y(), up.z(), reason));
    said = true;
  }
  ViewHints hints;
  if (!s.view.guess_up) {
    hints.up = up;
    hints.up_reason = reason;
  }
  if (needs_guess(s, views)) render_tool::aim(tool, s, sample_surface(cloud_), hints, views);
}

Paint GaussianPainter::paint() const {
  return [renderer = renderer_](const Camera& camera, FrameStatistics& statistics,
                                const std::function<void(double)>&) {
    GaussianFrameStatistics frame;
    Image image = renderer->render(camera, &frame);
    statistics.milliseconds = frame.milliseconds;
    statistics.splats = frame.splats;
    statistics.stages = frame.stages;
    return image;
  };
}

}  // namespace surfel::render_tool
