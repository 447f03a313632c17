#include <new>

#include <surfel/base/memory.h>
#include <sys/mman.h>

namespace surfel {
namespace {

/// Bytes of a huge page on x86-64, and on Arm with small pages of 4 KB.
constexpr std::size_t kHugePage = std::size_t{2} << 20;
constexpr std::size_t kCacheLine = 64;  ///< Bytes.

std::align_val_t array_alignment(std::size_t bytes) noexcept {
  return std::align_val_t{bytes >= kHugePage ? kHugePage : kCacheLine};
}

}  // namespace

void* allocate_array(std::size_t bytes) {
  void* data = ::operator new(bytes, array_alignment(bytes));
  // An advice: nothing is lost where it is not taken.
  if (bytes >= kHugePage) madvise(data, bytes / kHugePage * kHugePage, MADV_HUGEPAGE);
  return data;
}

void free_array(void* data, std::size_t bytes) noexcept {
  ::operator delete(data, array_alignment(bytes));
}

}  // namespace surfel
