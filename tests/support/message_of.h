#pragma once

#include <string>

#include <surfel/base/error.h>

namespace surfel::test {

/// The message of the Error that the call throws, or nothing.
template <class Call>
std::string message_of(Call&& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace surfel::test
