#pragma once

// What the readers of all volume formats share. Internal to the io module.

#include <cstddef>
#include <cstdint>
#include <string>

#include <surfel/base/scalar_type.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// How a file holds the values of a volume, x fastest.
struct VoxelLayout {
  ScalarType type = ScalarType::kUint8;
  bool big_endian = false;
  bool compressed = false;  ///< By gzip or zlib.
  /// Bytes before the values, of the file or, `compressed`, of the compressed data.
  std::size_t offset = 0;
};

/// Checks the size of a volume, and that there is memory for it. Throws Error(kInput) naming the
/// file.
void require_volume(const Volume& volume, const std::string& file);

/// Reads the values of a volume whose size is set. Throws Error (kIo, kInput) naming the file: it
/// is truncated, or its compressed data is damaged.
void read_voxels(const InputFile& input, const VoxelLayout& layout, Volume& volume);

/// What is done last to a volume of any format: values that are not finite get the least of the
/// others (Volume::not_finite). Throws Error(kInput) naming the file if no value is finite, or if
/// the axes are not at right angles.
void finish_volume(Volume& volume, const std::string& file);

}  // namespace surfel
