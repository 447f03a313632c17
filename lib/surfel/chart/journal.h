#pragma once

#include <map>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// What a long run has found so far, kept in a file, so that the run can be taken up where it was
/// interrupted. The file is lines of JSON: the name of the run, then a pair of texts each. A line
/// that is not whole, as an interrupted run leaves it, and what follows it, is dropped.
class SURFEL_API Journal {
 public:
  /// Takes up the file, if it is there and of a run of the same name; begins it anew otherwise.
  /// Throws Error(kIo) if it cannot be read or written.
  Journal(std::string path, const std::string& run);

  /// What was added under the key; null if nothing was.
  const std::string* find(const std::string& key) const;
  /// Adds an entry, in the file before this returns. Throws Error(kIo).
  void add(const std::string& key, const std::string& value);
  std::size_t size() const { return entries_.size(); }

 private:
  std::string path_;
  std::map<std::string, std::string> entries_;
};

}  // namespace surfel
