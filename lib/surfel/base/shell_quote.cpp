#include <algorithm>

#include <fmt/format.h>
#include <surfel/base/shell_quote.h>

namespace surfel {

std::string shell_quoted(const std::string& word) {
  static const std::string kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./=,:+@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 0x7f; };
  if (std::any_of(word.begin(), word.end(), is_control)) {
    std::string quoted = "$'";
    for (const char c : word) {
      if (c == '\'' || c == '\\') quoted += '\\';
      quoted += is_control(c) ? fmt::format("\\{:03o}", c) : std::string(1, c);
    }
    return quoted + "'";
  }
  std::string quoted = "'";
  for (const char c : word) {
    if (c == '\'') quoted += "'\\'";
    quoted += c;
  }
  quoted += '\'';
  return quoted;
}

std::string shell_file(const std::string& path) {
  const bool like_option = path.size() > 1 && path.front() == '-';
  return shell_quoted(like_option ? std::string("./").append(path) : path);
}

std::string shell_command(const std::vector<std::string>& words) {
  std::string line;
  for (const std::string& word : words) {
    if (!line.empty()) line += ' ';
    line += shell_quoted(word);
  }
  return line;
}

}  // namespace surfel
