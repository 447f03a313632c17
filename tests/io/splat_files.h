#pragma once

#include <array>
#include <cstring>
#include <string>

#include <gtest/gtest.h>
#include <surfel/io/gaussian_io.h>

#include "support/message_of.h"

namespace surfel::test {

/// A file of these bytes, by the name of which formats without a signature are told.
inline InputFile splat_file(const std::string& bytes, const std::string& name) {
  return {name, std::as_bytes(std::span(bytes.data(), bytes.size()))};
}

inline GaussianCloud gaussians_of(const std::string& bytes, const std::string& name) {
  return read_gaussians(splat_file(bytes, name));
}

/// The message of the error that reading gives, which names the file; empty if there is none.
inline std::string gaussian_error(const std::string& bytes, const std::string& name) {
  const std::string message = message_of([&] { gaussians_of(bytes, name); });
  EXPECT_TRUE(message.empty() || message.starts_with(name + ": ")) << message;
  return message;
}

template <class T>
void append(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

/// A gzip stream, a zlib stream, and a Zstandard frame.
std::string gzipped(const std::string& bytes);
std::string zlib_packed(const std::string& bytes);
std::string zstandard(const std::string& bytes);

}  // namespace surfel::test
