// A library to be loaded before a tool's others (LD_PRELOAD), which makes one call of the system
// fail: FAULT_CALL names it, FAULT_NUMBER says which of its calls on files that the tool opened
// (from 1 on), FAULT_ERROR is its errno, or 0 for a call that does a part of its work, or -1 for a
// call before which the file is cut in half, or -2 for a call that writes a part and after which
// the process is killed. The file FAULT_SEEN is made when the call comes. Of pthread_create all
// calls fail from that number on, as they do at a limit.

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/stat.h>
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
  const int number = std::atoi(std::getenv("FAULT_NUMBER"));
  const bool later = std::strcmp(call, "pthread_create") == 0;
  const int calls = ++g_calls;
  if (later ? calls < number : calls != number) return false;
  const long seen =
      syscall(SYS_openat, AT_FDCWD, std::getenv("FAULT_SEEN"), O_CREAT | O_WRONLY, 0600);
  syscall(SYS_close, seen);
  errno = std::atoi(std::getenv("FAULT_ERROR"));
  return true;
}

/// Another program cuts a file that this one has open.
void cut_in_half(int descriptor) {
  struct stat status {};
  char path[64];
  std::snprintf(path, sizeof path, "/proc/self/fd/%d", descriptor);
  if (fstat(descriptor, &status) == 0) static_cast<void>(!truncate(path, status.st_size / 2));
}

/// What a call of `bytes` that fails returns, where whole(bytes) would do the work.
template <class Whole>
ssize_t part(std::size_t bytes, const Whole& whole) {
  if (errno == -2) {
    static_cast<void>(whole(bytes / 2));
    static_cast<void>(raise(SIGKILL));
  }
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
  if (!is_opened(descriptor) || !fails("pread")) return whole(bytes);
  if (errno != -1) return part(bytes, whole);
  cut_in_half(descriptor);
  return whole(bytes);
}

int fsync(int descriptor) {
  return fails("fsync") ? -1 : static_cast<int>(syscall(SYS_fsync, descriptor));
}

// By another name, as fcntl.h has a structure of this one.
int lock_file(int descriptor, int operation) __asm__("flock");
int lock_file(int descriptor, int operation) {
  return fails("flock") ? -1 : static_cast<int>(syscall(SYS_flock, descriptor, operation));
}

int rename(const char* from, const char* to) {
  return fails("rename") ? -1
                         : static_cast<int>(syscall(SYS_renameat, AT_FDCWD, from, AT_FDCWD, to));
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*),
                   void* argument) {
  if (fails("pthread_create")) return errno;
  using Create = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
  const auto create = reinterpret_cast<Create>(dlsym(RTLD_NEXT, "pthread_create"));
  return create(thread, attributes, start, argument);
}

}  // extern "C"
