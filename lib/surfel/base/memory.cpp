#include <fstream>
#include <limits>
#include <string>

#include <surfel/base/memory.h>
#include <sys/resource.h>

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

}  // namespace surfel
