#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/types.h>
#include <surfel/io/input_file.h>

namespace surfel {

/// An E57 file consists of pages of 1024 bytes, whose last four are the CRC-32C of the others. What
/// the file holds runs on from page to page, past these checksums: addresses there are logical; an
/// address that counts the checksums is physical. Internal to the io module.
class E57Pages {
 public:
  static constexpr std::size_t kPage = 1024;
  static constexpr std::size_t kPayload = 1020;

  /// \param bytes  physical size, whole pages that the file has. Keeps a reference to the file.
  E57Pages(const InputFile& file, std::uint64_t bytes) : file_(file), pages_(bytes / kPage) {}
  E57Pages(InputFile&& file, std::uint64_t bytes) = delete;

  const InputFile& file() const { return file_; }
  std::uint64_t pages() const { return pages_; }
  /// Logical size of the file.
  std::uint64_t size() const { return pages_ * kPayload; }
  /// The logical address of a physical one; Error(kInput) that names `what` if that lies in a
  /// checksum or outside of the file.
  std::uint64_t logical(std::uint64_t physical, const char* what) const;

 private:
  const InputFile& file_;
  std::uint64_t pages_;
};

/// Reads consecutive parts of the pages, and checks each page that it reads. One thread at a time;
/// several threads may each have one.
class E57Window {
 public:
  /// \param pages_at_once  Pages to be read together, at least 1: many where all bytes are wanted,
  ///                       few where most are skipped. Keeps a reference to the pages.
  E57Window(const E57Pages& pages, std::size_t pages_at_once)
      : pages_(pages), at_once_(pages_at_once) {}

  /// Copies `size` bytes from a logical address on, all inside the file. Throws Error(kInput) for
  /// a page whose checksum is wrong.
  void copy(std::uint64_t begin, std::size_t size, std::byte* to);

 private:
  void load(std::uint64_t page);

  const E57Pages& pages_;
  std::size_t at_once_;
  std::uint64_t begin_ = 0;  ///< Logical address of the bytes that are held.
  std::size_t held_ = 0;
  Array<std::byte> bytes_;
  Array<std::byte> scratch_;
};

}  // namespace surfel
