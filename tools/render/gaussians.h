#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/io/gaussian_levels.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/gaussian_cloud.h>

#include "tools/render/painters.h"
#include "tools/render/settings.h"
#include "tools/render/views.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Are Gaussians in space to be drawn, as one of the files says? Throws Error(kUsage) for options
/// that have no effect on what is drawn: on Gaussians, or --profile on anything else.
bool draws_gaussians(const tool::CommandLine& app, Settings& s);

/// Files of Gaussians, joined, and their renderer. Of a single file with levels of detail the
/// clusters alone that a picture shows are read, for each picture anew.
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
  Paint paint();
  /// The pixels of a picture that are to be explained, explained.
  std::vector<PixelExplanation> explain(const Settings& s, const Camera& camera);

 private:
  void load(tool::Tool& tool, const Settings& s);
  GaussianCloud load_all(tool::Tool& tool, const Settings& s);
  void require_memory(std::size_t gaussians, const GaussianCloud& head) const;
  void choose_clusters(const Camera& camera);

  std::string name_;  ///< Of the files.
  std::string profile_;
  std::unique_ptr<GaussianLevels> levels_;  ///< Null where all Gaussians are in memory.
  GaussianOptions options_;
  std::vector<std::uint32_t> clusters_;  ///< Of levels: what the last picture drew.
  double error_ = 0;                     ///< Of levels, pixels.
  std::uint64_t memory_ = 0;             ///< Bytes that Gaussians may take while they are drawn.
  GaussianCloud cloud_;                  ///< What is drawn; of levels what the last picture drew.
  GaussianCloud sample_;                 ///< Of levels: a coarse one, by which the scene is framed.
  std::shared_ptr<GaussianRenderer> renderer_;  ///< Refers to the cloud.
};

}  // namespace surfel::render_tool
