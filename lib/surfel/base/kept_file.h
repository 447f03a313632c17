#pragma once

#include <cerrno>
#include <cstring>
#include <string>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {

/// Opens a file that stays beside a result between runs. Its name is known beforehand, so that in
/// a folder of several users it may have been made to lead elsewhere.
/// \param flags  of open(); a file that is not there is made with O_CREAT alone.
/// \return The descriptor, or -1 with errno where it cannot be opened.
///
/// Throws Error(kIo) for a symbolic link, a second name of a file, what is no regular file, and
/// another user's file.
inline int open_kept(const std::string& path, int flags, mode_t mode = 0666) {
  constexpr int kAlways = O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK;
  if ((flags & O_CREAT) != 0) {
    const int made = open(path.c_str(), flags | O_EXCL | kAlways, mode);
    if (made >= 0 || errno != EEXIST) return made;
  }
  const int file = open(path.c_str(), (flags & ~O_CREAT) | kAlways);
  struct stat status {};
  const char* wrong = nullptr;
  if (file < 0) {
    if (errno == ELOOP) wrong = "is a symbolic link";
  } else if (fstat(file, &status) != 0 || !S_ISREG(status.st_mode)) {
    wrong = "is no file";
  } else if (status.st_uid != geteuid()) {
    wrong = "belongs to another user";
  } else if (status.st_nlink != 1) {
    wrong = "is the name of a file that has other names";
  }
  if (!wrong) return file;
  if (file >= 0) close(file);
  throw_io(path, std::string(wrong) + ", and `resume` would write over it; remove it");
}

}  // namespace surfel
