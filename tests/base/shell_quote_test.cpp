#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/shell_quote.h>

namespace surfel {
namespace {

/// What a shell hands to a program that it runs with these words, a line each.
std::string words_in_shell(const std::string& words) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(
      popen(("printf '%s\\n' " + words).c_str(), "r"), pclose);
  std::string text;
  for (int c = 0; (c = std::fgetc(pipe.get())) != EOF;) text += static_cast<char>(c);
  return text;
}

TEST(ShellCommand, IsReadBackByAShell) {
  const std::vector<std::string> words = {"plain", "two words",  "it's",    "$HOME",      "", "a;b",
                                          "*",     "--eye=-1,2", "quote\"", "back\\slash"};
  const std::string command = shell_command(words);
  EXPECT_TRUE(command.starts_with("plain 'two words'"));
  std::string expected;
  for (const std::string& word : words) expected += word + "\n";
  EXPECT_EQ(words_in_shell(command), expected);
}

TEST(ShellCommand, HasNoControlCharacters) {
  std::string word = "it's \\ ";
  for (int c = 1; c < 128; c += c == 31 ? 96 : 1) word += static_cast<char>(c);
  const std::string quoted = shell_quoted(word);
  EXPECT_TRUE(
      std::none_of(quoted.begin(), quoted.end(), [](char c) { return c < ' ' || c > '~'; }));
  const std::string in_bash = "\"$(bash -c " + shell_quoted("printf %s " + quoted) + ")\"";
  EXPECT_EQ(words_in_shell(in_bash), word + "\n");
}

TEST(ShellFile, IsOneWordThatIsNoOption) {
  for (const auto& [path, word] : std::vector<std::pair<std::string, std::string>>{
           {"scan.ply", "scan.ply"},
           {"my scan.ply", "my scan.ply"},
           {"it's \"one\" $(x).ply", "it's \"one\" $(x).ply"},
           {"-o.ply", "./-o.ply"},
           {"--my scan.ply", "./--my scan.ply"},
           {"~", "~"},
           {"-", "-"}}) {
    EXPECT_EQ(words_in_shell(shell_file(path)), word + "\n");
  }
}

}  // namespace
}  // namespace surfel
