#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/surface_sample.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// The cameras as they are asked for.
std::vector<CameraOptions> asked_views(const Settings& s);

/// Is a guess needed for one of them?
bool needs_guess(const Settings& s, const std::vector<CameraOptions>& views);

/// Completes the views by guesses, and says the first.
void aim(tool::Tool& tool, const Settings& s, const SurfaceSample& sample, ViewHints hints,
         std::vector<CameraOptions>& views);

/// The cameras to render from. Throws Error(kUsage) where there are several and one picture.
std::vector<Camera> cameras(const tool::Tool& tool, const Settings& s,
                            const std::vector<CameraOptions>& views, const SceneExtent& scene);

/// Half a pixel of the pictures that are asked for, scene units in the middle of what is seen: the
/// least of them.
double half_a_pixel(const std::vector<CameraOptions>& views, const Bounds& box);

/// Is the name of a picture a pattern, with a %d or %04d to be replaced by its number?
bool is_pattern(const std::string& name);

/// Name of the i-th picture by a pattern.
std::string picture_name(const std::string& pattern, std::size_t i);

}  // namespace surfel::render_tool
