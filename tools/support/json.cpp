#include "tools/support/json.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include <nlohmann/json.hpp>

namespace surfel::tool {

/// Conversions from and to the library's values.
struct Json::Library {
  template <class Tree>
  static Tree to(const Json& json) {
    switch (json.kind_) {
      case Kind::kNull:
        return nullptr;
      case Kind::kFlag:
        return json.bits_ != 0;
      case Kind::kWhole:
        return static_cast<std::int64_t>(json.bits_);
      case Kind::kNatural:
        return json.bits_;
      case Kind::kNumber:
        return json.number_;
      case Kind::kText:
        return json.text_;
      case Kind::kArray:
      case Kind::kObject:
        break;
    }
    Tree tree = json.kind_ == Kind::kArray ? Tree::array() : Tree::object();
    auto key = json.keys_.begin();
    for (const Json& item : json.items_) {
      if (json.kind_ == Kind::kArray) {
        tree.push_back(to<Tree>(item));
      } else {
        tree[*key++] = to<Tree>(item);
      }
    }
    return tree;
  }

  static Json from(const nlohmann::ordered_json& tree) {
    if (tree.is_boolean()) return tree.get<bool>();
    if (tree.is_number_unsigned()) return tree.get<std::uint64_t>();
    if (tree.is_number_integer()) return tree.get<std::int64_t>();
    if (tree.is_number()) return tree.get<double>();
    if (tree.is_string()) return tree.get<std::string>();
    Json json = tree.is_array() ? array() : tree.is_object() ? object() : Json();
    if (tree.is_array()) {
      for (const nlohmann::ordered_json& item : tree) json.push_back(from(item));
    } else if (tree.is_object()) {
      for (const auto& [key, value] : tree.items()) json[key] = from(value);
    }
    return json;
  }
};

Json::Json(const Json&) = default;
Json::Json(Json&&) noexcept = default;
Json& Json::operator=(const Json&) = default;
Json& Json::operator=(Json&&) noexcept = default;
Json::~Json() = default;

Json::Json(Kind kind, std::uint64_t bits) : kind_(kind), bits_(bits) {}
Json::Json(bool flag) : Json(Kind::kFlag, flag ? 1 : 0) {}
Json::Json(double number) : kind_(Kind::kNumber), number_(number) {}
Json::Json(const char* text) : kind_(Kind::kText), text_(text) {}
Json::Json(std::string text) : kind_(Kind::kText), text_(std::move(text)) {}

Json::Json(std::initializer_list<Json> items) {
  const bool pairs = std::all_of(items.begin(), items.end(), [](const Json& item) {
    return item.kind_ == Kind::kArray && item.items_.size() == 2 &&
           item.items_.front().kind_ == Kind::kText;
  });
  kind_ = pairs ? Kind::kObject : Kind::kArray;
  for (const Json& item : items) {
    if (pairs) {
      (*this)[item.items_.front().text_] = item.items_.back();
    } else {
      items_.push_back(item);
    }
  }
}

Json Json::array() { return Json(Kind::kArray, 0); }
Json Json::object() { return Json(Kind::kObject, 0); }

Json Json::parse(const std::string& text) {
  return Library::from(nlohmann::ordered_json::parse(text));
}

Json& Json::operator[](std::string_view key) {
  kind_ = Kind::kObject;
  const auto found = std::find(keys_.begin(), keys_.end(), key);
  if (found != keys_.end()) return *std::next(items_.begin(), found - keys_.begin());
  keys_.emplace_back(key);
  return items_.emplace_back();
}

void Json::push_back(Json item) {
  kind_ = Kind::kArray;
  items_.push_back(std::move(item));
}

double Json::number() const {
  if (kind_ == Kind::kWhole) return static_cast<double>(static_cast<std::int64_t>(bits_));
  return kind_ == Kind::kNatural ? static_cast<double>(bits_) : number_;
}

bool Json::operator==(const Json&) const = default;

std::string Json::dump(int indent, Members members) const {
  using Handler = nlohmann::json::error_handler_t;
  return members == Members::kSorted
             ? Library::to<nlohmann::json>(*this).dump(indent, ' ', false, Handler::replace)
             : Library::to<nlohmann::ordered_json>(*this).dump(indent, ' ', false,
                                                               Handler::replace);
}

}  // namespace surfel::tool
