#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/io/toml_reader.h>
#include <surfel/io/toml_settings.h>
#include <toml++/toml.h>

namespace surfel {
namespace {

/// Parts of a key, and values around a value. toml++ makes, and removes, tables in tables by
/// recursion, which ends with the stack.
constexpr int kMostLevels = 32;

/// Characters of the string or comment that `text` starts with; 0 where it starts with neither.
std::size_t skipped_length(std::string_view text) {
  const char quote = text.front();
  if (quote == '#') return std::min(text.find('\n'), text.size());
  if (quote != '"' && quote != '\'') return 0;
  const std::string_view three = quote == '"' ? "\"\"\"" : "'''";
  const std::string_view end = text.starts_with(three) ? three : three.substr(0, 1);
  for (std::size_t i = end.size(); i < text.size(); ++i) {
    if (text.substr(i).starts_with(end)) {
      // A string may end with one or two quotes of its own before the three that close it.
      i += end.size();
      for (int more = 0; end.size() == 3 && more < 2 && text.substr(i, 1) == end.substr(2); ++more)
        ++i;
      return i;
    }
    if (text[i] == '\n' && end.size() == 1) return i;
    if (text[i] == '\\' && quote == '"') ++i;
  }
  return text.size();
}

/// Throws Error(kInput) for tables and arrays that lie deeper in others than the parser may go.
void require_shallow(std::string_view text, const std::string& file) {
  int open = 0;
  int dots = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (const std::size_t length = skipped_length(text.substr(i))) {
      i += length - 1;
      continue;
    }
    const char c = text[i];
    if (c == '.') ++dots;
    if (c == '\n' || c == ',' || c == '=') dots = 0;
    if (c == '[' || c == '{') ++open;
    if ((c == ']' || c == '}') && open > 0) --open;
    if (dots >= kMostLevels || open > kMostLevels) {
      throw_input(file, fmt::format("line {}: keys of more than {} parts, and values in more than "
                                    "{} others, are not supported",
                                    1 + std::count(text.begin(), text.begin() + i, '\n'),
                                    kMostLevels, kMostLevels));
    }
  }
}

void require_short(std::size_t bytes, const std::string& file) {
  if (bytes <= kMostTomlBytes) return;
  throw_input(file, fmt::format("more than {} MB of TOML are not supported; is it the right file?",
                                kMostTomlBytes >> 20));
}

/// The one place where text meets the parser.
toml::table parse_toml(std::string_view text, const std::string& file) {
  require_short(text.size(), file);
  require_shallow(text, file);
  try {
    return toml::parse(text);
  } catch (const toml::parse_error& error) {
    throw_input(file, fmt::format("line {}: {}", error.source().begin.line, error.description()));
  }
}

/// A scalar as a command line would have it; nullopt for tables, dates and arrays.
std::optional<std::string> as_argument(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
  return std::nullopt;
}

/// The values of a scalar or of an array of scalars.
std::optional<std::vector<std::string>> as_arguments(const toml::node& node) {
  std::vector<std::string> values;
  const auto add = [&](const toml::node& element) {
    if (auto value = as_argument(element)) values.push_back(std::move(*value));
  };
  const toml::array* array = node.as_array();
  if (array) {
    for (const toml::node& element : *array) add(element);
  } else {
    add(node);
  }
  if (values.size() != (array ? array->size() : 1)) return std::nullopt;
  return values;
}

}  // namespace

struct TomlTable::Node {
  std::shared_ptr<const toml::table> file;  ///< Keeps the tree alive.
  const toml::table* table = nullptr;
  std::string path;
  mutable std::set<std::string> read;

  [[noreturn]] void fail(const toml::node& at, const std::string& message) const {
    throw_input(path, fmt::format("line {}: {}", at.source().begin.line, message));
  }
  const toml::node* find(const char* key) const {
    read.insert(key);
    return table->get(key);
  }
  std::vector<double> numbers(const char* key, const toml::node& node, std::size_t count) const {
    std::vector<double> values;
    if (const toml::array* array = node.as_array()) {
      for (const toml::node& item : *array) {
        if (const auto number = item.value<double>()) values.push_back(*number);
      }
      if (values.size() == count && array->size() == count) return values;
    }
    fail(node, fmt::format("{} must be an array of {} numbers", key, count));
  }
};

void TomlTable::read(const char* key, double& value) const {
  const toml::node* node = node_->find(key);
  if (!node) return;
  const auto number = node->value<double>();
  if (!number || !node->is_number()) node_->fail(*node, fmt::format("{} must be a number", key));
  value = *number;
}

void TomlTable::read(const char* key, std::optional<double>& value) const {
  if (!node_->find(key)) return;
  double number = 0;
  read(key, number);
  value = number;
}

void TomlTable::read(const char* key, bool& value) const {
  const toml::node* node = node_->find(key);
  if (!node) return;
  if (!node->is_boolean()) node_->fail(*node, fmt::format("{} must be true or false", key));
  value = node->as_boolean()->get();
}

void TomlTable::read(const char* key, std::string& value) const {
  const toml::node* node = node_->find(key);
  if (!node) return;
  if (!node->is_string()) node_->fail(*node, fmt::format("{} must be a string", key));
  value = node->as_string()->get();
}

void TomlTable::read(const char* key, Vec3d& value) const {
  const toml::node* node = node_->find(key);
  if (!node) return;
  const std::vector<double> v = node_->numbers(key, *node, 3);
  value = Vec3d(v[0], v[1], v[2]);
}

void TomlTable::read(const char* key, std::optional<Vec3d>& value) const {
  if (!node_->find(key)) return;
  Vec3d vector;
  read(key, vector);
  value = vector;
}

void TomlTable::read(const char* key, Vec3f& value) const {
  Vec3d vector = value.cast<double>();
  read(key, vector);
  value = vector.cast<float>();
}

void TomlTable::read(const char* key, float& value, double least, double most) const {
  double number = static_cast<double>(value);
  read(key, number);
  if (!(number >= least && number <= most)) {
    fail(key, fmt::format("{} is {}; it must be in {}..{}", key, number, least, most));
  }
  value = static_cast<float>(number);
}

void TomlTable::read(const char* key, Vec3f& value, double least, double most) const {
  Vec3d vector = value.cast<double>();
  read(key, vector);
  for (const double number : vector) {
    if (!(number >= least && number <= most)) {
      fail(key,
           fmt::format("{} holds {}; its numbers must be in {}..{}", key, number, least, most));
    }
  }
  value = vector.cast<float>();
}

bool TomlTable::has(const char* key) const { return node_->table->contains(key); }

void TomlTable::fail(const char* key, const std::string& message) const {
  const toml::node* node = node_->table->get(key);
  node_->fail(node ? *node : *node_->table, message);
}

void TomlTable::read(const char* key, int& first, int& second) const {
  const toml::node* node = node_->find(key);
  if (!node) return;
  const auto both = node->is_number() ? node->value<double>() : std::nullopt;
  const std::vector<double> v = both ? std::vector{*both, *both} : node_->numbers(key, *node, 2);
  for (const double number : v) {
    if (!(std::abs(number) < 1e9) || number != std::floor(number)) {
      node_->fail(*node, fmt::format("{} must be a whole number, or two", key));
    }
  }
  first = static_cast<int>(v[0]);
  second = static_cast<int>(v[1]);
}

void TomlTable::reject_unread() const {
  for (const auto& [key, node] : *node_->table) {
    if (!node_->read.contains(std::string(key.str()))) {
      node_->fail(node, fmt::format("unknown key {}; known are {}{}", key.str(),
                                    fmt::join(node_->read, ", "),
                                    did_you_mean(std::string(key.str()),
                                                 {node_->read.begin(), node_->read.end()})));
    }
  }
}

InputFile open_toml(const std::string& path) {
  if (path == "-") throw_io("standard input", "cannot be read as TOML; name a file");
  return InputFile(path);
}

TomlReader::TomlReader(const InputFile& file) {
  auto node = std::make_shared<TomlTable::Node>();
  node->path = file.name();
  require_short(file.size(), file.name());
  node->file = std::make_shared<const toml::table>(parse_toml(as_text(file.bytes()), file.name()));
  node->table = node->file.get();
  root_.node_ = std::move(node);
}

TomlTable TomlTable::child(const void* table) const {
  auto node = std::make_shared<Node>();
  node->file = node_->file;
  node->path = node_->path;
  node->table = static_cast<const toml::table*>(table);
  TomlTable child;
  child.node_ = node;
  return child;
}

std::optional<TomlTable> TomlReader::table(const char* name) const {
  const toml::node* node = root_.node_->find(name);
  if (!node) return std::nullopt;
  if (!node->is_table()) root_.fail(name, fmt::format("write [{}], one table", name));
  return root_.child(node->as_table());
}

std::vector<TomlTable> TomlReader::tables(const char* name) const {
  std::vector<TomlTable> found;
  const TomlTable::Node& root = *root_.node_;
  const toml::node* node = root.find(name);
  if (!node) return found;
  const toml::array* array = node->as_array();
  if (!array) root.fail(*node, fmt::format("write [[{}]], an array of tables", name));
  for (const toml::node& item : *array) {
    if (!item.is_table()) root.fail(item, fmt::format("{} must hold tables", name));
    found.push_back(root_.child(item.as_table()));
  }
  return found;
}

std::vector<TomlSetting> read_toml_settings(std::string_view text, const std::string& file) {
  std::vector<TomlSetting> settings;
  for (const auto& [key, node] : parse_toml(text, file)) {
    settings.push_back({std::string(key.str()), static_cast<std::size_t>(key.source().begin.line),
                        as_arguments(node)});
  }
  return settings;
}

}  // namespace surfel
