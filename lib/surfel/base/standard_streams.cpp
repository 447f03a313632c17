#include <filesystem>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/base/standard_streams.h>
#include <unistd.h>

namespace surfel {
namespace {

/// A closed descriptor has no mode of access, and so allows none.
bool allows(int descriptor, int refused_mode) {
  const int flags = fcntl(descriptor, F_GETFL);
  return flags >= 0 && (flags & O_ACCMODE) != refused_mode;
}

}  // namespace

void hold_standard_descriptors() noexcept {
  constexpr int kWrongWay[] = {O_WRONLY, O_RDONLY, O_WRONLY};
  for (const int descriptor : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    // The lowest descriptor that is free is the one that open() takes. A system without devices has
    // a root folder still, which can be neither read nor written.
    if (fcntl(descriptor, F_GETFD) < 0 && open("/dev/null", kWrongWay[descriptor]) < 0) {
      static_cast<void>(open("/", O_RDONLY | O_DIRECTORY));
    }
  }
}

void require_standard_input() {
  if (!allows(STDIN_FILENO, O_WRONLY)) {
    throw_io("", "standard input is closed; name a file or open it for reading");
  }
}

bool is_standard_output(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  fs::path name = path;
  constexpr int kMostLinks = 40;  // The kernel follows as many.
  for (int i = 0; !error && i < kMostLinks && name != "-"; ++i) {
    // A descriptor is a link, too, to what it was opened as.
    if (name.filename() == "1") {
      const fs::path own = fs::canonical("/proc/self/fd", error);
      if (!error && fs::canonical(name.parent_path(), error) == own) return true;
    }
    if (!fs::is_symlink(name, error)) break;
    name = name.parent_path() / fs::read_symlink(name, error);
  }
  return name == "-";
}

void require_standard_output() {
  if (!allows(STDOUT_FILENO, O_RDONLY)) {
    throw_io("", "standard output is closed; name a file or open it for writing");
  }
}

}  // namespace surfel
