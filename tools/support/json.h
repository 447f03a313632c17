#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <list>
#include <string>
#include <string_view>
#include <vector>

namespace surfel::tool {

/// A JSON value to write. Its one source knows the JSON library, whose header takes as long to
/// compile as a tool.
class Json {
 public:
  Json() = default;  ///< null.
  // Values of all types stand in braces and after = as they are.
  // NOLINTBEGIN(google-explicit-constructor)
  Json(std::nullptr_t) {}
  Json(bool flag);
  Json(double number);
  Json(const char* text);
  Json(std::string text);
  template <std::signed_integral Number>
  Json(Number number) : Json(Kind::kWhole, static_cast<std::uint64_t>(number)) {}
  template <std::unsigned_integral Number>
  Json(Number number) : Json(Kind::kNatural, number) {}
  /// An object, if all are pairs that begin with a text; else an array.
  Json(std::initializer_list<Json> items);
  template <class T>
  Json(const std::vector<T>& items) : kind_(Kind::kArray) {
    for (const T& item : items) push_back(item);
  }
  template <class T, std::size_t n>
  Json(const std::array<T, n>& items) : kind_(Kind::kArray) {
    for (const T& item : items) push_back(item);
  }
  // NOLINTEND(google-explicit-constructor)
  Json(const Json&);
  Json(Json&&) noexcept;
  Json& operator=(const Json&);
  Json& operator=(Json&&) noexcept;
  ~Json();

  static Json array();
  static Json object();
  /// Throws std::exception where the text is no JSON.
  static Json parse(const std::string& text);

  /// A member of an object, made where there is none; null becomes an object.
  Json& operator[](std::string_view key);
  /// Null becomes an array.
  void push_back(Json item);

  bool is_null() const { return kind_ == Kind::kNull; }
  bool is_number() const { return kind_ >= Kind::kWhole && kind_ <= Kind::kNumber; }
  bool is_fraction() const { return kind_ == Kind::kNumber; }
  bool is_text() const { return kind_ == Kind::kText; }
  double number() const;
  const std::string& text() const { return text_; }
  /// The names of an object's members, in the order in which they were added, and its values or an
  /// array's.
  const std::vector<std::string>& keys() const { return keys_; }
  const std::list<Json>& items() const { return items_; }
  bool operator==(const Json& other) const;

  enum class Members { kSorted, kAsAdded };
  /// The value as text. Bytes that are no UTF-8, which file names may have, are replaced, so that
  /// it is JSON in any case. \param indent  -1: on one line.
  std::string dump(int indent = -1, Members members = Members::kSorted) const;

 private:
  enum class Kind : std::uint8_t {
    kNull,
    kFlag,
    kWhole,
    kNatural,
    kNumber,
    kText,
    kArray,
    kObject
  };
  struct Library;
  Json(Kind kind, std::uint64_t bits);

  Kind kind_ = Kind::kNull;
  std::uint64_t bits_ = 0;  ///< Of a truth value or a whole number.
  double number_ = 0;
  std::string text_;
  std::vector<std::string> keys_;
  std::list<Json> items_;  ///< References to members stay valid where others are added.
};

}  // namespace surfel::tool
