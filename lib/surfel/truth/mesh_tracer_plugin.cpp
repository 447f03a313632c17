// Plug-in libsurfel_trace.so: the one place that sees Embree.
//
// Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection" (why rays do not slip through
// the edges between faces: Embree's robust mode).

#include <algorithm>
#include <atomic>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <type_traits>

#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/export.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/base/thread_limits.h>
#include <surfel/truth/mesh_tracer_plugin.h>
#include <sys/types.h>

namespace surfel {
namespace {

/// A ray goes on beyond its best hit by this part of the distance, several times the rounding error
/// of distances where Embree compares them.
constexpr float kTie = 0x1p-20F;

struct Release {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
template <class Handle>
using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Release>;

/// Throws the calling thread's last error, if there is one. `device` may be null.
void check(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  if (error == RTC_ERROR_CANCELLED) throw Error(ErrorKind::kInterrupted, "interrupted");
  if (error == RTC_ERROR_OUT_OF_MEMORY) {
    throw Error(ErrorKind::kNumeric, "tracing the mesh takes more memory than is available");
  }
  throw Error(ErrorKind::kNumeric,
              fmt::format("Embree failed on the mesh (error {})", static_cast<int>(error)));
}

/// One ray on its way, as the filter finds it behind Embree's context.
struct Query {
  RTCIntersectContext context;  ///< First, so that its address is the query's.
  bool cull_back;
  MeshHit best;
};

/// Keeps the least hit by (t, face). Embree's own choice between hits that rounding makes equal, at
/// edges and where faces coincide, hangs on the order of its hierarchy, which threads build as they
/// come. The ray goes on a little beyond the best hit, so that Embree reports all hits that
/// rounding makes equal.
void keep_least(const RTCFilterFunctionNArguments* arguments) {
  Query& query = *reinterpret_cast<Query*>(const_cast<RTCIntersectContext*>(arguments->context));
  RTCRay& ray = *reinterpret_cast<RTCRay*>(arguments->ray);
  const RTCHit& hit = *reinterpret_cast<const RTCHit*>(arguments->hit);
  const bool front = hit.Ng_x * ray.dir_x + hit.Ng_y * ray.dir_y + hit.Ng_z * ray.dir_z < 0;
  MeshHit& best = query.best;
  if (ray.tfar > best.t || (ray.tfar == best.t && hit.primID > best.face) ||
      (query.cull_back && !front)) {
    arguments->valid[0] = 0;
    return;
  }
  best = {ray.tfar, hit.u, hit.v, hit.primID, front};
  ray.tfar += kTie * ray.tfar;
}

/// Lets Embree allocate as long as there is memory.
struct MemoryLimit {
  std::atomic<std::int64_t> left{static_cast<std::int64_t>(
      std::min<std::uint64_t>(available_memory_bytes(), std::numeric_limits<std::int64_t>::max()))};

  static bool allow(void* self, ssize_t bytes, bool /*post*/) {
    return static_cast<MemoryLimit*>(self)->left.fetch_sub(bytes) >= bytes || bytes <= 0;
  }
};

/// Embree's limit on threads holds for the whole process for as long as it has a device: it is set
/// only where fewer than all are wanted, as oneTBB complains of limits that it cannot meet, and
/// where oneTBB might fail to start a thread, which would end the process.
std::string device_configuration() {
#ifdef __SANITIZE_THREAD__
  // The thread sanitizer does not see how Embree's workers synchronise: see base/parallel.cpp.
  return "threads=1";
#else
  const int threads = address_space_is_limited() ? 1 : thread_count();
  const bool all = threads >= static_cast<int>(std::thread::hardware_concurrency());
  return all ? "" : fmt::format("threads={}", threads);
#endif
}

class EmbreeTracer final : public MeshTracer {
 public:
  explicit EmbreeTracer(const MeshToTrace& mesh)
      : device_(rtcNewDevice(device_configuration().c_str())) {
    check(device_.get());
    rtcSetDeviceMemoryMonitorFunction(device_.get(), MemoryLimit::allow, &memory_);
    const Owned<RTCGeometry> geometry(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    check(device_.get());
    // Copied, as Embree reads beyond the last vertex.
    void* position = rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0,
                                             RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices);
    check(device_.get());
    std::copy_n(mesh.position, 3 * mesh.vertices, static_cast<float*>(position));
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               mesh.face, 0, 3 * sizeof(std::uint32_t), mesh.faces);
    rtcSetGeometryIntersectFilterFunction(geometry.get(), keep_least);
    rtcCommitGeometry(geometry.get());
    check(device_.get());

    scene_.reset(rtcNewScene(device_.get()));
    check(device_.get());
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
    rtcAttachGeometry(scene_.get(), geometry.get());
    rtcSetSceneProgressMonitorFunction(
        scene_.get(), [](void*, double) { return !interrupt_requested(); }, nullptr);
    rtcCommitScene(scene_.get());
    check(device_.get());
  }

  std::optional<MeshHit> nearest(const MeshRay& ray) const override {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    Query query;
    rtcInitIntersectContext(&query.context);
    query.cull_back = ray.cull_back;
    query.best = {kInfinity, 0, 0, RTC_INVALID_GEOMETRY_ID, false};
    RTCRayHit traced{};
    traced.ray = {ray.origin[0],
                  ray.origin[1],
                  ray.origin[2],
                  ray.from,
                  ray.direction[0],
                  ray.direction[1],
                  ray.direction[2],
                  0,
                  kInfinity,
                  ~0U,
                  0,
                  0};
    traced.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_.get(), &query.context, &traced);
    if (query.best.face == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    return query.best;
  }

 private:
  MemoryLimit memory_;
  Owned<RTCDevice> device_;
  Owned<RTCScene> scene_;
};

}  // namespace
}  // namespace surfel

extern "C" SURFEL_API surfel::MeshTracer* surfel_make_mesh_tracer(const surfel::MeshToTrace& mesh);

extern "C" surfel::MeshTracer* surfel_make_mesh_tracer(const surfel::MeshToTrace& mesh) {
  return new surfel::EmbreeTracer(mesh);
}
