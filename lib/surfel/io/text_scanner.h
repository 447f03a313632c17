#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Characters that part a text into lines and lines into words.
struct TextFormat {
  std::string_view separators = " \t\v\f";
  std::string_view line_ends = "\n\r";  ///< CR LF ends one line where both are named.
  bool comments = false;                ///< A word that starts with # ends the line.
  bool continuation = false;            ///< A backslash before a line's end goes on with the next.
};

/// Format of OBJ, MTL, OFF and STL.
inline constexpr TextFormat kMeshText{.comments = true, .continuation = true};
/// Format of PLY and PCD headers. A CR is a separator, so that a binary body, which starts after
/// the last LF, may start with any byte.
inline constexpr TextFormat kHeaderText{.separators = " \t\v\f\r", .line_ends = "\n"};

/// The tokeniser of all text formats: words and numbers, line by line. Numbers do not depend on the
/// locale. Keeps a view of the text. A byte-order mark before the text is skipped. Internal to the
/// io module.
class TextScanner {
 public:
  /// \param name   Name of the file, for messages.
  /// \param begin  Offset of the first character to be read; the lines before it count in messages.
  TextScanner(std::string name, std::string_view text, const TextFormat& format = {},
              std::size_t begin = 0);
  TextScanner(std::string name, std::string&& text, const TextFormat& format = {},
              std::size_t begin = 0) = delete;

  /// Of a text that is a part of a file: counts the lines before it, for messages.
  void count_lines_before(std::function<std::size_t()> count) { lines_before_ = std::move(count); }

  bool at_end() const { return at_ == end_; }
  /// Skips separators; true if nothing but a comment is left in the line.
  bool at_line_end();
  /// Goes to the start of the next line, whatever is left in this one.
  void next_line();
  /// Skips separators, comments and line ends up to the next word; false if the text ends before.
  bool skip_to_content();

  /// The next word of the line; empty at the line's end.
  std::string_view word();
  /// The next word of the line, which stays to be read.
  std::string_view peek_word();
  /// All words that are left in the line, in place of those that `words` holds.
  void rest_of_words(std::vector<std::string_view>& words);
  /// The rest of the line without separators around it; # and \ are part of it.
  std::string_view rest_of_line();
  /// The next word of the line as a finite number, or an error that names `what`.
  double number(const char* what);
  /// An integer, which need not end with its word, or an error that names `what`.
  std::int64_t integer(const char* what);
  /// Reads the next word, on whatever line, as a value of `type` into `to`, in this machine's byte
  /// order. Throws Error(kInput) where the word is no number, where the number does not fit the
  /// type, and where the text ends; `what` names the value, and is called only then.
  void read(ScalarType type, std::byte* to, FunctionRef<std::string()> what);
  /// Throws Error(kInput) if the line holds a further word; `what` names its record.
  void expect_line_end(FunctionRef<std::string()> what);

  /// The next character, be it a separator; 0 at the end of the text.
  char peek() const { return at_ == end_ ? '\0' : *at_; }
  bool at_word_end() const { return at_word_end(at_); }
  /// Skips the next character and returns true if it is `c`. Separators are not skipped before it.
  bool skip(char c);

  /// Offset of the next character.
  std::size_t position() const { return static_cast<std::size_t>(at_ - first_); }
  std::size_t remaining() const { return static_cast<std::size_t>(end_ - at_); }

  /// Throws Error(kInput) that names the file and the line of the last word or number.
  [[noreturn]] void fail(const std::string& message) const;
  /// Throws Error(kInput) that names the file and the line of an offset.
  [[noreturn]] void fail_at(std::size_t position, const std::string& message) const;

 private:
  std::uint8_t kind_of(char c) const { return kind_[static_cast<unsigned char>(c)]; }
  bool continues(const char* c) const;
  bool is_pair(const char* c) const;
  bool at_word_end(const char* c) const;
  std::string_view word_at(const char* c) const;
  template <class T>
  bool take(T& value);

  std::string name_;
  std::array<std::uint8_t, 256> kind_{};  ///< The meaning of each character.
  const char* first_;
  const char* at_;
  const char* end_;
  const char* token_;  ///< Start of the last word or number.
  std::function<std::size_t()> lines_before_;
};

/// Parses all of `text`: decimal, exponent, leading + and ., nan and inf in C's spellings and in
/// those of old Windows libraries (1.#IND, -1.#INF). A number beyond the range of double is
/// infinite, one too small for it zero. Independent of the locale.
std::optional<double> parse_number(std::string_view text);

/// Parses all of `text` as a number of things.
std::optional<std::size_t> parse_count(std::string_view text);

/// The end of a message about numbers with decimal commas, after the excerpt.
inline constexpr const char* kDecimalCommas =
    " has decimal commas, which are not read; write numbers with decimal points";

/// At most 40 characters of `text` in quotes, unprintable ones replaced: for messages.
std::string quoted_excerpt(std::string_view text);

/// The text with its ASCII letters A-Z in lower case.
std::string lower_case(std::string_view text);
/// The extension of a file's name with its dot, in lower case.
std::string lower_extension(const std::string& path);

}  // namespace surfel
