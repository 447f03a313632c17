#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/json_view.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr int kMostDepth = 64;

/// Doubles hold all whole numbers up to this one.
constexpr double kMostExact = 0x1p53;

/// Are there values in more than kMostDepth others? The parser could tell, but would look through
/// all values of an array after each.
bool is_deep(std::string_view text) {
  int depth = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size() && depth <= kMostDepth; ++i) {
    const char c = text[i];
    if (c == '"') quoted = !quoted;
    if (c == '\\' && quoted) ++i;
    if (quoted) continue;
    if (c == '[' || c == '{') ++depth;
    if (c == ']' || c == '}') --depth;
  }
  return depth > kMostDepth;
}

}  // namespace

void JsonView::fail(const std::string& message) const {
  throw_input(*file_, place_.empty() ? message : place_ + " " + message);
}

void JsonView::fail_kind(const char* expected) const {
  if (!value_) fail(fmt::format("is missing; it must be {}", expected));
  fail(fmt::format("is {}, and must be {}; export the file again",
                   value_->is_number() ? value_->dump() : std::string("a ") + value_->type_name(),
                   expected));
}

JsonView JsonView::operator[](std::string_view member) const {
  std::string place = place_.empty() ? std::string(member) : fmt::format("{}.{}", place_, member);
  if (!value_) return {nullptr, file_, std::move(place)};
  if (!value_->is_object()) fail_kind("an object");
  const auto found = value_->find(member);
  return {found == value_->end() ? nullptr : &*found, file_, std::move(place)};
}

std::size_t JsonView::size() const {
  if (!value_) return 0;
  if (!value_->is_array()) fail_kind("an array");
  return value_->size();
}

JsonView JsonView::at(std::size_t element) const {
  return {&(*value_)[element], file_, fmt::format("{}[{}]", place_, element)};
}

std::uint64_t JsonView::count(std::optional<std::uint64_t> missing) const {
  if (!value_ && missing) return *missing;
  // Some programs write whole numbers with a fraction of zero.
  const double number = value_ && value_->is_number() ? value_->get<double>() : -1;
  if (!(number >= 0 && number <= kMostExact) || number != std::floor(number)) {
    fail_kind("a whole number >= 0");
  }
  return static_cast<std::uint64_t>(number);
}

double JsonView::number(double missing) const {
  if (value_) read_numbers(&missing, 1);
  return missing;
}

bool JsonView::flag(bool missing) const {
  if (!value_) return missing;
  if (!value_->is_boolean()) fail_kind("true or false");
  return value_->get<bool>();
}

std::string JsonView::text(std::string_view missing) const {
  if (!value_) return std::string(missing);
  if (!value_->is_string()) fail_kind("a text");
  return value_->get<std::string>();
}

void JsonView::read_numbers(double* values, std::size_t count) const {
  if (!value_) return;
  const auto read = [&](const nlohmann::json& from, double& to) {
    to = from.is_number() ? from.get<double>() : std::nan("");
    if (!std::isfinite(to)) fail_kind(count == 1 ? "a finite number" : "finite numbers alone");
  };
  if (count == 1 && value_->is_number()) {
    read(*value_, *values);
    return;
  }
  if (!value_->is_array() || value_->size() != count) {
    fail_kind(fmt::format("an array of {} numbers", count).c_str());
  }
  for (std::size_t i = 0; i < count; ++i) read((*value_)[i], values[i]);
}

nlohmann::json parse_json(std::string_view text, const std::string& file) {
  if (is_deep(text)) {
    throw_input(file, fmt::format("values in more than {} others are not supported", kMostDepth));
  }
  try {
    return nlohmann::json::parse(text.begin(), text.end());
  } catch (const nlohmann::json::parse_error& error) {
    const std::string_view before = text.substr(0, std::min(error.byte, text.size()));
    throw_input(file,
                fmt::format("line {}: is not valid JSON at {}",
                            1 + std::count(before.begin(), before.end(), '\n'),
                            before.size() == text.size()
                                ? "the file's end; it is truncated"
                                : quoted_excerpt(before.substr(
                                      before.size() - std::min<std::size_t>(before.size(), 20)))));
  } catch (const nlohmann::json::exception&) {
    throw_input(file, "holds a number that is beyond all bounds");
  }
}

}  // namespace surfel
