#pragma once

#include <cstddef>

#include <surfel/render/renderer.h>
#include <surfel/scene/camera.h>
#include <surfel/store/cloud_loader.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// What the report says of a picture.
tool::Json to_json(const FrameStatistics& frame);

/// Tells where a picture is incomplete.
void warn(const tool::Tool& tool, const Settings& s, std::size_t picture,
          const FrameStatistics& frame);

/// Tells the choices that were made for a picture, and why.
void explain(const tool::Tool& tool, const Settings& s, const LoadedCloud& loaded,
             const Camera& camera, const FrameStatistics& frame);

}  // namespace surfel::render_tool
