#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include <fmt/format.h>
#include <locale.h>
#include <surfel/base/error.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_numbers.h>

namespace surfel {
namespace {

bool is_line_end(char c) { return c == '\n' || c == '\r'; }
bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f'; }

/// "1.#IND", "1.#QNAN", "1.#INF" without their sign.
std::optional<double> parse_windows_special(std::string_view text) {
  if (!text.starts_with("1.#")) return std::nullopt;
  if (text.starts_with("1.#INF")) return std::numeric_limits<double>::infinity();
  if (text.starts_with("1.#IND") || text.starts_with("1.#QNAN") || text.starts_with("1.#SNAN")) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return std::nullopt;
}

/// A number that from_chars refuses as too large or too small for T is infinite or zero.
template <class T>
std::optional<T> parse(std::string_view text) {
  const bool negative = text.starts_with('-');
  if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
  T value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error == std::errc{} && stop == end) return value;
  if constexpr (std::is_floating_point_v<T>) {
    if (error == std::errc::result_out_of_range && stop == end) {
      static const locale_t plain = newlocale(LC_ALL_MASK, "C", nullptr);
      return static_cast<T>(strtod_l(std::string(text).c_str(), nullptr, plain));
    }
    if (negative) text.remove_prefix(1);
    if (const auto special = parse_windows_special(text)) {
      return static_cast<T>(negative ? -*special : *special);
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> parse_number(std::string_view text) { return parse<double>(text); }

std::string quoted_excerpt(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  std::string excerpt(text.substr(0, kLongest));
  std::replace_if(
      excerpt.begin(), excerpt.end(), [](unsigned char c) { return c < ' ' || c > '~'; }, '?');
  return "'" + excerpt + (text.size() > kLongest ? "...'" : "'");
}

TextNumbers::TextNumbers(std::string file, std::span<const std::byte> bytes, std::size_t begin)
    : file_(std::move(file)),
      first_(reinterpret_cast<const char*>(bytes.data())),
      at_(first_ + begin),
      end_(first_ + bytes.size()),
      token_(at_) {}

std::optional<std::string_view> TextNumbers::next() {
  while (at_ != end_ && (is_blank(*at_) || is_line_end(*at_))) ++at_;
  token_ = at_;
  if (at_ == end_) return std::nullopt;
  while (at_ != end_ && !is_blank(*at_) && !is_line_end(*at_)) ++at_;
  return std::string_view(token_, static_cast<std::size_t>(at_ - token_));
}

void TextNumbers::read(ScalarType type, std::byte* to, FunctionRef<std::string()> what) {
  const auto token = next();
  if (!token) fail(fmt::format("the file ends within {}; it is truncated", what()));
  visit_type(type, [&]<class T>(T) {
    std::optional<T> value = parse<T>(*token);
    if constexpr (std::is_integral_v<T>) {
      // Some writers print integers as 255.0 or 1e3.
      const auto number = value ? std::nullopt : parse<double>(*token);
      if (number && representable<T>(*number)) value = static_cast<T>(*number);
    }
    if (!value) {
      fail(fmt::format("{} in {} is not a number of type {}", quoted_excerpt(*token), what(),
                       scalar_name(type)));
    }
    std::memcpy(to, &*value, sizeof(T));
  });
}

void TextNumbers::expect_line_end(FunctionRef<std::string()> what) {
  while (at_ != end_ && is_blank(*at_)) ++at_;
  if (at_ == end_ || is_line_end(*at_)) return;
  token_ = at_;
  fail(fmt::format("more values than {} has according to the header", what()));
}

void TextNumbers::fail(const std::string& message) const {
  // Lines end in LF, in CR LF or in CR alone.
  std::size_t line = 1;
  for (const char* c = first_; c != token_; ++c) {
    line += *c == '\n' || (*c == '\r' && c + 1 != end_ && c[1] != '\n');
  }
  throw_input(file_, fmt::format("line {}: {}", line, message));
}

}  // namespace surfel
