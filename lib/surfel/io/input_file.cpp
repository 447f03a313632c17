#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include <fcntl.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/progress.h>
#include <surfel/base/standard_streams.h>
#include <surfel/io/input_file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {
namespace {

/// Bytes of a file between two counts of its progress; fewer are no stage.
constexpr std::size_t kReadAtOnce = std::size_t{1} << 24;

std::string cause() { return std::strerror(errno); }

/// A descriptor to read from, closed with the scope. Standard input is duplicated.
struct Descriptor {
  int value;
  explicit Descriptor(int opened) : value(opened) {}
  ~Descriptor() {
    if (value >= 0) close(value);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
};

/// Does the text hold a whole line that starts with `start`, with a character after its end?
bool has_line(std::string_view text, std::string_view start) {
  for (std::size_t at = text.find(start); at != std::string_view::npos;
       at = text.find(start, at + 1)) {
    if (at > 0 && text[at - 1] != '\n' && text[at - 1] != '\r') continue;
    return text.find_first_of("\n\r", at) < text.size() - 1;
  }
  return false;
}

}  // namespace

InputFile::InputFile(const std::string& path, bool regular_only)
    : name_(path == "-" && !regular_only ? "standard input" : path) {
  if (path.empty()) throw_io("", "the name of a file to read is empty; name a file");
  const bool standard = path == "-" && !regular_only;
  if (standard) require_standard_input();
  // The opening of a pipe would wait for a writer.
  const int flags = O_RDONLY | O_CLOEXEC | (regular_only ? O_NONBLOCK | O_NOCTTY : 0);
  Descriptor file(standard ? dup(STDIN_FILENO) : open(path.c_str(), flags));
  struct stat status {};
  if (file.value < 0 || fstat(file.value, &status) != 0) {
    const bool missing = errno == ENOENT || errno == ENOTDIR;
    throw_io(name_,
             "cannot be opened: " + cause() + (missing ? "; check its name and folder" : ""));
  }
  if (S_ISDIR(status.st_mode)) throw_io(name_, "is a directory; name a file");
  if (regular_only && !S_ISREG(status.st_mode)) throw_io(name_, "is no regular file");
  const bool whole = S_ISREG(status.st_mode) && lseek(file.value, 0, SEEK_CUR) == 0;
  if (!whole) {
    read_pipe(file.value);
    return;
  }
  size_ = static_cast<std::size_t>(status.st_size);
  descriptor_ = std::exchange(file.value, -1);
}

InputFile::InputFile(std::string name, std::span<const std::byte> bytes)
    : name_(std::move(name)), size_(bytes.size()), start_(bytes.begin(), bytes.end()) {}

InputFile::~InputFile() {
  if (descriptor_ >= 0) close(descriptor_);
}

InputFile::InputFile(InputFile&& other) noexcept
    : name_(std::move(other.name_)),
      size_(std::exchange(other.size_, 0)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      start_(std::move(other.start_)) {}

std::span<const std::byte> InputFile::head(std::size_t size) const {
  size = std::min(size, size_);
  const std::size_t held = start_.size();
  if (held < size) {
    if (size > available_memory_for(size)) {
      throw_io(name_, "is too large for this machine's memory");
    }
    start_.resize(size);
    try {
      std::optional<ProgressStage> stage;
      if (size - held > kReadAtOnce) stage.emplace("reading " + name_, size - held, "B");
      for (std::size_t at = held; at < size; at += kReadAtOnce) {
        const std::size_t more = std::min(kReadAtOnce, size - at);
        read(start_.data() + at, at, more);
        if (stage) stage->add(more);
      }
    } catch (...) {
      start_.resize(held);
      throw;
    }
  }
  return {start_.data(), size};
}

std::string_view InputFile::header(std::string_view last) const {
  constexpr std::size_t kFirst = std::size_t{1} << 16;  // Longer than nearly all headers.
  for (std::size_t size = kFirst;; size *= 4) {
    const std::string_view text = as_text(head(size));
    if (text.size() == size_ || has_line(text, last)) return text;
  }
}

void InputFile::read(std::byte* to, std::size_t offset, std::size_t size) const {
  for (std::size_t done = 0; done < size;) {
    const ssize_t got =
        pread(descriptor_, to + done, size - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw_io(name_, "cannot be read: " + cause());
    if (got == 0) throw_io(name_, "became shorter while it was read");
    done += static_cast<std::size_t>(got);
  }
}

const std::byte* InputFile::read_at(std::size_t offset, std::size_t size,
                                    Array<std::byte>& scratch) const {
  if (offset + size <= start_.size()) return start_.data() + offset;
  if (scratch.size() < size) scratch.resize(size);
  read(scratch.data(), offset, size);
  return scratch.data();
}

void InputFile::expect(std::size_t offset, std::size_t size) const noexcept {
  if (descriptor_ < 0) return;
  posix_fadvise(descriptor_, static_cast<off_t>(offset), static_cast<off_t>(size),
                POSIX_FADV_WILLNEED);
}

void InputFile::read_pipe(int descriptor) {
  // Bytes; each further step doubles the memory.
  constexpr std::size_t kFirst = std::size_t{1} << 20;
  for (;;) {
    if (size_ == start_.size()) {
      const std::size_t grown = std::max(kFirst, 2 * size_);
      if (grown > available_memory_for(grown)) {
        throw_io(name_, "is too large for this machine's memory; store it in a file");
      }
      start_.resize(grown);
    }
    const ssize_t got = ::read(descriptor, start_.data() + size_, start_.size() - size_);
    if (got == 0) break;
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw_io(name_, "cannot be read: " + cause());
    size_ += static_cast<std::size_t>(got);
  }
  start_.resize(size_);
}

}  // namespace surfel
