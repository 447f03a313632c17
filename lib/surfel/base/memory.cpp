#include <fstream>
#include <limits>
#include <optional>
#include <string>

#include <surfel/base/memory.h>
#include <sys/mman.h>
#include <unistd.h>

namespace surfel {
namespace {

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

void prefer_huge_pages(void* data, std::size_t bytes) noexcept {
  constexpr std::size_t kSmall = std::size_t{8} << 20;
  if (bytes < kSmall) return;
  const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto begin = (reinterpret_cast<std::uintptr_t>(data) + page - 1) / page * page;
  const auto end = (reinterpret_cast<std::uintptr_t>(data) + bytes) / page * page;
  madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

}  // namespace surfel
