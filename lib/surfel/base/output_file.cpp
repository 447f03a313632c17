#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {
namespace {

/// Names of the open temporaries in plain memory, so that a signal handler can read them.
struct Slot {
  std::atomic<bool> used{false};
  std::array<char, PATH_MAX> path{};
};
std::array<Slot, 64> g_slots;
std::mutex g_slots_mutex;

void remember(const std::string& path) {
  const std::lock_guard lock(g_slots_mutex);
  for (Slot& slot : g_slots) {
    if (slot.used.load() || path.size() >= slot.path.size()) continue;
    std::memcpy(slot.path.data(), path.c_str(), path.size() + 1);
    slot.used.store(true);
    return;
  }
}

void forget(const std::string& path) {
  const std::lock_guard lock(g_slots_mutex);
  for (Slot& slot : g_slots) {
    if (slot.used.load() && path == slot.path.data()) slot.used.store(false);
  }
}

/// Closes a file descriptor when it goes out of scope.
struct Descriptor {
  int value;
  ~Descriptor() {
    if (value >= 0) close(value);
  }
};

std::string cause() { return std::strerror(errno); }

void write_all(int descriptor, const char* data, std::size_t bytes, const std::string& name) {
  while (bytes > 0) {
    const ssize_t written = ::write(descriptor, data, bytes);
    if (written < 0) {
      if (errno == EINTR) continue;
      throw_io(name, "cannot be written: " + cause());
    }
    data += written;
    bytes -= static_cast<std::size_t>(written);
  }
}

/// Folder and file name of a path, the folder with its slash ("" for the current one).
std::pair<std::string, std::string> split(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return {"", path};
  return {path.substr(0, slash + 1), path.substr(slash + 1)};
}

}  // namespace

OutputFile::OutputFile(std::string target, bool no_clobber) : target_(std::move(target)) {
  std::string pattern;
  std::size_t suffix = 0;
  mode_t mode = 0;
  struct stat status {};
  const bool exists = target_ != "-" && stat(target_.c_str(), &status) == 0;
  if (exists && S_ISDIR(status.st_mode)) throw_io(target_, "is a directory; name a file");
  // A device or a pipe (/dev/null, /dev/stdout) is written to, never replaced.
  copied_ = target_ == "-" || (exists && !S_ISREG(status.st_mode));
  if (copied_) {
    const char* folder = std::getenv("TMPDIR");
    pattern = std::string(folder && *folder ? folder : "/tmp") + "/surfel-XXXXXX";
  } else {
    if (exists) {
      if (no_clobber) throw_io(target_, "exists already and --no-clobber is set");
      if (access(target_.c_str(), W_OK) != 0) {
        throw_io(target_, "cannot be written: " + cause());
      }
      mode = status.st_mode & 0777;
    }
    const auto [folder, name] = split(target_);
    if (name.empty()) throw_io(target_, "is not a file name");
    const std::size_t dot = name.rfind('.');
    const std::string extension = dot == std::string::npos || dot == 0 ? "" : name.substr(dot);
    pattern = folder + "." + name.substr(0, name.size() - extension.size()) + ".XXXXXX" + extension;
    suffix = extension.size();
  }
  descriptor_ = mkstemps(pattern.data(), static_cast<int>(suffix));
  if (descriptor_ < 0) {
    throw_io(target_, "cannot be created: " + cause() + "; is the folder there and writable?");
  }
  temporary_ = pattern;
  remember(temporary_);
  if (mode == 0) {
    const mode_t mask = umask(0);
    umask(mask);
    mode = 0666 & ~mask;
  }
  fchmod(descriptor_, mode);
}

OutputFile::~OutputFile() {
  if (descriptor_ >= 0) close(descriptor_);
  if (!committed_) unlink(temporary_.c_str());
  forget(temporary_);
}

void OutputFile::write(const void* data, std::size_t bytes) {
  write_all(descriptor_, static_cast<const char*>(data), bytes, target_);
}

void OutputFile::commit() {
  if (copied_) {
    copy_to_target();
    unlink(temporary_.c_str());
  } else {
    const int closed = close(descriptor_);
    descriptor_ = -1;
    if (closed != 0 || rename(temporary_.c_str(), target_.c_str()) != 0) {
      throw_io(target_, "cannot be written: " + cause());
    }
  }
  committed_ = true;
}

void OutputFile::copy_to_target() const {
  const std::string name = target_ == "-" ? "standard output" : target_;
  const Descriptor in{open(temporary_.c_str(), O_RDONLY | O_CLOEXEC)};
  const Descriptor out{target_ == "-" ? dup(STDOUT_FILENO)
                                      : open(target_.c_str(), O_WRONLY | O_CLOEXEC)};
  if (in.value < 0 || out.value < 0) throw_io(name, "cannot be written: " + cause());
  std::array<char, 1 << 16> buffer{};
  ssize_t got = 0;
  while ((got = read(in.value, buffer.data(), buffer.size())) > 0) {
    write_all(out.value, buffer.data(), static_cast<std::size_t>(got), name);
  }
  if (got < 0) throw_io(name, "temporary file cannot be read: " + cause());
}

void remove_temporaries() noexcept {
  for (Slot& slot : g_slots) {
    if (slot.used.load()) unlink(slot.path.data());
  }
}

}  // namespace surfel
