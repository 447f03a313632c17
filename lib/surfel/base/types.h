#pragma once

#include <Eigen/Geometry>
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
/// Types of 32 bytes and more that other programs share with this library are not aligned: Eigen
/// would align them by the instruction set that each program is compiled for.
using Vec4d = Eigen::Matrix<double, 4, 1, Eigen::DontAlign>;
using Mat2d = Eigen::Matrix<double, 2, 2, Eigen::DontAlign>;
using Quaternion = Eigen::Quaternion<double, Eigen::DontAlign>;

/// Allocator whose resize() leaves plain values uninitialised: an array that is filled by several
/// threads is touched once, and its pages are spread by the threads that fill them. See
/// allocate_array() for the memory.
template <class T>
class UninitializedAllocator {
 public:
  using value_type = T;

  UninitializedAllocator() noexcept = default;
  template <class U>
  UninitializedAllocator(const UninitializedAllocator<U>& /*other*/) noexcept {}  // NOLINT: rebinds

  T* allocate(std::size_t count) {
    if (count > static_cast<std::size_t>(-1) / 2 / sizeof(T)) throw std::bad_alloc();
    return static_cast<T*>(allocate_array(count * sizeof(T)));
  }
  void deallocate(T* p, std::size_t count) noexcept { free_array(p, count * sizeof(T)); }

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
