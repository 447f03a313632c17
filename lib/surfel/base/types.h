#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <new>
#include <utility>
#include <vector>

#include <surfel/base/memory.h>

namespace surfel {

using Vec2f = Eigen::Vector2f;
using Vec3f = Eigen::Vector3f;
using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;

/// Allocator whose resize() leaves plain values uninitialised: an array that is filled by several
/// threads is touched once, and its pages are spread by the threads that fill them. Memory starts
/// at a cache line, as SIMD code wants it, and comes in huge pages where it is large: to touch it
/// for the first time page by page takes longer than to fill it.
template <class T>
class UninitializedAllocator {
 public:
  using value_type = T;
  static constexpr std::align_val_t kAlignment{64};

  UninitializedAllocator() noexcept = default;
  template <class U>
  UninitializedAllocator(const UninitializedAllocator<U>& /*other*/) noexcept {}  // NOLINT: rebinds

  T* allocate(std::size_t count) {
    if (count > static_cast<std::size_t>(-1) / 2 / sizeof(T)) throw std::bad_alloc();
    void* memory = ::operator new(count * sizeof(T), kAlignment);
    prefer_huge_pages(memory, count * sizeof(T));
    return static_cast<T*>(memory);
  }
  void deallocate(T* p, std::size_t /*count*/) noexcept { ::operator delete(p, kAlignment); }

  template <class U>
  void construct(U* p) noexcept {
    ::new (static_cast<void*>(p)) U;
  }
  template <class U, class... Args>
  void construct(U* p, Args&&... args) {
    ::new (static_cast<void*>(p)) U(std::forward<Args>(args)...);
  }
  template <class U>
  bool operator==(const UninitializedAllocator<U>& /*other*/) const noexcept {
    return true;
  }
};

/// Column of values; resize() does not initialise new elements, assign() does.
template <class T>
using Array = std::vector<T, UninitializedAllocator<T>>;

}  // namespace surfel
