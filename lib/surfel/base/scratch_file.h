#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// A file on the disk of another file, for what does not fit into memory. Without a name it is gone
/// with this object, and with the process, however that ends; with a name, for work that a later
/// run goes on with, it stays until remove().
class SURFEL_API ScratchFile {
 public:
  /// Creates the file in the folder of `beside`, whose name starts messages; for a target that is
  /// no regular file in the folder of temporaries ($TMPDIR, or /tmp). Throws Error(kIo) where it
  /// cannot.
  /// \param name  of the file; empty: none. What it holds already stays.
  explicit ScratchFile(const std::string& beside, const std::string& name = {});
  ~ScratchFile();
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  /// Bytes that the disk has left for this user; the largest value where the system does not tell.
  std::uint64_t free_bytes() const;
  std::uint64_t size() const { return size_; }
  /// Appends, and returns the offset of what was appended. Throws Error(kIo) (disk full and the
  /// like).
  std::uint64_t append(const void* data, std::size_t bytes);
  /// Drops what an earlier run appended behind these bytes. False if there are fewer.
  bool keep(std::uint64_t bytes);
  /// Removes the file, if it has a name.
  void remove();
  /// Reads what was appended. Callable from several threads at once. Throws Error(kIo).
  void read_at(std::uint64_t offset, void* to, std::size_t bytes) const;

 private:
  std::string beside_;
  std::string folder_;
  std::string name_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace surfel
