#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/color_map.h>
#include <surfel/scene/image.h>

namespace surfel {

/// What the colours of a picture stand for.
struct Legend {
  /// A category and its colour.
  struct Entry {
    Vec3f color;  ///< Linear.
    std::string text;
    std::size_t count = 0;  ///< The entries of most are shown where there is no room for all.
  };
  std::string title;
  std::vector<Entry> entries = {};  ///< Empty: a bar of the colour map.
  ColorMap map = ColorMap::kViridis;
  double min = 0, max = 1;  ///< Values of the map's ends. Where they agree, the bar has one tick.

  /// Pictures of fewer pixels in either direction have no room for a legend.
  static constexpr int kLeastPixels = 256;
};

/// A number at which a scale has a mark.
struct Tick {
  double value;
  std::string text;
};
/// The multiples of 1, 2 or 5 times a power of ten in [min, max], as near to each other as gives
/// `most` at most (2 or more), with as many decimals as tell them apart; numbers below 0.001 or of
/// ten digits and more have exponents. One tick at min where both are the same but for rounding.
SURFEL_API std::vector<Tick> round_ticks(double min, double max, int most);

/// Draws a legend into the lower right corner of a picture, over its first four channels, which are
/// premultiplied R G B A: a translucent white panel with dark text, whose size follows the
/// picture's shorter side. Texts without room are cut short. Returns false, and draws nothing, if
/// the picture is smaller than Legend::kLeastPixels.
SURFEL_API bool draw_legend(const Legend& legend, Image& image);

}  // namespace surfel
