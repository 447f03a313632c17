#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <surfel/base/function_ref.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Blank-separated numbers of a text file, read one after the other. Internal to the io module.
class TextNumbers {
 public:
  /// Starts at byte `begin` of the file, whose name goes into the errors.
  TextNumbers(std::string file, std::span<const std::byte> bytes, std::size_t begin);

  std::size_t position() const { return static_cast<std::size_t>(at_ - first_); }
  std::size_t remaining() const { return static_cast<std::size_t>(end_ - at_); }

  /// The next token, on whatever line; nullopt at the end of the file.
  std::optional<std::string_view> next();
  /// Reads the next token as a value of `type` into `to`, in this machine's byte order. Throws
  /// Error(kInput) naming the line where it is no number or does not fit the type, or where the
  /// file ends; `what` names what was looked for, and is called only then.
  void read(ScalarType type, std::byte* to, FunctionRef<std::string()> what);
  /// Throws Error(kInput) if the current line holds a further token.
  void expect_line_end(FunctionRef<std::string()> what);
  /// Throws Error(kInput) with the line of the last token.
  [[noreturn]] void fail(const std::string& message) const;

 private:
  std::string file_;
  const char* first_;
  const char* at_;
  const char* end_;
  const char* token_;  ///< Start of the last token.
};

/// Parses all of `text`: decimal, exponent, leading + and ., nan and inf in C's spellings and in
/// those of old Windows libraries (1.#IND, -1.#INF). Independent of the locale.
std::optional<double> parse_number(std::string_view text);

/// At most 40 characters of `text` in quotes, unprintable ones replaced: for messages.
std::string quoted_excerpt(std::string_view text);

}  // namespace surfel
