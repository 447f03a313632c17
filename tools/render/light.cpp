#include "tools/render/light.h"

#include <fmt/format.h>

namespace surfel::render_tool {

void choose_light(tool::Tool& tool, Settings& s, const std::string& name, ColorLight colors,
                  bool transparent) {
  // Who describes a scene wants to see its light.
  const bool free = s.shading == Shading::kAuto && s.scene_file.empty();
  if (free && colors == ColorLight::kRecorded) {
    s.render.lit = false;
    tool.note(fmt::format(
        "{}: colours shown as they were recorded, unlit; --shading phong lights them", name));
  }
  if (free && colors == ColorLight::kMixed) {
    tool.note(
        fmt::format("{}: some colours were recorded, some are the surfaces' own; all are "
                    "lit, and --shading none shows them as they are",
                    name));
  }
  if (s.relief != ReliefChoice::kAuto) return;
  const bool fast = !s.reference && s.filter != Filter::kEwaSource && !blends_layers(s);
  if (fast && s.render.lit && s.scene_file.empty() && colors == ColorLight::kUnsaid &&
      !transparent) {
    s.render.relief = Relief::kOcclusion;
  }
}

}  // namespace surfel::render_tool
