#pragma once

namespace surfel {

/// The continuation of an image beyond its borders.
enum class WrapMode {
  kRepeat,   ///< The image again.
  kMirror,   ///< The image mirrored at each border.
  kClamp,    ///< The border texels, without end.
  kNothing,  ///< Nothing: no colour and no weight.
};

}  // namespace surfel
