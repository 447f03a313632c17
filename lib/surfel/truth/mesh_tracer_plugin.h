#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

namespace surfel {

/// Half line of the places origin + t direction with t >= from. Like everything that the library
/// and the plug-in libsurfel_trace.so hand to one another raw numbers only, as Embree may be built
/// for another instruction set than the code that includes Eigen here.
struct MeshRay {
  float origin[3];
  float direction[3];  ///< May have any length.
  float from = 0;
  bool cull_back = false;  ///< Faces that face away are not met.
};

/// Where a ray meets a face: at (1 - u - v) p0 + u p1 + v p2, to rounding.
struct MeshHit {
  float t;
  float u, v;
  std::uint32_t face;
  bool front;  ///< The face's corners are seen counter-clockwise.
};

/// Triangles made ready for rays.
class MeshTracer {
 public:
  virtual ~MeshTracer() = default;

  /// The nearest hit; of several hits at one distance, the hit of the lowest face, which does not
  /// depend on how threads built the hierarchy. Callable from any thread.
  virtual std::optional<MeshHit> nearest(const MeshRay& ray) const = 0;
};

/// x y z of the vertices, and three vertices' numbers for each face, 1 to 2^32 - 2 faces.
struct MeshToTrace {
  const float* position = nullptr;
  std::size_t vertices = 0;
  const std::uint32_t* face = nullptr;  ///< Must outlive the tracer.
  std::size_t faces = 0;
};

/// The function by which libsurfel_trace.so offers its tracer. The caller owns the result. Throws
/// Error: kNumeric if Embree fails or would need more memory than there is, kInterrupted if asked
/// to stop.
using MakeMeshTracer = MeshTracer*(const MeshToTrace& mesh);
inline constexpr char kMakeMeshTracerSymbol[] = "surfel_make_mesh_tracer";

}  // namespace surfel
