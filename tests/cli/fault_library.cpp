// A library to be loaded before a tool's others (LD_PRELOAD), which makes one call of the system
// fail: FAULT_CALL names it, FAULT_NUMBER says which of its calls on files that the tool opened
// (from 1 on), FAULT_ERROR is its errno, or 0 for a call that does a part of its work. The file
// FAULT_SEEN is made when the call comes.

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdlib>
#include <cstring>

#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace {

std::array<std::atomic<bool>, 1024> g_opened;
std::atomic<int> g_calls{0};

bool is_opened(int descriptor) {
  return descriptor >= 0 && static_cast<std::size_t>(descriptor) < g_opened.size() &&
         g_opened[static_cast<std::size_t>(descriptor)];
}

int mark(int descriptor, bool opened) {
  if (descriptor >= 0 && static_cast<std::size_t>(descriptor) < g_opened.size()) {
    g_opened[static_cast<std::size_t>(descriptor)] = opened;
  }
  return descriptor;
}

/// Is this the call that is to fail? Sets errno then.
bool fails(const char* call) {
  const char* chosen = std::getenv("FAULT_CALL");
  if (!chosen || std::strcmp(chosen, call) != 0) return false;
  if (++g_calls != std::atoi(std::getenv("FAULT_NUMBER"))) return false;
  const long seen =
      syscall(SYS_openat, AT_FDCWD, std::getenv("FAULT_SEEN"), O_CREAT | O_WRONLY, 0600);
  syscall(SYS_close, seen);
  errno = std::atoi(std::getenv("FAULT_ERROR"));
  return true;
}

/// What a call of `bytes` that fails returns, where whole(bytes) would do the work.
template <class Whole>
ssize_t part(std::size_t bytes, const Whole& whole) {
  return errno != 0 ? -1 : whole(std::max<std::size_t>(1, bytes / 2));
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const int mode = (flags & O_CREAT) != 0 ? va_arg(list, int) : 0;
  va_end(list);
  // The system's files, which tell how many threads and how much memory there is, are left out.
  const bool own = std::strncmp(path, "/proc", 5) != 0 && std::strncmp(path, "/sys", 4) != 0;
  if (own && fails("open")) return -1;
  const long descriptor = syscall(SYS_openat, AT_FDCWD, path, flags, mode);
  return mark(static_cast<int>(descriptor), own);
}

int close(int descriptor) {
  const bool fail = is_opened(descriptor) && fails("close");
  const int error = errno;
  mark(descriptor, false);
  const long closed = syscall(SYS_close, descriptor);
  if (fail) errno = error;
  return fail ? -1 : static_cast<int>(closed);
}

ssize_t write(int descriptor, const void* data, std::size_t bytes) {
  const auto whole = [&](std::size_t size) { return syscall(SYS_write, descriptor, data, size); };
  return is_opened(descriptor) && fails("write") ? part(bytes, whole) : whole(bytes);
}

ssize_t pwrite(int descriptor, const void* data, std::size_t bytes, off_t offset) {
  const auto whole = [&](std::size_t size) {
    return syscall(SYS_pwrite64, descriptor, data, size, offset);
  };
  return is_opened(descriptor) && fails("pwrite") ? part(bytes, whole) : whole(bytes);
}

ssize_t pread(int descriptor, void* data, std::size_t bytes, off_t offset) {
  const auto whole = [&](std::size_t size) {
    return syscall(SYS_pread64, descriptor, data, size, offset);
  };
  return is_opened(descriptor) && fails("pread") ? part(bytes, whole) : whole(bytes);
}

int fsync(int descriptor) {
  return fails("fsync") ? -1 : static_cast<int>(syscall(SYS_fsync, descriptor));
}

int rename(const char* from, const char* to) {
  return fails("rename") ? -1
                         : static_cast<int>(syscall(SYS_renameat, AT_FDCWD, from, AT_FDCWD, to));
}

}  // extern "C"
