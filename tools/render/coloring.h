#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/render/legend.h>
#include <surfel/scene/view.h>
#include <surfel/store/cloud_loader.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Colours of surfels by an attribute, as the settings ask for it.
struct Coloring {
  std::string file;                                         ///< For messages.
  std::optional<Vec3d> up;                                  ///< As given.
  std::vector<std::pair<std::string, std::string>> filled;  ///< Intake::Made::filled.
  bool colored = false;                                     ///< By an attribute; set by wrap().
  std::optional<Legend> legend;  ///< What the colours stand for; set by wrap().

  /// The source coloured by the attribute that the settings name, or that suits colourless surfels;
  /// null where they keep their colours. Tells and reports what the colours stand for. Throws
  /// Error(kInput) where there is no such attribute, or no surfel has a value.
  std::unique_ptr<SurfelSource> wrap(tool::Tool& tool, const Settings& s, const CloudFacts& facts);
};

/// Throws Error(kUsage) if one of the pictures is too small for a legend.
void require_room(const std::vector<View>& views);

}  // namespace surfel::render_tool
