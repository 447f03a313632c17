#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <surfel/io/input_file.h>

namespace surfel {

/// A value of a JSON file, which knows its place in it. All that throws, throws Error(kInput)
/// naming the file and the place: "cameras.json: frames[3].w is \"a\", not a number". Internal to
/// the io module.
class JsonValue {
 public:
  bool is_object() const;
  bool is_array() const;
  /// Number of an array's elements, or of an object's members.
  std::size_t size() const;
  /// Element of an array.
  JsonValue at(std::size_t i) const;
  /// Member of an object; throws where the value is no object.
  std::optional<JsonValue> find(const char* key) const;

  /// The value as a finite number.
  double number() const;
  /// Members that may be missing; throw where they are of another type.
  std::optional<double> number(const char* key) const;
  std::optional<std::string> text(const char* key) const;
  std::optional<bool> flag(const char* key) const;
  /// A whole number, in 1..most.
  std::optional<int> count(const char* key, int most) const;
  /// An array of that many numbers.
  std::vector<double> numbers(std::size_t count) const;
  /// An array of `rows` arrays of `columns` numbers.
  Eigen::MatrixXd matrix(int rows, int columns) const;

  [[noreturn]] void fail(const std::string& message) const;
  /// Throws for the first member of an object that was not asked for.
  void reject_unread() const;

 private:
  friend JsonValue read_json(const InputFile& file);
  struct Tree;
  JsonValue(std::shared_ptr<const Tree> tree, const void* value, std::string place);
  [[noreturn]] void expected(const char* what) const;

  std::shared_ptr<const Tree> tree_;
  const void* value_;  ///< In the tree; the library's type stays in the source.
  std::string place_;  ///< Empty for the whole file.
  std::shared_ptr<std::set<std::string>> asked_ = std::make_shared<std::set<std::string>>();
};

/// Parses a file. Throws Error (kIo, kInput) naming file and line.
JsonValue read_json(const InputFile& file);

}  // namespace surfel
