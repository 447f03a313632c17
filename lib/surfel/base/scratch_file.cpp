#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/base/kept_file.h>
#include <surfel/base/output_file.h>
#include <surfel/base/scratch_file.h>
#include <sys/statvfs.h>
#include <unistd.h>

namespace surfel {
namespace {

namespace fs = std::filesystem;

/// The folder that a file without a name is made in.
std::string folder_beside(const std::string& target) {
  std::error_code error;
  const fs::path path(target);
  if (target != "-" && (!fs::exists(path, error) || fs::is_regular_file(path, error))) {
    return path.has_parent_path() ? path.parent_path().string() : ".";
  }
  const char* const folder = std::getenv("TMPDIR");
  return folder && *folder ? folder : "/tmp";
}

/// Opens a file that has no name, or loses it at once on file systems without such files.
int open_nameless(const std::string& folder) {
  const int descriptor = open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor >= 0 || (errno != EOPNOTSUPP && errno != EISDIR && errno != EINVAL)) {
    return descriptor;
  }
  std::string name = folder + "/.surfel-scratch-XXXXXX";
  const int named = mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) unlink(name.c_str());
  return named;
}

}  // namespace

ScratchFile::ScratchFile(const std::string& beside, const std::string& name)
    : beside_(beside == "-" ? "standard output" : beside),
      folder_(folder_beside(beside)),
      name_(name) {
  descriptor_ = name.empty() ? open_nameless(folder_) : open_kept(name, O_RDWR | O_CREAT, 0600);
  if (descriptor_ < 0) {
    throw_io(beside_, "nothing can be written to its folder " + folder_ + ": " +
                          std::strerror(errno) + "; write the result to another folder");
  }
}

ScratchFile::~ScratchFile() { close(descriptor_); }

std::uint64_t ScratchFile::free_bytes() const {
  struct statvfs status {};
  if (fstatvfs(descriptor_, &status) != 0) return std::numeric_limits<std::uint64_t>::max();
  return std::uint64_t{status.f_bavail} * status.f_frsize;
}

bool ScratchFile::keep(std::uint64_t bytes) {
  const off_t size = lseek(descriptor_, 0, SEEK_END);
  const auto end = static_cast<off_t>(bytes);
  if (size < end || ftruncate(descriptor_, end) != 0 || lseek(descriptor_, end, SEEK_SET) != end) {
    return false;
  }
  size_ = bytes;
  return true;
}

void ScratchFile::remove() {
  if (!name_.empty()) unlink(name_.c_str());
}

std::uint64_t ScratchFile::append(const void* data, std::size_t bytes) {
  write_all(descriptor_, data, bytes, folder_ + " (for " + beside_ + ")");
  const std::uint64_t offset = size_;
  size_ += bytes;
  return offset;
}

void ScratchFile::read_at(std::uint64_t offset, void* to, std::size_t bytes) const {
  auto* out = static_cast<char*>(to);
  while (bytes > 0) {
    const ssize_t got = pread(descriptor_, out, bytes, static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      throw_io(beside_, std::string("what was written beside it cannot be read: ") +
                            (got == 0 ? "it ends too early" : std::strerror(errno)) +
                            "; run it again, with the result on another disk if need be");
    }
    out += got;
    offset += static_cast<std::uint64_t>(got);
    bytes -= static_cast<std::size_t>(got);
  }
}

}  // namespace surfel
