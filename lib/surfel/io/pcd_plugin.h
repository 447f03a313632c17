#pragma once

#include <cstddef>
#include <vector>

namespace surfel {

/// Request to the plug-in `pcd` for the records of a compressed PCD file.
struct PcdDecompression {
  const unsigned char* file = nullptr;
  std::size_t header_size = 0;  ///< The body follows; it was checked to lie inside the file.
  std::vector<unsigned char> records{};
  std::size_t stride = 0;
};

/// Symbol `surfel_pcd_decompress` of the plug-in. False if PCL cannot read the file.
using PcdDecompress = bool (*)(PcdDecompression& work);

}  // namespace surfel
