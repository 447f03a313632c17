#pragma once

// Pages to look at surfels: one file of HTML each, which draws them by WebGL2.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/scene/framing.h>
#include <surfel/view/view_cloud.h>

namespace surfel {

/// What a page begins with.
struct ViewPageOptions {
  Vec3d eye{0, 0, 1};
  Vec3d target{0, 0, 0};
  Vec3d up{0, 1, 0};
  double fov = 40;                ///< Vertical field of view, degrees.
  std::optional<double> ortho{};  ///< Orthographic instead: visible height in scene units, > 0.
  std::string generator{};        ///< Tool and version, for the page's head.
  /// Most bytes of a page; a larger one is refused. Browsers hold a page's text twice while they
  /// read it.
  std::uint64_t most_bytes = std::uint64_t{256} << 20;
};

/// Hands the text of a page on, piece by piece: the surfels of one file or of two are in it, and it
/// asks for nothing else. Throws Error(kInput) where it would be larger than it may be, before
/// anything is handed on.
SURFEL_API void write_view_page(const std::vector<const ViewCloud*>& clouds,
                                const ViewPageOptions& options,
                                FunctionRef<void(std::string_view text)> write);

/// The page without surfels, which asks the server that it comes from for them (ViewService).
SURFEL_API std::string served_view_page(const std::vector<const ViewCloud*>& clouds,
                                        const ViewPageOptions& options);

/// Bytes in base64, appended to a text.
SURFEL_API void append_base64(std::string_view bytes, std::string& to);

}  // namespace surfel
