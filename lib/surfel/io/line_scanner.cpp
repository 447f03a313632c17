#include <charconv>
#include <cmath>

#include <fmt/format.h>
#include <surfel/io/line_scanner.h>
#include <surfel/io/text_numbers.h>

namespace surfel {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f'; }
bool is_line_end(char c) { return c == '\n' || c == '\r'; }

}  // namespace

LineScanner::LineScanner(const InputFile& file)
    : file_(file),
      first_(reinterpret_cast<const char*>(file.bytes().data())),
      at_(first_),
      end_(first_ + file.bytes().size()),
      token_(at_) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (std::string_view(first_, remaining()).starts_with(kByteOrderMark)) {
    at_ += kByteOrderMark.size();
  }
}

bool LineScanner::at_line_end() {
  while (at_ != end_) {
    if (is_blank(*at_)) {
      ++at_;
    } else if (*at_ == '\\' && at_ + 1 != end_ && is_line_end(at_[1])) {
      at_ += at_[1] == '\r' && at_ + 2 != end_ && at_[2] == '\n' ? 3 : 2;
    } else {
      break;
    }
  }
  return at_ == end_ || is_line_end(*at_) || *at_ == '#';
}

void LineScanner::next_line() {
  while (at_ != end_ && !is_line_end(*at_)) ++at_;
  if (at_ == end_) return;
  at_ += *at_ == '\r' && at_ + 1 != end_ && at_[1] == '\n' ? 2 : 1;
}

bool LineScanner::skip_to_content() {
  while (at_line_end()) {
    if (at_ == end_) return false;
    next_line();
  }
  return true;
}

bool LineScanner::at_word_end(const char* c) const {
  // note: # within a word starts no comment; "1.#IND" is how old Windows libraries print NaN.
  return c == end_ || is_blank(*c) || is_line_end(*c) ||
         (*c == '\\' && c + 1 != end_ && is_line_end(c[1]));
}

std::string_view LineScanner::word_at(const char* c) const {
  const char* stop = c;
  while (!at_word_end(stop)) ++stop;
  return {c, static_cast<std::size_t>(stop - c)};
}

std::string_view LineScanner::word() {
  at_line_end();
  token_ = at_;
  const std::string_view found = word_at(at_);
  at_ += found.size();
  return found;
}

std::string_view LineScanner::peek_word() {
  at_line_end();
  return word_at(at_);
}

std::string_view LineScanner::rest_of_line() {
  at_line_end();
  token_ = at_;
  while (at_ != end_ && !is_line_end(*at_)) ++at_;
  const char* stop = at_;
  while (stop != token_ && is_blank(stop[-1])) --stop;
  return {token_, static_cast<std::size_t>(stop - token_)};
}

double LineScanner::number(const char* what) {
  at_line_end();
  token_ = at_;
  double value = 0;
  const char* start = at_ + (at_ != end_ && *at_ == '+');
  const auto [stop, error] = std::from_chars(start, end_, value);
  if (error == std::errc{} && at_word_end(stop) && std::isfinite(value)) {
    at_ = stop;
    return value;
  }
  // What from_chars refuses may still be fine: a number too small for a double is zero.
  const std::string_view text = word_at(at_);
  if (text.empty()) fail(fmt::format("{} is missing", what));
  value = parse_number(text).value_or(std::nan(""));
  if (!std::isfinite(value)) {
    fail(fmt::format("{} is {}, not a finite number", what, quoted_excerpt(text)));
  }
  at_ += text.size();
  return value;
}

std::int64_t LineScanner::integer(const char* what) {
  at_line_end();
  token_ = at_;
  std::int64_t value = 0;
  const char* start = at_ + (at_ != end_ && *at_ == '+');
  const auto [stop, error] = std::from_chars(start, end_, value);
  if (error != std::errc{}) {
    const std::string_view text = word_at(at_);
    fail(text.empty() ? fmt::format("{} is missing", what)
                      : fmt::format("{} is {}, not an integer", what, quoted_excerpt(text)));
  }
  at_ = stop;
  return value;
}

bool LineScanner::skip(char c) {
  if (at_ == end_ || *at_ != c) return false;
  ++at_;
  return true;
}

void LineScanner::fail(const std::string& message) const { fail_at(token_, message); }

void LineScanner::fail_at(const char* place, const std::string& message) const {
  TextNumbers(file_.name(), file_.bytes(), static_cast<std::size_t>(place - first_)).fail(message);
}

}  // namespace surfel
