#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <span>
#include <string_view>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/base/kept_file.h>
#include <surfel/base/output_file.h>
#include <surfel/base/resume_journal.h>
#include <surfel/base/whole_file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace surfel {
namespace {

struct EntryHead {
  std::uint64_t bytes;
  std::uint64_t checksum;
};

std::uint32_t checksum_of(std::string_view text) {
  return crc32c(std::as_bytes(std::span(text.data(), text.size())));
}

[[noreturn]] void fail(const std::string& path) {
  throw_io(path, std::string("cannot be written: ") + std::strerror(errno));
}

struct FileLook {
  std::uint64_t size;
  timespec changed;
  std::uint32_t checksum;
};

/// Size, time of change and checksum of a file: of so many pieces spread evenly over it, which are
/// all of it where it is short. Throws Error(kIo).
FileLook look_at(const std::string& path, std::uint64_t pieces) {
  constexpr std::uint64_t kPiece = std::uint64_t{1} << 16;
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat status {};
  if (file < 0 || fstat(file, &status) != 0) {
    const std::string why = std::strerror(errno);
    if (file >= 0) close(file);
    throw_io(path, "cannot be read: " + why);
  }
  const auto size = static_cast<std::uint64_t>(status.st_size);
  std::string checksums;
  std::string piece(kPiece, '\0');
  for (std::uint64_t k = 0; k < pieces && k * kPiece < size; ++k) {
    const std::uint64_t at =
        size <= pieces * kPiece ? k * kPiece : (size - kPiece) * k / (pieces - 1);
    const ssize_t got = pread(file, piece.data(), kPiece, static_cast<off_t>(at));
    if (got <= 0) continue;
    const std::string_view read(piece.data(), static_cast<std::size_t>(got));
    checksums += fmt::format("{:08x}", checksum_of(read));
  }
  close(file);
  return {size, status.st_mtim, checksum_of(checksums)};
}

}  // namespace

ResumeJournal::~ResumeJournal() {
  if (descriptor_ >= 0) close(descriptor_);
}

ResumeJournal::ResumeJournal(std::string path, std::string job)
    : path_(std::move(path)), job_(std::move(job)) {
  const int file = open_kept(path_, O_RDONLY);
  if (file < 0) return;
  close(file);
  const std::string text = whole_file(path_);
  while (text.size() - whole_ >= sizeof(EntryHead)) {
    EntryHead head{};
    std::memcpy(&head, text.data() + whole_, sizeof(head));
    if (head.bytes > text.size() - whole_ - sizeof(head)) break;
    std::string entry = text.substr(whole_ + sizeof(head), head.bytes);
    if (head.checksum != checksum_of(entry)) break;
    if (whole_ > 0) {
      entries_.push_back(std::move(entry));
    } else if (entry != job_) {
      break;
    }
    whole_ += sizeof(head) + head.bytes;
  }
}

void ResumeJournal::write(const std::string& entry) {
  const EntryHead head{entry.size(), checksum_of(entry)};
  std::string bytes(reinterpret_cast<const char*>(&head), sizeof(head));
  bytes += entry;
  write_all(descriptor_, bytes.data(), bytes.size(), path_);
}

void ResumeJournal::add(const std::string& entry) {
  if (descriptor_ < 0) {
    descriptor_ = open_kept(path_, O_WRONLY | O_CREAT);
    if (descriptor_ < 0 || ftruncate(descriptor_, static_cast<off_t>(whole_)) != 0 ||
        lseek(descriptor_, 0, SEEK_END) < 0) {
      fail(path_);
    }
    if (whole_ == 0) write(job_);
  }
  write(entry);
}

void ResumeJournal::remove() {
  if (descriptor_ >= 0) close(descriptor_);
  descriptor_ = -1;
  if (unlink(path_.c_str()) != 0 && errno != ENOENT) fail(path_);
}

std::string file_mark(const std::string& path) {
  constexpr std::uint64_t kPieces = 64;
  const FileLook look = look_at(path, kPieces);
  return fmt::format("{}-{}.{:09}-{:08x}", look.size, look.changed.tv_sec, look.changed.tv_nsec,
                     look.checksum);
}

std::string content_mark(const std::string& path) {
  namespace fs = std::filesystem;
  constexpr std::uint64_t kPieces = 4096;
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    const FileLook look = look_at(path, kPieces);
    return fmt::format("{}-{:08x}", look.size, look.checksum);
  }
  std::vector<std::string> files;
  for (fs::directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
    if (at->is_regular_file(error)) files.push_back(at->path().string());
  }
  if (error) throw_io(path, "cannot be read: " + error.message());
  std::sort(files.begin(), files.end());
  std::string marks;
  for (const std::string& file : files) {
    marks += fs::path(file).filename().string() + content_mark(file) + "\n";
  }
  return fmt::format("{}-{:08x}", files.size(), checksum_of(marks));
}

}  // namespace surfel
