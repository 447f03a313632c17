#pragma once

#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

namespace surfel::test {

/// Text of a file of the project; empty if there is none.
inline std::string text_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// First groups of all matches, in the order of the text.
inline std::vector<std::string> matches(const std::string& text, const std::regex& pattern) {
  std::vector<std::string> found;
  for (auto it = std::sregex_iterator(text.begin(), text.end(), pattern);
       it != std::sregex_iterator(); ++it) {
    found.push_back((*it)[1]);
  }
  return found;
}

/// The library's folders in the order of lib/CMakeLists.txt, which follows the data.
inline std::vector<std::string> library_folders() {
  const std::string text = text_of(SURFEL_SOURCE_DIR "/lib/CMakeLists.txt");
  const std::size_t begin = text.find("set(SURFEL_FOLDERS ");
  if (begin == std::string::npos) return {};
  const std::size_t end = text.find(" CACHE", begin);
  return matches(text.substr(begin, end - begin), std::regex(R"([ \n](\w+))"));
}

}  // namespace surfel::test
