#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Request to the plug-in `gltf` for a buffer view compressed by EXT_meshopt_compression.
struct MeshoptWork {
  enum class Mode : std::uint8_t { kAttributes, kTriangles, kIndices };
  enum class Filter : std::uint8_t { kNone, kOctahedral, kQuaternion, kExponential };

  std::span<const std::byte> coded{};
  Mode mode = Mode::kAttributes;
  Filter filter = Filter::kNone;
  std::size_t count = 0;
  std::size_t stride = 0;    ///< Bytes an element, as the mode and the filter need it.
  std::byte* out = nullptr;  ///< `count * stride` bytes.
};

/// Request to the plug-in for a primitive compressed by Draco.
struct DracoWork {
  struct Attribute {
    std::uint32_t id = 0;        ///< Draco's unique number.
    std::size_t components = 0;  ///< Set by the plug-in, 1 to 4.
    Array<float> values{};       ///< By vertex; normalised integers as fractions.
  };

  std::span<const std::byte> coded{};
  std::vector<Attribute> attribute{};
  std::size_t vertices = 0;
  Array<std::uint32_t> indices{};  ///< Three a triangle, all less than `vertices`.
};

/// Symbols of the plug-in libsurfel_gltf.so. False where the bytes are damaged.
using MeshoptDecode = bool (*)(MeshoptWork& work);
using DracoDecode = bool (*)(DracoWork& work);
inline constexpr char kMeshoptDecodeSymbol[] = "surfel_gltf_plugin_meshopt";
inline constexpr char kDracoDecodeSymbol[] = "surfel_gltf_plugin_draco";

}  // namespace surfel
