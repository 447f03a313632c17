#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <surfel/io/input_file.h>

namespace surfel {

/// Words and numbers of a text file line by line: comments (#) end a line, a backslash before its
/// end continues it. Lines end in LF, CR LF or CR. Internal to the io module.
class LineScanner {
 public:
  explicit LineScanner(const InputFile& file);

  bool at_end() const { return at_ == end_; }
  /// Skips blanks; is nothing but a comment left in the line?
  bool at_line_end();
  /// To the start of the next line, whatever is left in this one.
  void next_line();
  /// Like at_line_end(), but goes on over line ends until there is something; false at the end of
  /// the file.
  bool skip_to_content();

  /// The next word of the line; empty at its end. A comment starts at a word's start only.
  std::string_view word();
  /// The same, but stays before it.
  std::string_view peek_word();
  /// The rest of the line without blanks around it; # and \ are part of it.
  std::string_view rest_of_line();
  /// A finite number, or an error that names `what`.
  double number(const char* what);
  std::int64_t integer(const char* what);
  /// The next character, blanks too; 0 at the end of the file.
  char peek() const { return at_ == end_ ? '\0' : *at_; }
  bool at_word_end() const { return at_word_end(at_); }
  /// Is the next character `c`? Then skips it. Blanks are not skipped.
  bool skip(char c);

  const char* position() const { return at_; }
  std::size_t remaining() const { return static_cast<std::size_t>(end_ - at_); }

  /// Throws Error(kInput) with the line of the last word, number or integer.
  [[noreturn]] void fail(const std::string& message) const;
  [[noreturn]] void fail_at(const char* place, const std::string& message) const;

 private:
  bool at_word_end(const char* c) const;
  std::string_view word_at(const char* c) const;

  const InputFile& file_;
  const char* first_;
  const char* at_;
  const char* end_;
  const char* token_;
};

}  // namespace surfel
