#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// The bytes of a file, of standard input, or of memory. Regular files are read when their bytes
/// are asked for and never mapped: a mapped file that another program cuts ends this one by a
/// signal, where a read gives an error. Pipes are read to their end as long as the machine has
/// memory for them.
class SURFEL_API InputFile {
 public:
  /// Throws Error(kIo) naming the file and the cause, as all members do, also where the file became
  /// shorter after it was opened.
  /// \param path          "-": standard input.
  /// \param regular_only  All but regular files are an error, which waits for nothing; "-" is a
  ///                      file of this name.
  explicit InputFile(const std::string& path, bool regular_only = false);
  /// A file of these bytes, which are copied, e.g. out of an archive or a network. Readers that
  /// tell formats by the names of files, and messages, take `name`; no file need have it.
  InputFile(std::string name, std::span<const std::byte> bytes);
  ~InputFile();
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&&) = delete;

  /// For messages: the path, or "standard input".
  const std::string& name() const { return name_; }
  std::size_t size() const { return size_; }
  /// Is it a regular file, which can be opened again, and not a pipe or memory?
  bool regular() const { return descriptor_ >= 0; }

  /// The first `size` bytes, or all bytes of a shorter file. They stay in memory; a call for more
  /// bytes moves them. One thread at a time.
  std::span<const std::byte> head(std::size_t size) const;
  /// All bytes, in memory. One thread at a time.
  std::span<const std::byte> bytes() const { return head(size_); }
  /// The first bytes as text, at least up to the end of the line that starts with `last`; all bytes
  /// if no line starts with it.
  std::string_view header(std::string_view last) const;

  /// `size` bytes from `offset` on, all inside the file: a view of them if they are in memory, else
  /// a copy read into `scratch`. Callable from any thread, but not while head() runs.
  const std::byte* read_at(std::size_t offset, std::size_t size, Array<std::byte>& scratch) const;
  /// Announces that read_at() will soon be called for these bytes; the system may read them ahead.
  void expect(std::size_t offset, std::size_t size) const noexcept;

 private:
  void read_pipe(int descriptor);
  void read(std::byte* to, std::size_t offset, std::size_t size) const;

  std::string name_;
  std::size_t size_ = 0;
  int descriptor_ = -1;             ///< Descriptor of a regular file; -1 for all others.
  mutable Array<std::byte> start_;  ///< The first bytes of a file, or all bytes.
};

/// The bytes as characters.
inline std::string_view as_text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace surfel
