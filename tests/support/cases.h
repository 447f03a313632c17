#pragma once

#include <cstdlib>

namespace surfel::test {

/// Number of random cases of a property test: `usual`, or ten times as many where the environment
/// variable SURFEL_TEST_THOROUGH is set.
inline int cases(int usual) {
  const char* thorough = std::getenv("SURFEL_TEST_THOROUGH");
  return thorough && *thorough ? 10 * usual : usual;
}

}  // namespace surfel::test
