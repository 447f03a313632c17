#pragma once

#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/view.h>

namespace surfel {

/// How views are read from a file.
struct ViewFileOptions {
  /// Pictures of files that do not tell their size, as the oldest transforms.json.
  int width = 0;  ///< Pixels; 0 = unknown, and such files are refused.
  int height = 0;
  /// Of transforms.json: places in the world that the poses had before the file's
  /// `applied_transform`, which nerfstudio moved them by.
  bool original_world = false;
};

/// Reads the views of a folder that COLMAP wrote (colmap.h), of a transforms.json (NeRF,
/// instant-ngp, nerfstudio; transforms_json.h) or of intrinsics and poses as JSON (pose_json.h).
/// Throws Error (kIo, kInput, kUsage) naming the file and the place in it.
SURFEL_API std::vector<View> read_views(const std::string& path,
                                        const ViewFileOptions& options = {});
/// Reads JSON that is open, or in memory.
SURFEL_API std::vector<View> read_views(const InputFile& file, const ViewFileOptions& options = {});

}  // namespace surfel
