#pragma once

#include <cstddef>
#include <span>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// The bytes of a file, or of standard input. Regular files are mapped, not copied; pipes are read
/// to their end as long as the machine has memory for them.
class SURFEL_API InputFile {
 public:
  /// `path` "-" is standard input. Throws Error(kIo) naming the file and the cause.
  explicit InputFile(const std::string& path);
  ~InputFile();
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&&) = delete;

  /// For messages: the path, or "standard input".
  const std::string& name() const { return name_; }
  std::span<const std::byte> bytes() const { return bytes_; }

  /// `size` bytes from `offset` on, which the file has: copied into `scratch` where the file is
  /// mapped, so that none of its pages becomes part of this process's memory, else a view. For
  /// large files read once in pieces: no slower than the mapping, whose pages cost a fault each.
  /// Callable from any thread. Throws Error(kIo) naming the file, also if it was cut meanwhile.
  const std::byte* read_at(std::size_t offset, std::size_t size, Array<std::byte>& scratch) const;
  /// Tells that read_at() will soon be called for these bytes; the system may read them ahead.
  void expect(std::size_t offset, std::size_t size) const noexcept;

 private:
  void read_all(int descriptor);

  std::string name_;
  std::span<const std::byte> bytes_;
  bool mapped_ = false;
  int descriptor_ = -1;      ///< Of a mapped file.
  Array<std::byte> buffer_;  ///< What was read from a pipe.
};

}  // namespace surfel
