#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/gaussian_cloud.h>

#include "tools/render/painters.h"
#include "tools/render/settings.h"
#include "tools/render/views.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Are Gaussians in space to be drawn, as one of the files says? Throws Error(kUsage) for options
/// that have no effect on what is drawn: on Gaussians, or --profile on anything else.
bool draws_gaussians(const CLI::App& app, Settings& s);

/// Files of Gaussians, joined, and their renderer.
class GaussianPainter {
 public:
  /// Reads the files that the settings name, and says by which profile they are drawn.
  GaussianPainter(tool::Tool& tool, const Settings& s);
  GaussianPainter(const GaussianPainter&) = delete;
  GaussianPainter& operator=(const GaussianPainter&) = delete;

  SceneExtent extent() const;
  /// Name of the profile by which they are drawn.
  const std::string& profile() const { return profile_; }
  /// Completes the views by guesses, where up is what the file or the custom of trained files says,
  /// and says so.
  void aim(tool::Tool& tool, const Settings& s, std::vector<AskedView>& views) const;
  /// Makes pictures, as long as this object lives.
  Paint paint() const;

 private:
  GaussianCloud cloud_;
  std::string profile_;
  std::shared_ptr<GaussianRenderer> renderer_;  ///< Refers to the cloud.
};

}  // namespace surfel::render_tool
