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

 private:
  void read_all(int descriptor);

  std::string name_;
  std::span<const std::byte> bytes_;
  bool mapped_ = false;
  Array<std::byte> buffer_;  ///< What was read from a pipe.
};

}  // namespace surfel
