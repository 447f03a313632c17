#pragma once

#include <mutex>
#include <set>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// File in the folder of a store that holds new surfels in order while they are added.
inline constexpr const char* kSortedFile = "sorted.ply";
/// Beginnings of the names of the store's files.
inline constexpr const char* kBlockName = "block-";
inline constexpr const char* kTopName = "top-";

/// The folder of a store of levels (io/level_store.h) while it is written to: files that are new go
/// again unless they are kept.
class StoreFolder {
 public:
  /// Makes the folder where it is not there, and locks it until the end of this object. Throws
  /// Error(kIo) where it is a folder of other files, or another process writes to it.
  explicit StoreFolder(const std::string& path);
  ~StoreFolder();
  StoreFolder(const StoreFolder&) = delete;
  StoreFolder& operator=(const StoreFolder&) = delete;

  const std::string& path() const { return path_; }
  std::string operator/(const std::string& file) const;
  /// Removes the files of a store that are not among these.
  void remove_all_but(const std::set<std::string>& kept);
  /// A file of this name will be written: it goes again unless keep() is called. One that is there
  /// is of the store as it is, and has the same bytes. Callable from several threads at once.
  void add(const std::string& file);
  void remove(const std::string& file);
  /// The new files are the store's.
  void keep();

 private:
  void lock();

  std::string path_;
  bool made_ = false;
  int lock_ = -1;
  std::mutex mutex_;
  std::set<std::string> new_;
};

}  // namespace surfel
