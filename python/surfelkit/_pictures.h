#pragma once

// Pictures as Python has them.

#include <optional>

#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>

#include "_core.h"

namespace surfel::python {

/// A picture, and the camera that drew it, where that is known.
struct Picture {
  Image image;
  std::optional<Camera> camera;
};

/// An image for a texture, linear with straight alpha: a Picture, or an array (H, W, 3 or 4), of
/// which uint8 and uint16 are sRGB codes.
Image texture_image(const py::object& given);

}  // namespace surfel::python
