#include <algorithm>
#include <charconv>
#include <limits>
#include <optional>
#include <sstream>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/memory.h>
#include <surfel/base/memory_limits.h>
#include <surfel/base/whole_file.h>

namespace surfel {
namespace {

constexpr std::uint64_t kUnlimited = std::numeric_limits<std::uint64_t>::max();

/// The number after a line's key, such as "MemAvailable:  123 kB"; the first number of the text for
/// an empty key. None if no line has the key, or a word like "max" stands there.
std::optional<std::uint64_t> number_after(std::string_view text, std::string_view key) {
  std::size_t at = 0;
  while (!text.substr(at).starts_with(key)) {
    at = text.find('\n', at);
    if (at == std::string_view::npos) return std::nullopt;
    ++at;
  }
  at = text.find_first_not_of(" \t", at + key.size());
  if (at == std::string_view::npos) return std::nullopt;
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data() + at, text.data() + text.size(), number);
  return error == std::errc{} ? std::optional(number) : std::nullopt;
}

std::optional<std::uint64_t> kernel_bytes(const std::string& file, std::string_view key) {
  const auto kib = number_after(whole_file(file), key);
  return kib ? std::optional(*kib * 1024) : std::nullopt;
}

std::uint64_t left_of(std::uint64_t limit, std::uint64_t used) {
  return limit > used ? limit - used : 0;
}

/// Names of a control group's files.
struct GroupFiles {
  const char* limit;
  const char* used;
  const char* unused_file_pages;  ///< Key in memory.stat.
};
constexpr GroupFiles kVersion1{"memory.limit_in_bytes", "memory.usage_in_bytes",
                               "total_inactive_file "};
constexpr GroupFiles kVersion2{"memory.max", "memory.current", "inactive_file "};

/// The bytes given, or the bytes that a group and all groups above it leave where they are fewer. A
/// group that a container cannot see has no folder.
std::uint64_t left_by_groups(const std::string& mount, std::string group, const GroupFiles& files,
                             std::uint64_t least) {
  for (;;) {
    const std::string folder = mount + group + "/";
    const auto limit = number_after(whole_file(folder + files.limit), "");
    const auto used = number_after(whole_file(folder + files.used), "");
    // The kernel takes a while to write memory.stat, which only adds to the bytes left.
    if (limit && used && left_of(*limit, *used) < least) {
      const std::uint64_t free_pages =
          number_after(whole_file(folder + "memory.stat"), files.unused_file_pages).value_or(0);
      least = std::min(least, left_of(*limit, left_of(*used, free_pages)));
    }
    if (group.empty()) return least;
    group.resize(group.find_last_not_of('/') == std::string::npos ? 0 : group.rfind('/'));
  }
}

/// The bytes given, or the bytes that the control groups of the process leave where they are fewer.
/// Lines of /proc/self/cgroup are "number:controllers:group"; version 2 has "0::group".
std::uint64_t left_by_all_groups(const std::string& root, std::uint64_t least) {
  const std::string mount = root + "/sys/fs/cgroup";
  std::istringstream lines(whole_file(root + "/proc/self/cgroup"));
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find(':');
    const std::size_t second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = fmt::format(",{},", line.substr(first + 1, second - first - 1));
    const std::string group = line.substr(second + 1);
    if (controllers == ",,") {
      least = left_by_groups(mount, group, kVersion2, least);
    } else if (controllers.find(",memory,") != std::string::npos) {
      least = left_by_groups(mount + "/memory", group, kVersion1, least);
    }
  }
  return least;
}

}  // namespace

std::uint64_t available_memory_below(const std::string& root) {
  const std::string process = root + "/proc/self/";
  std::uint64_t least = left_by_all_groups(
      root, kernel_bytes(root + "/proc/meminfo", "MemAvailable:").value_or(kUnlimited));
  if (const auto space = number_after(whole_file(process + "limits"), "Max address space ")) {
    least =
        std::min(least, left_of(*space, kernel_bytes(process + "status", "VmSize:").value_or(0)));
  }
  return least;
}

std::uint64_t peak_memory_bytes() noexcept try {
  // Not getrusage(): its maximum is taken over from the program that started this one.
  return kernel_bytes("/proc/self/status", "VmHWM:").value_or(0);
} catch (...) {  // Out of memory: as where the system does not tell.
  return 0;
}

std::uint64_t available_memory_bytes() noexcept try {
  return available_memory_below("");
} catch (...) {
  return kUnlimited;
}

std::uint64_t available_memory_for(std::uint64_t wanted) noexcept {
  constexpr std::uint64_t kAlwaysThere = 4 << 20;
  return wanted <= kAlwaysThere ? kAlwaysThere : available_memory_bytes();
}

std::uint64_t memory_to_use(std::optional<std::uint64_t> asked) noexcept {
  return asked ? *asked : available_memory_bytes() / 4 * 3;
}

}  // namespace surfel
