#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>
#include <vector>

namespace surfel {

using Vec2f = Eigen::Vector2f;
using Vec3f = Eigen::Vector3f;
using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;

/// Allocator whose resize() leaves plain values uninitialised: an array that is filled by several
/// threads is touched once, and its pages are spread by the threads that fill them.
template <class T>
class UninitializedAllocator : public std::allocator<T> {
 public:
  template <class U>
  struct rebind {
    using other = UninitializedAllocator<U>;
  };
  using std::allocator<T>::allocator;
  template <class U>
  void construct(U* p) noexcept {
    ::new (static_cast<void*>(p)) U;
  }
  template <class U, class... Args>
  void construct(U* p, Args&&... args) {
    ::new (static_cast<void*>(p)) U(std::forward<Args>(args)...);
  }
};

/// Column of values; resize() does not initialise new elements, assign() does.
template <class T>
using Array = std::vector<T, UninitializedAllocator<T>>;

}  // namespace surfel
