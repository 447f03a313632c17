#pragma once

#include <string_view>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/image.h>

namespace surfel {

// Text in pictures, of strokes that the library brings itself, so that it looks alike wherever it
// is drawn. ASCII; every other byte is a box.

/// Width of a line of text whose capitals are one pixel high, pixels.
SURFEL_API double text_width(std::string_view text);

/// Composites a colour over a pixel of a picture, whose first four channels are premultiplied R G B
/// A.
/// \param cover  share of the pixel, 0..1.
SURFEL_API void blend_over(float* pixel, const Vec3f& color, double cover);

/// Draws a line of text over a picture's first four channels, antialiased by the area that strokes
/// cover of a pixel. What lies outside of the picture is left out.
/// \param left, baseline  where the text begins, pixels from the upper left corner.
/// \param height          of a capital, pixels, > 0.
SURFEL_API void draw_text(Image& image, std::string_view text, double left, double baseline,
                          double height, const Vec3f& color);

}  // namespace surfel
