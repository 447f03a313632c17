#pragma once

#include <string>
#include <vector>

#include <surfel/scene/map_place.h>

namespace surfel {

/// Adds the tags of GeoTIFF 1.1 to the bytes of a TIFF file: ModelPixelScale, ModelTiepoint, and
/// the keys that say that pixels are areas, and in which coordinate system where it is known. The
/// directory is written anew behind the file's last byte, and its first 8 bytes lead to it. Throws
/// Error(kIo) starting with `name` for what is no little-endian classic TIFF file, which is what
/// OpenImageIO writes below 4 GB. Internal to the io module.
void add_geo_tags(std::vector<unsigned char>& tiff, const MapPlace& place, const std::string& name);

}  // namespace surfel
