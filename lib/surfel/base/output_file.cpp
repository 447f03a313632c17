#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <random>
#include <set>
#include <string_view>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/base/kept_file.h>
#include <surfel/base/output_file.h>
#include <surfel/base/standard_streams.h>
#include <sys/file.h>
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

/// Calls write(done), which writes what follows the first `done` bytes and returns how many it
/// took, until all are written.
template <class Write>
void write_on(std::size_t bytes, const std::string& name, const Write& write) {
  for (std::size_t done = 0; done < bytes;) {
    errno = 0;
    const ssize_t written = write(done);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const bool full = errno == ENOSPC || errno == EDQUOT;
      throw_io(name, "cannot be written: " + cause() + (full ? "; make room on its disk" : ""));
    }
    done += static_cast<std::size_t>(written);
  }
}

/// The name by which messages call a target.
std::string display_name(const std::string& target) {
  return target == "-" ? "standard output" : target;
}

/// Folder and file name of a path, the folder with its slash ("" for the current one).
std::pair<std::string, std::string> split(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return {"", path};
  return {path.substr(0, slash + 1), path.substr(slash + 1)};
}

/// The file that a symbolic link stands for, there or not, so that the link is not replaced by it.
std::string follow_links(const std::string& target) {
  namespace fs = std::filesystem;
  constexpr int kMostLinks = 40;  // The kernel follows as many.
  std::string path = target;
  std::error_code error;
  for (int i = 0; fs::is_symlink(path, error); ++i) {
    if (i == kMostLinks) throw_io(target, "is a loop of symbolic links");
    const fs::path link = fs::read_symlink(path, error);
    if (error) break;
    path = (fs::path(path).parent_path() / link).string();
  }
  return path;
}

/// By this part, letters for the placeholders after it, and the extension at most, temporaries are
/// known: nobody gives such a name to a file.
constexpr std::string_view kMark = ".surfel-temporary-";
constexpr std::string_view kRandomPart = "XXXXXX";
constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyz0123456789";

/// Name of a hidden temporary beside `path` with its extension, kRandomPart in the middle. Long
/// names are cut: the mark must not make them too long.
std::string temporary_pattern(const std::string& path) {
  constexpr std::size_t kLongestStem = 64;       ///< File systems allow 255 bytes a name.
  constexpr std::size_t kLongestExtension = 32;  // Longer ones are no extensions that a tool knows.
  const auto [folder, name] = split(path);
  const std::size_t dot = name.rfind('.');
  std::string extension = dot == std::string::npos || dot == 0 ? "" : name.substr(dot);
  if (extension.size() > kLongestExtension) extension.clear();
  const std::string stem = name.substr(0, std::min(kLongestStem, name.size() - extension.size()));
  std::string pattern = folder + "." + stem;
  return pattern.append(kMark).append(kRandomPart) + extension;
}

bool is_temporary(std::string_view name) {
  const std::size_t mark = name.rfind(kMark);
  if (!name.starts_with('.') || mark == std::string_view::npos) return false;
  name.remove_prefix(mark + kMark.size());
  const std::string_view letters = name.substr(0, kRandomPart.size());
  const std::string_view extension = name.substr(letters.size());
  return letters.size() == kRandomPart.size() &&
         letters.find_first_not_of(kLetters) == std::string_view::npos &&
         (extension.empty() || extension.front() == '.');
}

/// Takes the lock by which a temporary is known to be in use, for as long as its descriptor is
/// open: the system gives it back also where a process is killed.
bool lock(int descriptor) { return flock(descriptor, LOCK_EX | LOCK_NB) == 0; }

/// Removes temporaries of processes that were killed, once for each folder: a run of thousands of
/// pictures looks at their folder once.
void remove_abandoned(const std::string& folder) {
  static std::mutex mutex;
  static std::set<std::string> seen;
  {
    const std::lock_guard guard(mutex);
    if (!seen.insert(folder).second) return;
  }
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder.empty() ? "." : folder, error), end;
       !error && at != end; at.increment(error)) {
    const std::filesystem::path& path = at->path();
    if (!is_temporary(path.filename().native())) continue;
    const Descriptor file{open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK)};
    if (file.value >= 0 && lock(file.value)) unlink(path.c_str());
  }
}

/// Creates, opens and locks a file that was not there, with letters for the last kRandomPart of its
/// name. The kernel takes the process's umask off the mode: to ask for the umask would mean to
/// change it, which other threads would notice in the files that they create. Returns the
/// descriptor, or -1 with errno.
int create_temporary(std::string& path, mode_t mode) {
  constexpr int kMostTries = 100;  // 36^6 names: one that is taken is rare, two in a row are none.
  const std::size_t place = path.rfind(kRandomPart);
  // Opened once a thread: where the processor is a virtual one, to ask it for random numbers takes
  // longer than to write a small file.
  static thread_local std::random_device random;
  for (int i = 0; i < kMostTries; ++i) {
    for (std::size_t k = 0; k < kRandomPart.size(); ++k) {
      path[place + k] = kLetters[random() % kLetters.size()];
    }
    const int descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, mode);
    if (descriptor < 0 && errno == EEXIST) continue;
    if (descriptor < 0) return descriptor;
    // Another process may have taken the new file for an abandoned one, before it was locked: it
    // holds the lock, or has removed the file. File systems without locks have no abandoned ones.
    struct stat status {};
    const bool taken = !lock(descriptor) && errno == EWOULDBLOCK;
    if (!taken && (fstat(descriptor, &status) != 0 || status.st_nlink > 0)) return descriptor;
    close(descriptor);
  }
  return -1;
}

/// Waits until what was written to a descriptor is on the disk. Pipes and some file systems have no
/// disk below them.
bool synchronize(int descriptor) {
  int failed = 0;
  do {
    failed = fsync(descriptor);
  } while (failed != 0 && errno == EINTR);
  return failed == 0 || errno == EINVAL || errno == ENOTSUP || errno == EROFS;
}

}  // namespace

OutputFile::OutputFile(std::string target, bool no_clobber, Unfinished unfinished)
    : target_(std::move(target)), no_clobber_(no_clobber), unfinished_(unfinished) {
  if (unfinished_ == Unfinished::kElsewhere) {
    temporary_ = target_;
    descriptor_ = open(target_.c_str(), O_RDWR | O_CLOEXEC);
    if (descriptor_ >= 0) return;
    throw_io(target_, "cannot be opened, which another process writes: " + cause() +
                          "; do all machines have its folder?");
  }
  const bool kept = unfinished_ == Unfinished::kKept;
  if (target_.empty()) throw_io("", "the name of a file to write is empty; name a file");
  if (is_standard_output(target_)) require_standard_output();
  mode_t mode = 0666;
  struct stat status {};
  const bool exists = target_ != "-" && stat(target_.c_str(), &status) == 0;
  if (exists && S_ISDIR(status.st_mode)) throw_io(target_, "is a directory; name a file");
  // A device or a pipe (/dev/null, /dev/stdout) is written to, never replaced.
  copied_ = target_ == "-" || (exists && !S_ISREG(status.st_mode));
  if (copied_ && kept) {
    throw_usage(display_name(target_) +
                " is no file whose parts can be kept for `resume`; name a file");
  }
  if (copied_) {
    const char* folder = std::getenv("TMPDIR");
    temporary_ = temporary_pattern(std::string(folder && *folder ? folder : "/tmp") + "/");
    mode = 0600;  // The folder is everybody's, the data are not.
  } else {
    if (exists) {
      if (no_clobber)
        throw_io(target_, "exists already and `no_clobber` is set; name another file");
      if (access(target_.c_str(), W_OK) != 0) {
        throw_io(target_, "cannot be written: " + cause());
      }
      mode = status.st_mode & 0777;
    }
    target_ = follow_links(target_);
    if (split(target_).second.empty()) throw_io(target_, "is the name of a folder; name a file");
    temporary_ = kept ? target_ + ".unfinished" : temporary_pattern(target_);
  }
  if (kept) {
    descriptor_ = open_kept(temporary_, O_RDWR | O_CREAT, mode);
    if (descriptor_ >= 0 && !lock(descriptor_) && errno == EWOULDBLOCK) {
      close(descriptor_);
      throw_io(target_, "is being made by another process");
    }
  } else {
    remove_abandoned(split(temporary_).first);
    descriptor_ = create_temporary(temporary_, mode);
  }
  if (descriptor_ < 0) {
    throw_io(display_name(target_),
             "cannot be created: " + cause() + "; is the folder there and writable?");
  }
  if (!kept) remember(temporary_);
  // The older file's permissions, whatever the umask.
  if (exists && !copied_) fchmod(descriptor_, mode);
}

OutputFile::~OutputFile() {
  // Nothing is kept of a run that has written nothing.
  struct stat status {};
  if (unfinished_ == Unfinished::kKept && !committed_ && fstat(descriptor_, &status) == 0 &&
      status.st_size == 0) {
    unlink(temporary_.c_str());
  }
  if (descriptor_ >= 0) close(descriptor_);
  if (unfinished_ != Unfinished::kRemoved) return;
  if (!committed_) unlink(temporary_.c_str());
  forget(temporary_);
}

void OutputFile::write(const void* data, std::size_t bytes) {
  write_all(descriptor_, data, bytes, display_name(target_));
}

std::uint64_t OutputFile::reserve(std::uint64_t bytes) {
  const off_t end = lseek(descriptor_, static_cast<off_t>(bytes), SEEK_CUR);
  if (end < 0) throw_io(display_name(target_), "cannot be written: " + cause());
  return static_cast<std::uint64_t>(end) - bytes;
}

void OutputFile::write_at(std::uint64_t offset, const void* data, std::size_t bytes) const {
  const char* from = static_cast<const char*>(data);
  write_on(bytes, display_name(target_), [&](std::size_t done) {
    return pwrite(descriptor_, from + done, bytes - done, static_cast<off_t>(offset + done));
  });
}

std::size_t OutputFile::read_at(std::uint64_t offset, void* to, std::size_t bytes) const {
  auto* const out = static_cast<char*>(to);
  std::size_t done = 0;
  while (done < bytes) {
    const ssize_t got =
        pread(descriptor_, out + done, bytes - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw_io(display_name(target_), "what was written cannot be read: " + cause());
    if (got == 0) break;
    done += static_cast<std::size_t>(got);
  }
  return done;
}

void OutputFile::clear() {
  if (ftruncate(descriptor_, 0) != 0 || lseek(descriptor_, 0, SEEK_SET) != 0) {
    throw_io(display_name(target_), "cannot be written: " + cause());
  }
}

void OutputFile::commit() {
  if (copied_) {
    copy_to_target();
    unlink(temporary_.c_str());
  } else {
    // On the disk before the name stands for it: after a crash of the system the name must not
    // stand for an empty file. The lock is held until then.
    if (!synchronize(descriptor_) || !rename_to_target()) {
      throw_io(target_, "cannot be written: " + cause());
    }
    // Whether the folder keeps the older file or this one through a crash: it is whole.
    const std::string folder = split(target_).first;
    const Descriptor entry{
        open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
    if (entry.value >= 0) synchronize(entry.value);
  }
  committed_ = true;
}

bool OutputFile::rename_to_target() const {
  const char* from = temporary_.c_str();
  const char* to = target_.c_str();
  if (no_clobber_) {
    // The file may have come into being since the constructor looked.
    if (renameat2(AT_FDCWD, from, AT_FDCWD, to, RENAME_NOREPLACE) == 0) return true;
    if (errno != EINVAL && errno != ENOSYS) return false;  // Else: not known to this file system.
  }
  return rename(from, to) == 0;
}

void OutputFile::copy_to_target() const {
  const std::string name = display_name(target_);
  const Descriptor out{target_ == "-" ? dup(STDOUT_FILENO)
                                      : open(target_.c_str(), O_WRONLY | O_CLOEXEC)};
  if (out.value < 0) throw_io(name, "cannot be written: " + cause());
  std::array<char, 1 << 16> buffer{};
  for (off_t done = 0;;) {
    const ssize_t got = pread(descriptor_, buffer.data(), buffer.size(), done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw_io(name, "temporary file cannot be read: " + cause());
    if (got == 0) return;
    write_all(out.value, buffer.data(), static_cast<std::size_t>(got), name);
    done += got;
  }
}

void write_all(int descriptor, const void* data, std::size_t bytes, const std::string& name) {
  const char* from = static_cast<const char*>(data);
  write_on(bytes, name,
           [&](std::size_t done) { return ::write(descriptor, from + done, bytes - done); });
}

void remove_temporaries() noexcept {
  for (Slot& slot : g_slots) {
    if (slot.used.load()) unlink(slot.path.data());
  }
}

}  // namespace surfel
