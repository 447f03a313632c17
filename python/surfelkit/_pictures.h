#pragma once

// Pictures as Python has them.

#include <memory>
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

using HeldPicture = std::shared_ptr<Picture>;

/// A picture, or one of an array (H, W), (H, W, 3) or (H, W, 4): floats are linear light,
/// premultiplied, uint8 and uint16 sRGB codes with straight alpha.
HeldPicture picture_of(const py::object& given);

/// An image for a texture, linear with straight alpha: a Picture, or an array (H, W, 3 or 4), of
/// which uint8 and uint16 are sRGB codes.
Image texture_image(const py::object& given);

}  // namespace surfel::python
