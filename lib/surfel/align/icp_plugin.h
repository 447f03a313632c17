#pragma once

#include <cstddef>

namespace surfel {

/// Work that the library hands to the plug-in libsurfel_icp.so. It holds plain numbers only: PCL
/// may be built for another instruction set than this library, and Eigen's types differ then.
struct IcpWork {
  const float* source = nullptr;  ///< x y z, `sources` times.
  std::size_t sources = 0;
  const float* target = nullptr;  ///< x y z, `targets` times.
  const float* normal = nullptr;  ///< Unit normals of the targets, of any side.
  std::size_t targets = 0;
  double reach = 0;  ///< Points further apart do not belong together.
  int iterations = 0;
  double transform[16] = {};  ///< In: where to start, out: the end; source to target, by rows.
};
/// Returns false where PCL finds no transform.
using RunIcp = bool(IcpWork& work);
inline constexpr char kRunIcpSymbol[] = "surfel_run_icp";

}  // namespace surfel
