#pragma once

#include <string>
#include <vector>

#include <surfel/render/legend.h>
#include <surfel/render/pixel_explanation.h>
#include <surfel/scene/scene.h>
#include <surfel/scene/view.h>
#include <surfel/store/cloud_loader.h>

#include "tools/render/settings.h"

namespace surfel::render_tool {

/// Throws Error(kUsage) where a picture has not the pixels that are to be explained.
void require_pixels(const Settings& s, const std::vector<View>& views);

/// The pixels of a picture of surfels that are to be explained, explained.
std::vector<PixelExplanation> explain_pixels(const Settings& s, const LoadedCloud& surfels,
                                             const Scene& scene, const Camera& camera);

/// What the report says of an explained pixel.
/// \param legend  what colours stand for; null: nothing.
tool::Json to_json(const PixelExplanation& pixel, const Legend* legend);

/// An explained pixel in words and tables.
/// \param picture  its name.
std::string to_text(const PixelExplanation& pixel, const std::string& picture,
                    const Legend* legend);

}  // namespace surfel::render_tool
