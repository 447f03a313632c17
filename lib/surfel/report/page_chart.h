#pragma once

// Small charts of pages, as SVG in the page's own colours.

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/measure/histogram.h>
#include <surfel/scene/color_map.h>

namespace surfel {

/// Counts of values in bins of equal width; values outside are counted in the outermost ones, and
/// values that are not finite are left out. `least` < `most`.
SURFEL_API Histogram histogram_of(const std::vector<double>& values, double least, double most,
                                  std::size_t bins);

/// A bar for each count.
/// \param histogram    Counts, and the values at the ends of bars.
/// \param logarithmic  Heights are logarithms of the counts, so that few are seen beside many.
/// \return An `svg` element.
SURFEL_API std::string histogram_svg(const Histogram& histogram, bool logarithmic = false);

/// Counts of red, green and blue values in bins from 0 to 1, over one another.
SURFEL_API std::string color_histogram_svg(const std::array<std::vector<std::size_t>, 3>& counts);

/// Counts by name, the larger ones first, as bars of the names' widths. Names are escaped.
SURFEL_API std::string named_counts_svg(
    const std::vector<std::pair<std::string, std::size_t>>& counts);

/// A colour map with the values of its ends, and of places between.
SURFEL_API std::string color_scale_svg(ColorMap map, double least, double most,
                                       const std::string& unit);

/// A number as people read it: five figures.
SURFEL_API std::string shown_number(double value);

}  // namespace surfel
