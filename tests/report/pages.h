#pragma once

#include <string>

#include <gtest/gtest.h>

namespace surfel::test {

/// A name that would change a page if it were not escaped.
inline const std::string kHostile = "<script>alert('1')</script>\"&\xff.ply";

inline std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; ++at) ++n;
  return n;
}

/// The hostile name stands in a text, escaped alone.
inline void expect_escaped(const std::string& html) {
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  EXPECT_NE(html.find("&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&quot;&amp;\xef\xbf\xbd.ply"),
            std::string::npos);
}

/// A page that needs nothing else, with the hostile name in it.
inline void expect_page(const std::string& html) {
  EXPECT_EQ(html.rfind("<!DOCTYPE html>", 0), 0U);
  EXPECT_EQ(count(html, "</html>"), 1U);
  EXPECT_EQ(html.find("http"), std::string::npos);  // It opens offline.
  EXPECT_EQ(html.find("src=\"/"), std::string::npos);
  EXPECT_NE(html.find("width=device-width"), std::string::npos);
  expect_escaped(html);
}

}  // namespace surfel::test
