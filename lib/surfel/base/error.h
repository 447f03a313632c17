#pragma once

#include <stdexcept>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// What kind of failure an Error reports; the tools turn it into their exit code.
enum class ErrorKind {
  kUsage,        ///< Options that contradict each other or are out of range: exit code 2.
  kInput,        ///< The input's content is wrong: exit code 1.
  kIo,           ///< A file cannot be opened, read or written: exit code 1.
  kNumeric,      ///< A computation failed on valid input: exit code 1.
  kInterrupted,  ///< The user asked to stop: exit code 1.
};

/// The library's one exception. The message says what was found and what to do, and starts with the
/// file's name where there is one: "scan.ply: 3 normals are NaN (first: vertex 417); ...".
class SURFEL_API Error : public std::runtime_error {
 public:
  /// NUL bytes of the message, which would end what(), become "\\0".
  Error(ErrorKind kind, const std::string& message);
  ErrorKind kind() const noexcept { return kind_; }

 private:
  ErrorKind kind_;
};

[[noreturn]] inline void throw_usage(const std::string& message) {
  throw Error(ErrorKind::kUsage, message);
}
/// `file` may be empty where the data did not come from one.
[[noreturn]] inline void throw_input(const std::string& file, const std::string& message) {
  throw Error(ErrorKind::kInput, file.empty() ? message : file + ": " + message);
}
[[noreturn]] inline void throw_io(const std::string& file, const std::string& message) {
  throw Error(ErrorKind::kIo, file.empty() ? message : file + ": " + message);
}

}  // namespace surfel
