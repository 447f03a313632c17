#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/surface_sample.h>
#include <surfel/scene/view.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// A view as it is asked for.
struct AskedView {
  CameraOptions options;
  std::optional<View> known;  ///< Stands for the options, but for their `up` and `name`.
  Vec3d likely_up{0, 1, 0};   ///< Up in the scene, where neither the options nor the file say it.
};

/// The views as they are asked for.
std::vector<AskedView> asked_views(const Settings& s);

/// Is a guess needed for one of them?
bool needs_guess(const Settings& s, const std::vector<AskedView>& views);

/// A picture to be made.
struct Shot {
  std::size_t number;  ///< Among all that the settings ask for, from 0 on.
  std::string file;
};

/// The pictures to be made: --frames leaves some out, and pictures that are there already may be
/// skipped. Throws Error(kUsage) where there are several and one file, Error(kInput) where
/// another picture is there.
/// \param output  the picture, or a pattern of their names.
std::vector<Shot> asked_shots(const tool::Tool& tool, const Settings& s, const std::string& output,
                              const std::vector<AskedView>& views);

/// Completes the views by guesses, and says the first.
void aim(tool::Tool& tool, const Settings& s, const SurfaceSample& sample, ViewHints hints,
         std::vector<AskedView>& views);

/// The views of all pictures, along the path where one is asked for. Throws Error where the views
/// are no key frames of a path.
std::vector<View> complete_views(const tool::Tool& tool, const Settings& s,
                                 const std::vector<AskedView>& views, const SceneExtent& scene);

/// Is the name of a picture a pattern, with a %d or %04d to be replaced by its number, or a {name}
/// by the view's?
bool is_pattern(const std::string& name);

/// Half a pixel of the pictures that are asked for, scene units in the middle of what is seen: the
/// least of them.
double half_a_pixel(const std::vector<AskedView>& views, const Bounds& box);

/// Distance from the eye to the box's nearest corner by that to its middle, the least of all views;
/// at most 1, and 0.05 from within.
double nearest_share(const std::vector<AskedView>& views, const Bounds& box);

}  // namespace surfel::render_tool
