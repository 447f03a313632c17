#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Entries that a long run adds to a file one by one, for a later run that goes on after it was
/// interrupted. Every entry has its length and its checksum (CRC-32C); a file is read up to the
/// first entry that is not whole, as a run that was killed leaves one.
class SURFEL_API ResumeJournal {
 public:
  /// Reads the entries that earlier runs of the same job have added; a file that is not there, or
  /// of another job, has none, and stays as it is until add().
  ResumeJournal(std::string path, std::string job);
  ~ResumeJournal();
  ResumeJournal(const ResumeJournal&) = delete;
  ResumeJournal& operator=(const ResumeJournal&) = delete;

  /// The entries of earlier runs, which are handed out once.
  std::vector<std::string> take_entries() { return std::move(entries_); }
  /// Adds an entry. Throws Error(kIo) where the file cannot be written.
  void add(const std::string& entry);
  /// Removes the file, if there is one.
  void remove();

 private:
  void write(const std::string& entry);

  std::string path_;
  std::string job_;
  std::vector<std::string> entries_;
  std::size_t whole_ = 0;  ///< Bytes of the entries that are whole; 0: of another job, or none.
  int descriptor_ = -1;
};

/// "size-time-checksum" of a file, by which a later run knows that it is the same: its bytes, when
/// it was changed, and the checksum of pieces spread evenly over it. Throws Error(kIo).
SURFEL_API std::string file_mark(const std::string& path);

/// "size-checksum" of what a file holds, wherever it lies and whenever it was written: of all its
/// bytes up to 256 MB, of pieces spread evenly over larger ones; of a folder by its files. Throws
/// Error(kIo).
SURFEL_API std::string content_mark(const std::string& path);

}  // namespace surfel
