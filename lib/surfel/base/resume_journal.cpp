#include <algorithm>
#include <cerrno>
#include <cstring>
#include <span>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
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

std::uint32_t checksum_of(const std::string& text) {
  return crc32c(std::as_bytes(std::span(text.data(), text.size())));
}

[[noreturn]] void fail(const std::string& path) {
  throw_io(path, std::string("cannot be written: ") + std::strerror(errno));
}

}  // namespace

ResumeJournal::~ResumeJournal() {
  if (descriptor_ >= 0) close(descriptor_);
}

ResumeJournal::ResumeJournal(std::string path, std::string job)
    : path_(std::move(path)), job_(std::move(job)) {
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
    descriptor_ = open(path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
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
  constexpr std::uint64_t kPiece = std::uint64_t{1} << 16;
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat status {};
  if (file < 0 || fstat(file, &status) != 0) {
    const std::string why = std::strerror(errno);
    if (file >= 0) close(file);
    throw_io(path, "cannot be read: " + why);
  }
  const auto size = static_cast<std::uint64_t>(status.st_size);
  std::string pieces;
  std::string piece(kPiece, '\0');
  for (std::uint64_t k = 0; k < kPieces && k * kPiece < size; ++k) {
    const std::uint64_t at =
        size <= kPieces * kPiece ? k * kPiece : (size - kPiece) * k / (kPieces - 1);
    const ssize_t got = pread(file, piece.data(), kPiece, static_cast<off_t>(at));
    if (got > 0) pieces.append(piece, 0, static_cast<std::size_t>(got));
  }
  close(file);
  return fmt::format("{}-{}.{:09}-{:08x}", size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec,
                     checksum_of(pieces));
}

}  // namespace surfel
