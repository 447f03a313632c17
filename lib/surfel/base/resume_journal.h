#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Entries that a long run adds to a file one by one, for a later run that goes on after it was
/// interrupted. Every entry has its length and its checksum (CRC-32C); a file is read up to the
/// first entry that is not whole, as a run that was killed leaves one.
class SURFEL_API ResumeJournal {
 public:
  explicit ResumeJournal(std::string path) : path_(std::move(path)) {}
  ~ResumeJournal();
  ResumeJournal(const ResumeJournal&) = delete;
  ResumeJournal& operator=(const ResumeJournal&) = delete;

  /// Opens the file, and hands on its entries if they are of the same job; else begins it anew.
  /// Throws Error(kIo) where the file cannot be written.
  std::vector<std::string> open(const std::string& job);
  /// Adds an entry. Throws Error(kIo).
  void add(const std::string& entry);
  /// Removes the file, if there is one.
  void remove();

 private:
  std::string path_;
  int descriptor_ = -1;
};

/// "size-time-checksum" of a file, by which a later run knows that it is the same: its bytes, when
/// it was changed, and the checksum of pieces spread evenly over it. Throws Error(kIo).
SURFEL_API std::string file_mark(const std::string& path);

}  // namespace surfel
