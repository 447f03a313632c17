#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/input_file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {
namespace {

std::string cause() { return std::strerror(errno); }

/// A descriptor to read from, closed with the scope. Standard input is duplicated.
struct Descriptor {
  int value;
  explicit Descriptor(const std::string& path)
      : value(path == "-" ? dup(STDIN_FILENO) : open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~Descriptor() {
    if (value >= 0) close(value);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
};

}  // namespace

InputFile::InputFile(const std::string& path) : name_(path == "-" ? "standard input" : path) {
  const Descriptor file(path);
  struct stat status {};
  if (file.value < 0 || fstat(file.value, &status) != 0) {
    throw_io(name_, "cannot be opened: " + cause());
  }
  if (S_ISDIR(status.st_mode)) throw_io(name_, "is a directory; name a file");
  const bool whole = S_ISREG(status.st_mode) && lseek(file.value, 0, SEEK_CUR) == 0;
  if (!whole) {
    read_all(file.value);
    return;
  }
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size == 0) return;
  descriptor_ = dup(file.value);
  if (descriptor_ < 0) throw_io(name_, "cannot be read: " + cause());
  void* data = mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file.value, 0);
  if (data == MAP_FAILED) throw_io(name_, "cannot be read: " + cause());
  mapped_ = true;
  bytes_ = {static_cast<const std::byte*>(data), size};
}

InputFile::~InputFile() {
  if (mapped_) munmap(const_cast<std::byte*>(bytes_.data()), bytes_.size());
  if (descriptor_ >= 0) close(descriptor_);
}

InputFile::InputFile(InputFile&& other) noexcept
    : name_(std::move(other.name_)),
      bytes_(std::exchange(other.bytes_, {})),
      mapped_(std::exchange(other.mapped_, false)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      buffer_(std::move(other.buffer_)) {}

const std::byte* InputFile::read_at(std::size_t offset, std::size_t size,
                                    Array<std::byte>& scratch) const {
  if (!mapped_) return bytes_.data() + offset;
  if (scratch.size() < size) scratch.resize(size);
  for (std::size_t done = 0; done < size;) {
    const ssize_t got =
        pread(descriptor_, scratch.data() + done, size - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw_io(name_, "cannot be read: " + cause());
    if (got == 0) throw_io(name_, "became shorter while it was read");
    done += static_cast<std::size_t>(got);
  }
  return scratch.data();
}

void InputFile::expect(std::size_t offset, std::size_t size) const noexcept {
  if (!mapped_) return;
  posix_fadvise(descriptor_, static_cast<off_t>(offset), static_cast<off_t>(size),
                POSIX_FADV_WILLNEED);
}

void InputFile::read_all(int descriptor) {
  constexpr std::size_t kFirst = std::size_t{1} << 20;
  std::size_t size = 0;
  for (;;) {
    if (size == buffer_.size()) {
      const std::size_t grown = std::max(kFirst, 2 * size);
      if (grown > available_memory_bytes()) {
        throw_io(name_, "is too large for this machine's memory; store it in a file");
      }
      buffer_.resize(grown);
    }
    const ssize_t got = read(descriptor, buffer_.data() + size, buffer_.size() - size);
    if (got == 0) break;
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw_io(name_, "cannot be read: " + cause());
    size += static_cast<std::size_t>(got);
  }
  bytes_ = {buffer_.data(), size};
}

}  // namespace surfel
