#pragma once

#include <memory>

#include <surfel/io/image_io.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/image.h>

namespace surfel {

// PNG files are read by libpng itself: to load OpenImageIO takes longer than to decode most of
// them. All functions are internal to the io module.

/// Does the content start as a PNG file does?
bool is_png(const InputFile& file);

/// read_image() of a PNG file.
Image read_png(InputFile file, ImageForm form);

/// open_image() of a PNG file. Of an interlaced file all pixels are kept in memory.
std::shared_ptr<ImageReader> open_png(InputFile file);

}  // namespace surfel
