#include <fstream>
#include <limits>
#include <string>

#include <surfel/base/memory.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

namespace surfel {

std::uint64_t peak_memory_bytes() noexcept {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

std::uint64_t available_memory_bytes() noexcept {
  try {
    std::ifstream meminfo("/proc/meminfo");
    std::string key;
    std::string rest;
    while (meminfo >> key) {
      if (key == "MemAvailable:") {
        std::uint64_t kib = 0;
        meminfo >> kib;
        return kib * 1024;
      }
      std::getline(meminfo, rest);
    }
  } catch (...) {  // Unreadable or out of memory: as where the system does not tell.
  }
  return std::numeric_limits<std::uint64_t>::max();
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
