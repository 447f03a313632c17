#pragma once

#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/lens.h>

namespace surfel {

/// A view whose camera is wholly known, as a photograph's may be.
struct View {
  std::string name;  ///< Of its picture; a file's name, which other programs wrote.
  Camera camera;
  std::optional<Lens> lens = {};    ///< Unset: a pinhole, or an orthographic camera.
  std::optional<double> time = {};  ///< Seconds, for paths.
};

/// The direction that is up in the views' pictures in the mean, a unit vector; y where the views
/// have none in common.
SURFEL_API Vec3d mean_up(const std::vector<View>& views);

/// The views of pictures of another size, which show the same: lengths in pixels grow with the
/// sides. Throws Error(kUsage) naming the first view whose picture has another shape, by more than
/// rounding to whole pixels explains.
SURFEL_API void resize_views(std::vector<View>& views, int width, int height);

/// Names for files in one folder, one for each view: without folders and extension, with _ for
/// characters that shells or systems take for more than a letter. What is empty is called view;
/// names that have occurred get a number.
SURFEL_API std::vector<std::string> file_names(const std::vector<View>& views);

}  // namespace surfel
