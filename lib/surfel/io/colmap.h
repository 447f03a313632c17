#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/view.h>

namespace surfel {

/// Reads the views of a reconstruction that COLMAP wrote (https://colmap.github.io/format.html): a
/// folder of cameras.bin and images.bin or, where one of them is missing, cameras.txt and
/// images.txt, or with one of these in its folder sparse/0, sparse or 0. The poses of images are
/// all that is needed, so that rigs and frames (COLMAP 3.12) are not read. Views come by their
/// names.
///
/// Cameras are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE,
/// SIMPLE_RADIAL_FISHEYE or RADIAL_FISHEYE. Throws Error (kIo, kInput) naming file and line, or
/// image; for other cameras with the command that undistorts the pictures.
SURFEL_API std::vector<View> read_colmap(const std::string& folder);
/// Reads files that are open, or in memory. They are binary where their names end with .bin.
SURFEL_API std::vector<View> read_colmap(const InputFile& cameras, const InputFile& images);

/// Does read_colmap() find files in this folder?
SURFEL_API bool holds_colmap(const std::string& folder);

}  // namespace surfel
