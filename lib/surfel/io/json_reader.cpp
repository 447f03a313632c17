#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/io/json_reader.h>
#include <surfel/io/json_view.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

using Json = nlohmann::json;

const Json& json(const void* value) { return *static_cast<const Json*>(value); }

}  // namespace

struct JsonValue::Tree {
  std::string file;
  Json root;
};

JsonValue::JsonValue(std::shared_ptr<const Tree> tree, const void* value, std::string place)
    : tree_(std::move(tree)), value_(value), place_(std::move(place)) {}

bool JsonValue::is_object() const { return json(value_).is_object(); }

bool JsonValue::is_array() const { return json(value_).is_array(); }

std::size_t JsonValue::size() const { return json(value_).size(); }

JsonValue JsonValue::at(std::size_t i) const {
  return {tree_, &json(value_)[i], fmt::format("{}[{}]", place_, i)};
}

std::optional<JsonValue> JsonValue::find(const char* key) const {
  if (!is_object()) expected("an object");
  asked_->insert(key);
  const auto found = json(value_).find(key);
  if (found == json(value_).end()) return std::nullopt;
  return JsonValue(tree_, &*found, place_.empty() ? key : place_ + "." + key);
}

double JsonValue::number() const {
  if (!json(value_).is_number()) expected("a number");
  return json(value_).get<double>();
}

std::optional<double> JsonValue::number(const char* key) const {
  const std::optional<JsonValue> found = find(key);
  if (!found) return std::nullopt;
  return found->number();
}

std::optional<std::string> JsonValue::text(const char* key) const {
  const std::optional<JsonValue> found = find(key);
  if (!found) return std::nullopt;
  if (!json(found->value_).is_string()) found->expected("a string");
  return json(found->value_).get<std::string>();
}

std::optional<bool> JsonValue::flag(const char* key) const {
  const std::optional<JsonValue> found = find(key);
  if (!found) return std::nullopt;
  if (!json(found->value_).is_boolean()) found->expected("true or false");
  return json(found->value_).get<bool>();
}

std::optional<int> JsonValue::count(const char* key, int most) const {
  const std::optional<JsonValue> found = find(key);
  if (!found) return std::nullopt;
  const double value = found->number();
  if (value < 1 || value > most || value != std::floor(value)) {
    found->fail(fmt::format("is {:g}; it must be a whole number in 1..{}", value, most));
  }
  return static_cast<int>(value);
}

std::vector<double> JsonValue::numbers(std::size_t count) const {
  const std::string what = fmt::format("an array of {} numbers", count);
  if (!is_array() || size() != count) expected(what.c_str());
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(at(i).number());
  return values;
}

Eigen::MatrixXd JsonValue::matrix(int rows, int columns) const {
  const std::string what = fmt::format("a matrix of {} rows and {} columns", rows, columns);
  if (!is_array() || size() != static_cast<std::size_t>(rows)) expected(what.c_str());
  Eigen::MatrixXd matrix(rows, columns);
  for (int row = 0; row < rows; ++row) {
    const std::vector<double> values =
        at(static_cast<std::size_t>(row)).numbers(static_cast<std::size_t>(columns));
    matrix.row(row) = Eigen::Map<const Eigen::RowVectorXd>(values.data(), columns);
  }
  return matrix;
}

void JsonValue::fail(const std::string& message) const {
  throw_input(tree_->file, place_.empty() ? message : place_ + " " + message);
}

void JsonValue::expected(const char* what) const {
  // Long arrays and objects are told by their kind, as their text would take time and memory.
  const std::string found = json(value_).is_structured()
                                ? fmt::format("is an {} of {}", json(value_).type_name(), size())
                                : "is " + quoted_excerpt(json(value_).dump(
                                              -1, ' ', true, Json::error_handler_t::replace));
  fail(fmt::format("{}, not {}", place_.empty() ? "the file " + found : found, what));
}

void JsonValue::reject_unread() const {
  for (const auto& item : json(value_).items()) {
    if (asked_->contains(item.key())) continue;
    const std::vector<std::string> known(asked_->begin(), asked_->end());
    fail(fmt::format("has the unknown key {}; known are {}{}", quoted_excerpt(item.key()),
                     fmt::join(known, ", "), did_you_mean(item.key(), known)));
  }
}

JsonValue read_json(const InputFile& file) {
  auto tree = std::make_shared<JsonValue::Tree>();
  tree->file = file.name();
  tree->root = parse_json(as_text(file.bytes()), file.name());
  const Json* root = &tree->root;
  return {std::move(tree), root, ""};
}

}  // namespace surfel
