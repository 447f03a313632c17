#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <nlohmann/json_fwd.hpp>
#include <surfel/base/types.h>

namespace surfel {

/// A value of a JSON document with its place, so that a value of the wrong kind gives a message
/// that tells where it stands. What is missing reads as missing: each getter takes what it returns
/// then. Keeps pointers into the document. Internal to the io module.
class JsonView {
 public:
  /// \param file  for messages; both must outlive the view.
  JsonView(const nlohmann::json& document, const std::string& file)
      : JsonView(&document, &file, "") {}

  /// Is there a value?
  explicit operator bool() const { return value_ != nullptr; }
  /// Where the value stands, such as "accessors[3].sparse".
  const std::string& place() const { return place_; }

  /// A member of an object; missing where this is missing, or has no such member. Refuses values
  /// other than objects.
  JsonView operator[](std::string_view member) const;
  /// Elements of an array; 0 where it is missing. Refuses other values.
  std::size_t size() const;
  /// An element, of size().
  JsonView at(std::size_t element) const;

  /// A whole number >= 0 that a double holds exactly. Missing: `missing`, or refused where that is
  /// unset.
  std::uint64_t count(std::optional<std::uint64_t> missing = {}) const;
  double number(double missing) const;
  bool flag(bool missing) const;
  std::string text(std::string_view missing) const;
  /// As many finite numbers as `values` has elements, which stay as they are where this is missing.
  template <class Vector>
  void numbers(Vector& values) const {
    read_numbers(values.data(), static_cast<std::size_t>(values.size()));
  }

  /// Throws Error(kInput) that starts with the file and the value's place.
  [[noreturn]] void fail(const std::string& message) const;

 private:
  JsonView(const nlohmann::json* value, const std::string* file, std::string place)
      : value_(value), file_(file), place_(std::move(place)) {}
  void read_numbers(double* values, std::size_t count) const;
  [[noreturn]] void fail_kind(const char* expected) const;

  const nlohmann::json* value_;  ///< Null where it is missing.
  const std::string* file_;
  std::string place_;
};

/// Parses UTF-8 text. Throws Error(kInput) naming file and line for text that is no JSON, and for
/// values in more than 64 others.
nlohmann::json parse_json(std::string_view text, const std::string& file);

}  // namespace surfel
