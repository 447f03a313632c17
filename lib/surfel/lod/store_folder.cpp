#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/io/level_store.h>
#include <surfel/lod/store_folder.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {
namespace {

namespace fs = std::filesystem;

/// File whose lock is held by whoever writes to the store.
constexpr const char* kLockFile = "lock";

/// Is the file one that stores have?
bool is_of_stores(const std::string& file) {
  const bool part = file.starts_with(kBlockName) || file.starts_with(kTopName);
  return (part && file.ends_with(".ply")) || file == kSortedFile;
}

}  // namespace

StoreFolder::StoreFolder(const std::string& path) : path_(path) {
  std::error_code error;
  made_ = fs::create_directory(path_, error);
  if (error && !fs::is_directory(path_)) {
    throw_io(path_, "cannot be made: " + error.message() + "; is the folder above it there?");
  }
  try {
    lock();
  } catch (...) {
    if (made_) fs::remove(path_, error);
    throw;
  }
}

StoreFolder::~StoreFolder() {
  std::error_code ignored;
  for (const std::string& file : new_) fs::remove(path_in(path_, file), ignored);
  if (made_) {
    fs::remove(path_in(path_, kLockFile), ignored);
    fs::remove(path_, ignored);
  }
  if (lock_ >= 0) close(lock_);
}

std::string StoreFolder::operator/(const std::string& file) const { return path_in(path_, file); }

void StoreFolder::remove_all_but(const std::set<std::string>& kept) {
  std::error_code error;
  for (fs::directory_iterator at(path_, error), end; !error && at != end; at.increment(error)) {
    const std::string file = at->path().filename().string();
    std::error_code ignored;
    if (is_of_stores(file) && !kept.contains(file)) fs::remove(at->path(), ignored);
  }
}

void StoreFolder::add(const std::string& file) {
  if (fs::exists(path_in(path_, file))) return;
  const std::lock_guard guard(mutex_);
  new_.insert(file);
}

void StoreFolder::remove(const std::string& file) {
  std::error_code ignored;
  fs::remove(path_in(path_, file), ignored);
  const std::lock_guard guard(mutex_);
  new_.erase(file);
}

void StoreFolder::keep() {
  new_.clear();
  made_ = false;
}

void StoreFolder::lock() {
  const std::string file = path_in(path_, kLockFile);
  if (!is_level_store(path_)) {
    std::error_code error;
    for (fs::directory_iterator at(path_, error), end; !error && at != end; at.increment(error)) {
      const std::string name = at->path().filename().string();
      // Temporaries of a process that was killed begin with a dot.
      if (is_of_stores(name) || name == kLockFile || name.starts_with('.')) continue;
      throw_io(path_, "is a folder of other files, and no store; name a new folder");
    }
  }
  lock_ = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (lock_ < 0) {
    throw_io(path_, std::string("cannot be written to: ") + std::strerror(errno));
  }
  // File systems without locks have none that is held.
  if (flock(lock_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
  close(std::exchange(lock_, -1));
  throw_io(path_, "is being written to by another process; wait until it has ended");
}

}  // namespace surfel
