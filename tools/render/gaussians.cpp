#include "tools/render/gaussians.h"

#include <algorithm>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/timing.h>
#include <surfel/gaussian/gaussian_cut.h>
#include <surfel/gaussian/gaussian_extent.h>
#include <surfel/io/gaussian_io.h>

#include "tools/support/gaussians.h"
#include "tools/support/normal_maps.h"
#include "tools/support/options.h"

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
                                   "--progressive", "--image",
                                   "--wrap",        "--reference",
                                   "--shading",     "--relief",
                                   "--scene",       "--refraction",
                                   "--bounces",     "--color-by",
                                   "--color-map",   "--color-range",
                                   "--legend",      "--contact-sheet",
                                   "--keep",        "--print-commands",
                                   "--explain",     "--columns",
                                   "--level",       "--bounds",
                                   "--every"};
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

bool draws_gaussians(const tool::CommandLine& app, Settings& s) {
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
    if (s.rays.samples > kMostSamples) {
      throw_usage(fmt::format("--samples is {}; on Gaussians it must be in 1..{}", s.rays.samples,
                              kMostSamples));
    }
    s.gaussians.samples = s.rays.samples;
  }
  return true;
}

GaussianPainter::GaussianPainter(tool::Tool& tool, const Settings& s)
    : name_(fmt::format("{}", fmt::join(s.inputs, ", "))), options_(s.gaussians) {
  memory_ = memory_to_use(s.memory);
  load(tool, s);
  const GaussianCloud& said = levels_ ? levels_->head() : cloud_;
  options_.profile = s.profile.value_or(profile_of(said));
  options_.background = s.render.background;
  options_.depth = s.render.aovs;
  if (!levels_) require_memory(cloud_.size(), cloud_);
  renderer_ = std::make_shared<GaussianRenderer>(cloud_, options_);
  profile_ = name_of(options_.profile);
  tool::require_valid(
      tool::without_effect(tool.app(), options_without(options_.profile),
                           "with --profile " + profile_ + ", which the file asks for"));
  const std::size_t gaussians = levels_ ? levels_->finest() : cloud_.size();
  tool.note(fmt::format("{}: {} Gaussians{}, drawn as --profile {} does", name_, gaussians,
                        levels_ ? " with levels of detail" : "", profile_));
  tool.report()["gaussians"] = gaussians;
  tool.report()["profile"] = profile_;
}

/// Opens the file, and reads it unless pictures read parts of it.
void GaussianPainter::load(tool::Tool& tool, const Settings& s) {
  const std::string& file = s.inputs.front();
  const bool has_levels = s.inputs.size() == 1 && has_gaussian_levels(file);
  if (!has_levels && (s.lod == Lod::kOn || s.render.lod_error)) {
    throw_input(name_, s.inputs.size() == 1
                           ? "has no levels of detail; run surfel-lod on it"
                           : "levels of detail are drawn of one file; join the files with "
                             "surfel-convert and run surfel-lod on the result");
  }
  if (!has_levels || s.lod == Lod::kOff) cloud_ = load_all(tool, s);
  if (!has_levels) return;
  auto levels = std::make_unique<GaussianLevels>(file);
  // A scene is framed alike, whatever of it is drawn.
  constexpr std::size_t kFraming = 20000;
  const ClusterTree& tree = levels->head().tree;
  std::vector<std::uint32_t> clusters;
  for (std::uint32_t c = 0; c < tree.size(); ++c) {
    if (!clusters.empty() && tree[c].level != tree[clusters.back()].level) {
      const std::size_t count = tree[c].begin - tree[clusters.front()].begin;
      if (count >= kFraming) break;
      clusters.clear();
    }
    clusters.push_back(c);
  }
  sample_ = levels->read(clusters);
  if (s.lod == Lod::kOff) return;
  cloud_ = levels->head().without_gaussians();
  error_ = s.render.lod_error.value_or(kGaussianLodError);
  levels_ = std::move(levels);
}

/// Reads all Gaussians of files, unless the files say that they are too many.
GaussianCloud GaussianPainter::load_all(tool::Tool& tool, const Settings& s) {
  std::size_t total = 0;
  return tool::load_gaussians(tool, s.inputs,
                              {.accept = [&](std::size_t count, const GaussianCloud& head) {
                                total += count;
                                options_.profile = s.profile.value_or(profile_of(head));
                                require_memory(total, head);
                              }});
}

/// Throws Error(kInput) where so many Gaussians take more memory than they may.
void GaussianPainter::require_memory(std::size_t gaussians, const GaussianCloud& head) const {
  const std::uint64_t needed = gaussian_memory(gaussians, head, options_.profile);
  if (needed <= memory_) return;
  throw_input(
      name_,
      fmt::format("to draw {} Gaussians takes {:.4g} MB, more than the {:.4g} MB that they "
                  "may take; {}",
                  gaussians, static_cast<double>(needed) / 1e6, static_cast<double>(memory_) / 1e6,
                  levels_ ? "a larger --lod-error draws fewer"
                          : "run surfel-lod on the file, so that pictures read what they "
                            "show, or surfel-simplify; or give more --memory"));
}

/// Reads what a picture shows of levels.
void GaussianPainter::choose_clusters(const Camera& camera) {
  if (!levels_) return;
  const ClusterTree& tree = levels_->head().tree;
  const std::vector<std::uint32_t> clusters =
      gaussian_cut(levels_->head(), camera, options_, error_);
  std::size_t count = 0;
  for (const std::uint32_t c : clusters) count += tree[c].end - tree[c].begin;
  require_memory(count, cloud_);
  cloud_ = {};  // Before others take its place.
  cloud_ = levels_->read(clusters);
  clusters_ = clusters;
}

SceneExtent GaussianPainter::extent() const {
  return gaussian_extent(sample_.size() > 0 ? sample_ : cloud_);
}

void GaussianPainter::aim(tool::Tool& tool, const Settings& s,
                          std::vector<AskedView>& views) const {
  const GaussianCloud& sample = sample_.size() > 0 ? sample_ : cloud_;
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
  if (needs_guess(s, views)) render_tool::aim(tool, s, sample_surface(sample), hints, views);
}

std::vector<PixelExplanation> GaussianPainter::explain(const Settings& s, const Camera& camera) {
  std::vector<PixelExplanation> all;
  for (const auto& [x, y] : s.explained_pixels) {
    PixelExplanation& pixel = all.emplace_back(renderer_->explain(camera, x, y));
    if (!levels_) continue;
    // Levels that a file stores have no Gaussians that cannot be drawn.
    std::vector<std::uint64_t> place;
    for (const std::uint32_t c : clusters_) {
      const auto& cluster = levels_->head().tree[c];
      for (std::uint64_t i = cluster.begin; i < cluster.end; ++i) place.push_back(i);
    }
    for (ExplainedSplat& splat : pixel.splats) splat.surfel = place[splat.surfel];
  }
  return all;
}

Paint GaussianPainter::paint() {
  return [this](const Camera& camera, FrameStatistics& statistics,
                const std::function<void(double)>&) {
    const Timer timer;
    choose_clusters(camera);
    StageTimes stages;
    if (levels_) stages.add("read", timer.milliseconds());
    GaussianFrameStatistics frame;
    Image image = renderer_->render(camera, &frame);
    for (const auto& [stage, ms] : frame.stages.stages()) stages.add(stage, ms);
    statistics.milliseconds = timer.milliseconds();
    statistics.splats = frame.splats;
    statistics.stages = stages;
    return image;
  };
}

}  // namespace surfel::render_tool
