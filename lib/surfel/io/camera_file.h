#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/framing.h>

namespace surfel {

/// Reads cameras from TOML: keys eye, from, target, up, fov, ortho, size = [w, h], near, zoom,
/// frame-all, name, time at top level or, for several views, in tables [[camera]]. Keys that a file
/// leaves out have the values of `defaults`. Throws Error naming file and line; an unknown key is
/// an error.
SURFEL_API std::vector<CameraOptions> read_cameras(const std::string& path,
                                                   const CameraOptions& defaults);
/// Reads cameras from a file that is open, or in memory.
SURFEL_API std::vector<CameraOptions> read_cameras(const InputFile& file,
                                                   const CameraOptions& defaults);

}  // namespace surfel
