#pragma once

#include <map>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// Results that a long run has found so far, kept in a file, so that the run can be taken up where
/// it was interrupted. The file is lines of JSON: the name of the run, then a pair of texts each. A
/// line that an interrupted run left incomplete is dropped with all lines after it.
class SURFEL_API Journal {
 public:
  /// Takes up the file if it is there and its run has this name; begins it anew otherwise. Throws
  /// Error(kIo) if the file cannot be read or written.
  Journal(std::string path, const std::string& run);

  /// The value that was added under the key; null if there is none.
  const std::string* find(const std::string& key) const;
  /// Adds an entry, in the file before this returns. Throws Error(kIo).
  void add(const std::string& key, const std::string& value);
  std::size_t size() const { return entries_.size(); }

 private:
  std::string path_;
  std::map<std::string, std::string> entries_;
};

}  // namespace surfel
