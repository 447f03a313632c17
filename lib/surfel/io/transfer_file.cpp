#include <surfel/base/error.h>
#include <surfel/io/toml_reader.h>
#include <surfel/io/transfer_file.h>

namespace surfel {

TransferFunction read_transfer_function(const std::string& path) {
  const InputFile file = open_toml(path);
  const TomlReader toml(file);
  TransferFunction function;
  toml.root().read("relative", function.relative);
  for (const TomlTable& table : toml.tables("point")) {
    TransferFunction::Point& point = function.point.emplace_back();
    if (!table.has("value")) table.fail("value", "a point of a transfer function needs a value");
    table.read("value", point.value);
    table.read("color", point.color, 0, 1);
    table.read("density", point.density);
    table.reject_unread();
  }
  toml.root().reject_unread();
  const std::vector<std::string> problems = function.problems();
  if (!problems.empty()) throw_input(path, problems.front());
  return function;
}

}  // namespace surfel
