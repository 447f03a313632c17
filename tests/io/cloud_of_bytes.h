#pragma once

#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>

#include "support/memory_file.h"

namespace surfel::test {

/// The cloud in a file of these bytes.
inline SurfelCloud cloud_of(const std::string& bytes) {
  return read_cloud(MemoryFile(bytes).path());
}

/// The message of the error that reading gives, without the file's name in front.
inline std::string error_of(const std::string& bytes) {
  const MemoryFile file(bytes);
  try {
    read_cloud(file.path());
  } catch (const Error& e) {
    const std::string message = e.what();
    EXPECT_TRUE(message.starts_with(file.path() + ": ")) << message;
    return message.substr(file.path().size() + 2);
  }
  return "no error";
}

/// A column's values as numbers.
inline std::vector<double> values_of(const SurfelCloud& cloud, const std::string& name) {
  for (const ExtraProperty& property : cloud.extra) {
    if (property.name != name) continue;
    std::vector<double> values(cloud.size());
    load_scalars(property.type, property.data.data(), values.size(), values.data());
    return values;
  }
  ADD_FAILURE() << "no column " << name;
  return std::vector<double>(cloud.size());
}

/// Expects the positions, colours and columns of both to be equal.
inline void expect_same(const SurfelCloud& a, const SurfelCloud& b, const std::string& what) {
  ASSERT_EQ(a.size(), b.size()) << what;
  for (std::size_t i = 0; i < a.size(); ++i) ASSERT_EQ(a.world(i), b.world(i)) << what;
  EXPECT_EQ(a.color, b.color) << what;
  EXPECT_EQ(a.color_encoding, b.color_encoding) << what;
  ASSERT_EQ(a.extra.size(), b.extra.size()) << what;
  for (std::size_t k = 0; k < a.extra.size(); ++k) {
    EXPECT_EQ(a.extra[k].name, b.extra[k].name) << what;
    EXPECT_TRUE(a.extra[k].data == b.extra[k].data) << what << ", " << a.extra[k].name;
  }
}

}  // namespace surfel::test
