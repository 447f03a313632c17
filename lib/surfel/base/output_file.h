#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// What becomes of the bytes of a run that ends before commit().
enum class Unfinished {
  kRemoved,
  /// They stay beside the target as TARGET.unfinished, and the next OutputFile that keeps them goes
  /// on with them.
  kKept,
  /// They are another process's: the target is the temporary of an OutputFile that is open there,
  /// and this process writes parts of it.
  kElsewhere,
};

/// A file that appears whole or not at all: written to a temporary beside the target and renamed by
/// commit(), once its bytes are on the disk. Destroyed without commit() (an exception, an
/// interrupted run) it leaves no trace; the temporary of a process that was killed is removed by
/// the next that writes to the folder. An older file of that name stays as it was, and keeps its
/// permissions when replaced. A symbolic link stays one: the file that it stands for is replaced.
/// "-" (standard output) and targets that are no regular files (pipes, devices) are written to on
/// commit().
class SURFEL_API OutputFile {
 public:
  /// Creates the temporary. Throws Error(kIo) naming file and cause: the folder does not exist, the
  /// target is a directory, is read-only, or is there already and `no_clobber` is set; standard
  /// output is closed. Where bytes are kept the target has to be a regular file, if it is there,
  /// that no other process makes at the same time.
  explicit OutputFile(std::string target, bool no_clobber = false,
                      Unfinished unfinished = Unfinished::kRemoved);
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Appends. Throws Error(kIo) (disk full and the like).
  void write(const void* data, std::size_t bytes);
  void write(const std::string& text) { write(text.data(), text.size()); }

  /// Leaves room for so many bytes, to be filled by write_at(), and returns their offset; write()
  /// goes on behind them.
  std::uint64_t reserve(std::uint64_t bytes);
  /// Fills a part of what reserve() left. Callable from several threads at once. Throws as write().
  void write_at(std::uint64_t offset, const void* data, std::size_t bytes) const;

  /// Reads what was written; returns the number of bytes that are there. Callable from several
  /// threads at once.
  std::size_t read_at(std::uint64_t offset, void* to, std::size_t bytes) const;
  /// Drops all bytes; write() begins anew.
  void clear();

  /// Name of the temporary, for libraries that want to open it themselves. It keeps the target's
  /// extension, by which image libraries choose the format.
  const std::string& temporary() const { return temporary_; }

  /// Waits for the disk and renames to the target (or copies to standard output).
  void commit();

 private:
  bool rename_to_target() const;
  void copy_to_target() const;

  std::string target_;
  std::string temporary_;
  int descriptor_ = -1;
  bool no_clobber_ = false;
  Unfinished unfinished_;
  bool copied_ = false;  ///< The target cannot be renamed to: commit() copies.
  bool committed_ = false;
};

/// Writes bytes to a descriptor, however many calls that takes. Throws Error(kIo) starting with
/// `name`, what the descriptor stands for.
SURFEL_API void write_all(int descriptor, const void* data, std::size_t bytes,
                          const std::string& name);

/// Removes the temporaries of all OutputFiles that are open; for handlers of signals that end the
/// process (async-signal-safe).
SURFEL_API void remove_temporaries() noexcept;

}  // namespace surfel
