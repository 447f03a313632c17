#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>

#include <fmt/format.h>
#include <locale.h>
#include <surfel/base/error.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

// Kinds of characters, the values of TextScanner::kind_.
constexpr std::uint8_t kSeparator = 1;
constexpr std::uint8_t kLineEnd = 2;
constexpr std::uint8_t kComment = 3;
constexpr std::uint8_t kContinuation = 4;

/// "1.#IND", "1.#QNAN", "1.#INF" without their sign.
std::optional<double> parse_windows_special(std::string_view text) {
  if (text.starts_with("1.#INF")) return std::numeric_limits<double>::infinity();
  if (text.starts_with("1.#IND") || text.starts_with("1.#QNAN") || text.starts_with("1.#SNAN")) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return std::nullopt;
}

/// from_chars() that takes a leading +, too.
template <class T>
std::from_chars_result parse_prefix(const char* begin, const char* end, T& value) {
  const bool plus = begin != end && *begin == '+' && begin + 1 != end && begin[1] != '-';
  return std::from_chars(begin + plus, end, value);
}

/// A number that from_chars refuses as too large or too small for T is infinite or zero.
template <class T>
std::optional<T> parse(std::string_view text) {
  T value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = parse_prefix(text.data(), end, value);
  if (error == std::errc{} && stop == end) return value;
  if constexpr (std::is_floating_point_v<T>) {
    if (error == std::errc::result_out_of_range && stop == end) {
      static const locale_t plain = newlocale(LC_ALL_MASK, "C", nullptr);
      return static_cast<T>(strtod_l(std::string(text).c_str(), nullptr, plain));
    }
    const bool negative = text.starts_with('-');
    if (negative || text.starts_with('+')) text.remove_prefix(1);
    if (const auto special = parse_windows_special(text)) {
      return static_cast<T>(negative ? -*special : *special);
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> parse_number(std::string_view text) { return parse<double>(text); }

std::optional<std::size_t> parse_count(std::string_view text) { return parse<std::size_t>(text); }

std::string quoted_excerpt(std::string_view text) {
  // Enough to find the place, and to keep a message on one line.
  constexpr std::size_t kLongest = 40;
  std::string excerpt(text.substr(0, kLongest));
  std::replace_if(
      excerpt.begin(), excerpt.end(), [](unsigned char c) { return c < ' ' || c > '~'; }, '?');
  return "'" + excerpt + (text.size() > kLongest ? "...'" : "'");
}

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return lower;
}

std::string lower_extension(const std::string& path) {
  return lower_case(std::filesystem::path(path).extension().string());
}

TextScanner::TextScanner(std::string name, std::string_view text, const TextFormat& format,
                         std::size_t begin)
    : name_(std::move(name)),
      first_(text.data()),
      at_(first_ + begin),
      end_(first_ + text.size()),
      token_(at_) {
  const auto mark = [&](std::string_view characters, std::uint8_t kind) {
    for (const char c : characters) kind_[static_cast<unsigned char>(c)] = kind;
  };
  mark(format.separators, kSeparator);
  mark(format.line_ends, kLineEnd);
  if (format.comments) mark("#", kComment);
  if (format.continuation) mark("\\", kContinuation);
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (begin == 0 && text.starts_with(kByteOrderMark)) at_ += kByteOrderMark.size();
}

/// Does the line continue after this backslash on the next line?
bool TextScanner::continues(const char* c) const {
  return c + 1 != end_ && kind_of(c[1]) == kLineEnd;
}

/// Do this line end and the next character end one line together?
bool TextScanner::is_pair(const char* c) const {
  return *c == '\r' && c + 1 != end_ && c[1] == '\n' && kind_of('\n') == kLineEnd;
}

bool TextScanner::at_line_end() {
  while (at_ != end_) {
    const std::uint8_t kind = kind_of(*at_);
    if (kind == kSeparator) {
      ++at_;
    } else if (kind == kContinuation && continues(at_)) {
      next_line();
    } else {
      return kind == kLineEnd || kind == kComment;
    }
  }
  return true;
}

void TextScanner::next_line() {
  while (at_ != end_ && kind_of(*at_) != kLineEnd) ++at_;
  if (at_ == end_) return;
  at_ += is_pair(at_) ? 2 : 1;
}

bool TextScanner::skip_to_content() {
  while (at_line_end()) {
    if (at_ == end_) return false;
    next_line();
  }
  return true;
}

bool TextScanner::at_word_end(const char* c) const {
  // note: # within a word starts no comment; "1.#IND" is how old Windows libraries print NaN.
  if (c == end_) return true;
  const std::uint8_t kind = kind_of(*c);
  return kind == kSeparator || kind == kLineEnd || (kind == kContinuation && continues(c));
}

std::string_view TextScanner::word_at(const char* c) const {
  const char* stop = c;
  while (!at_word_end(stop)) ++stop;
  return {c, static_cast<std::size_t>(stop - c)};
}

std::string_view TextScanner::word() {
  const std::string_view found = peek_word();
  token_ = at_;
  at_ += found.size();
  return found;
}

std::string_view TextScanner::peek_word() {
  return at_line_end() ? std::string_view{} : word_at(at_);
}

void TextScanner::rest_of_words(std::vector<std::string_view>& words) {
  words.clear();
  while (!at_line_end()) words.push_back(word());
}

std::string_view TextScanner::rest_of_line() {
  at_line_end();
  token_ = at_;
  while (at_ != end_ && kind_of(*at_) != kLineEnd) ++at_;
  const char* stop = at_;
  while (stop != token_ && kind_of(stop[-1]) == kSeparator) --stop;
  return {token_, static_cast<std::size_t>(stop - token_)};
}

/// Reads a number that ends with its word; stays before anything else.
template <class T>
bool TextScanner::take(T& value) {
  token_ = at_;
  const auto [stop, error] = parse_prefix(at_, end_, value);
  if (error != std::errc{} || !at_word_end(stop)) return false;
  at_ = stop;
  return true;
}

double TextScanner::number(const char* what) {
  at_line_end();
  double value = 0;
  if (take(value) && std::isfinite(value)) return value;
  // from_chars refuses numbers too small for a double, which are zero.
  at_ = token_;
  const std::string_view text = word();
  if (text.empty()) fail(fmt::format("{} is missing", what));
  value = parse_number(text).value_or(std::nan(""));
  if (!std::isfinite(value)) {
    fail(fmt::format("{} is {}, not a finite number", what, quoted_excerpt(text)));
  }
  return value;
}

std::int64_t TextScanner::integer(const char* what) {
  at_line_end();
  token_ = at_;
  std::int64_t value = 0;
  const auto [stop, error] = parse_prefix(at_, end_, value);
  if (error != std::errc{}) {
    const std::string_view text = word();
    fail(text.empty() ? fmt::format("{} is missing", what)
                      : fmt::format("{} is {}, not an integer", what, quoted_excerpt(text)));
  }
  at_ = stop;
  return value;
}

void TextScanner::read(ScalarType type, std::byte* to, FunctionRef<std::string()> what) {
  if (!skip_to_content()) {
    token_ = at_;
    fail(fmt::format("the file ends within {}; it is truncated", what()));
  }
  visit_type(type, [&]<class T>(T) {
    T value{};
    if (!take(value)) {
      const std::string_view text = word();
      std::optional<T> parsed = parse<T>(text);
      if constexpr (std::is_integral_v<T>) {
        // Some writers print integers as 255.0 or 1e3.
        const auto number = parse<double>(text);
        if (number && representable<T>(*number)) parsed = static_cast<T>(*number);
      }
      if (!parsed) {
        fail(fmt::format("{} in {} is not a number of type {}", quoted_excerpt(text), what(),
                         scalar_name(type)));
      }
      value = *parsed;
    }
    std::memcpy(to, &value, sizeof(T));
  });
}

void TextScanner::expect_line_end(FunctionRef<std::string()> what) {
  if (at_line_end()) return;
  token_ = at_;
  fail(fmt::format("more values than {} has according to the header", what()));
}

bool TextScanner::skip(char c) {
  if (at_ == end_ || *at_ != c) return false;
  ++at_;
  return true;
}

void TextScanner::fail(const std::string& message) const {
  fail_at(static_cast<std::size_t>(token_ - first_), message);
}

void TextScanner::fail_at(std::size_t position, const std::string& message) const {
  std::size_t line = lines_before_ ? lines_before_() + 1 : 1;
  for (const char* c = first_; c != first_ + position; ++c)
    line += kind_of(*c) == kLineEnd && !is_pair(c);
  throw_input(name_, fmt::format("line {}: {}", line, message));
}

}  // namespace surfel
