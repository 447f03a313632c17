#include <fstream>
#include <limits>
#include <new>
#include <optional>
#include <string>

#include <surfel/base/memory.h>
#include <sys/mman.h>

namespace surfel {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20;
constexpr std::size_t kCacheLine = 64;

std::align_val_t array_alignment(std::size_t bytes) noexcept {
  return std::align_val_t{bytes >= kHugePage ? kHugePage : kCacheLine};
}

/// Bytes of a line "key  number kB" of a file that the kernel makes; none if it has no such line.
std::optional<std::uint64_t> kernel_bytes(const char* file, const std::string& wanted) noexcept {
  try {
    std::ifstream lines(file);
    std::string key;
    std::string rest;
    while (lines >> key) {
      if (key == wanted) {
        std::uint64_t kib = 0;
        lines >> kib;
        return kib * 1024;
      }
      std::getline(lines, rest);
    }
  } catch (...) {  // Unreadable or out of memory: as where the system does not tell.
  }
  return std::nullopt;
}

}  // namespace

std::uint64_t peak_memory_bytes() noexcept {
  // Not getrusage(): its maximum is taken over from the program that started this one.
  return kernel_bytes("/proc/self/status", "VmHWM:").value_or(0);
}

std::uint64_t available_memory_bytes() noexcept {
  return kernel_bytes("/proc/meminfo", "MemAvailable:")
      .value_or(std::numeric_limits<std::uint64_t>::max());
}

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
