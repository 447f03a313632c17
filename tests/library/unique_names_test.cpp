// A name of the library has one meaning: what two headers define, no program can include together,
// and what two sources define is undefined behaviour.

#include <cctype>
#include <cstddef>
#include <filesystem>
#include <map>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/project_text.h"

namespace surfel::test {
namespace {

/// The end of a literal that begins at `begin` with its first quote.
std::size_t end_of_literal(const std::string& text, std::size_t begin) {
  const bool raw = text[begin] == '"' && begin > 0 && text[begin - 1] == 'R';
  if (raw) {
    const std::size_t open = text.find('(', begin);
    const std::string close = ")" + text.substr(begin + 1, open - begin - 1) + "\"";
    return text.find(close, open) + close.size();
  }
  std::size_t end = begin + 1;
  while (end < text.size() && text[end] != text[begin]) end += text[end] == '\\' ? 2 : 1;
  return end + 1;
}

/// A text without comments, literals and directives of the preprocessor.
std::string code_of(const std::string& text) {
  std::string code;
  bool line_begins = true;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    const bool separates_digits = c == '\'' && i > 0 && std::isalnum(text[i - 1]) != 0;
    if (text.compare(i, 2, "//") == 0) {
      i = text.find('\n', i);
    } else if (text.compare(i, 2, "/*") == 0) {
      i = text.find("*/", i) + 2;
    } else if (c == '#' && line_begins) {
      do {
        i = text.find('\n', i + 1);
      } while (i != std::string::npos && text[i - 1] == '\\');
    } else if ((c == '"' || c == '\'') && !separates_digits) {
      i = end_of_literal(text, i);
      code += "0";
    } else {
      line_begins = c == '\n' || (line_begins && c == ' ');
      code += c;
      ++i;
    }
  }
  return code;
}

/// A statement without what begins a template.
std::string without_template(const std::string& statement) {
  if (statement.rfind("template", 0) != 0) return statement;
  std::size_t i = statement.find('<');
  int depth = 0;
  do {
    depth += statement[i] == '<' ? 1 : statement[i] == '>' ? -1 : 0;
    ++i;
  } while (depth > 0 && i < statement.size());
  return statement.substr(statement.find_first_not_of(" \n", i));
}

/// The name of the class, struct, union or enum whose body follows; empty if none does.
std::string type_of(const std::string& head) {
  static const std::regex type(
      R"(^(?:class|struct|union|enum(?: class| struct)?)\s+(?:(?:[A-Z]+_API|alignas\([^)]*\)|\[\[[^\]]*\]\])\s+)*(\w+)\s*(?:final\s*)?(?::[^:][^]*)?$)");
  std::smatch found;
  const std::string plain = without_template(head);
  return std::regex_match(plain, found, type) ? found[1].str() : "";
}

/// The name of an alias; empty if the statement makes none.
std::string alias_of(const std::string& statement) {
  static const std::regex alias(R"(^(?:using\s+(\w+)\s*=|typedef\b[^]*\b(\w+)$))");
  std::smatch found;
  const std::string plain = without_template(statement);
  if (!std::regex_search(plain, found, alias)) return "";
  return found[1].matched ? found[1].str() : found[2].str();
}

/// The types and aliases that a source or a header defines at namespace scope, with their
/// namespaces. Those in anonymous namespaces are left out.
std::vector<std::string> defined_types(const std::string& text) {
  static const std::regex space(R"(^(?:inline )?namespace(?:\s+([\w:]+))?$)");
  std::vector<std::string> scopes{""};  // The namespace of every open brace; empty within others.
  std::vector<std::string> defined;
  std::string statement;
  int parentheses = 0;
  const auto add = [&](const std::string& name) {
    if (!name.empty() && !(scopes.size() > 1 && scopes.back().empty())) {
      defined.push_back(scopes.back() + name);
    }
  };
  for (const char c : code_of(text)) {
    parentheses += c == '(' ? 1 : c == ')' ? -1 : 0;
    const bool ends = parentheses == 0 && (c == '{' || c == '}' || c == ';');
    if (!ends) {
      if (!statement.empty() || std::isspace(c) == 0) statement += c;
      continue;
    }
    while (!statement.empty() && std::isspace(statement.back()) != 0) statement.pop_back();
    std::smatch opened;
    if (c == '{' && std::regex_match(statement, opened, space) && opened[1].matched &&
        (scopes.size() == 1 || !scopes.back().empty())) {
      scopes.push_back(scopes.back() + opened[1].str() + "::");
    } else if (c == '{') {
      add(type_of(statement));
      scopes.emplace_back();
    } else if (c == ';') {
      add(alias_of(statement));
    } else if (scopes.size() > 1) {
      scopes.pop_back();
    }
    statement.clear();
  }
  return defined;
}

using Names = std::vector<std::string>;

TEST(UniqueNames, TypesOfNamespacesAreFound) {
  EXPECT_EQ(
      defined_types("namespace a {\nstruct B { int c; };\nclass A_API D final : public B {\n};\n}"),
      (Names{"a::B", "a::D"}));
  EXPECT_EQ(defined_types("namespace a::b { enum class C : int { kD }; enum E { kF }; }"),
            (Names{"a::b::C", "a::b::E"}));
  EXPECT_EQ(defined_types("namespace a { using B = int; typedef int C; using std::min; }"),
            (Names{"a::B", "a::C"}));
  EXPECT_EQ(defined_types("template <class A, class B = C<A>>\nstruct D {\n};\nstruct E {};"),
            (Names{"D", "E"}));
  EXPECT_EQ(defined_types("struct alignas(64) A {};"), Names{"A"});
}

TEST(UniqueNames, DeclarationsAreNotDefinitions) {
  EXPECT_EQ(defined_types("namespace a { class B; struct C; enum class D : int; }"), Names{});
  EXPECT_EQ(defined_types("template <> struct A<int> {};"), Names{});
  EXPECT_EQ(defined_types("struct A f(int b) { return {}; }"), Names{});
  EXPECT_EQ(defined_types("void f() { struct A { int b; }; using C = int; }"), Names{});
  EXPECT_EQ(defined_types("struct A::B { int c; };"), Names{});
}

TEST(UniqueNames, MembersAndAnonymousNamespacesAreLeftOut) {
  EXPECT_EQ(defined_types("struct A { struct B { int c; }; using D = int; };"), Names{"A"});
  EXPECT_EQ(
      defined_types(
          "namespace a { namespace { struct B {}; namespace c { struct D {}; } } struct E {}; }"),
      Names{"a::E"});
}

TEST(UniqueNames, CommentsAndLiteralsAreNoCode) {
  EXPECT_EQ(defined_types("// struct A {};\n/* struct B {}; */ struct C {};"), Names{"C"});
  EXPECT_EQ(defined_types("const char* a = \"{ \\\" struct B {\"; struct C {};"), Names{"C"});
  EXPECT_EQ(defined_types("auto a = R\"x(struct B { )\" )x\"; struct C {};"), Names{"C"});
  EXPECT_EQ(defined_types("int a = 1'000; char b = '{'; struct C {};"), Names{"C"});
  EXPECT_EQ(defined_types("#define A struct B { \\\n struct D {\nstruct C {};"), Names{"C"});
}

TEST(UniqueNames, TheLibraryDefinesNoTypeTwice) {
  std::map<std::string, std::string> known;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(SURFEL_SOURCE_DIR "/lib/surfel")) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".h" && extension != ".cpp") continue;
    for (const std::string& name : defined_types(text_of(entry.path()))) {
      const auto [place, is_new] = known.emplace(name, entry.path().string());
      EXPECT_TRUE(is_new) << name << " is defined in " << place->second << " and in "
                          << entry.path();
    }
  }
  EXPECT_GT(known.size(), 500U);
}

}  // namespace
}  // namespace surfel::test
