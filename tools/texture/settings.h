#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>

#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_source.h>

#include "tools/support/normal_maps.h"

namespace surfel::texture_tool {

/// What coefficients are fitted to.
enum class From { kTexture, kColors };

/// The options of surfel-texture.
struct Settings {
  std::string input;
  std::string output;
  std::string mesh;
  TextureSourceOptions source;
  std::string solid_name;
  SolidTextureOptions solid;  ///< But for pattern and frequency, which the name has.
  TextureFitOptions fit;
  tool::NormalMapSettings normals;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  bool no_charts = false;
  bool resume = false;  ///< Keep what an interrupted run has made.
  From from = From::kTexture;
  std::optional<Eigen::Vector2d> bounds;
};

void declare_options(tool::CommandLine& app, Settings& s);

/// Checks the options, and completes what follows from others. Throws Error(kUsage).
void settle(const tool::CommandLine& app, Settings& s);

/// Refuses options of fits where there are no colours to be fitted.
void refuse_fits(const tool::CommandLine& app);

}  // namespace surfel::texture_tool
