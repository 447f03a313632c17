#pragma once

#include <fstream>
#include <sstream>
#include <string>

namespace surfel {

/// Bytes of a file, which the kernel may make as it is read; empty if it cannot be read.
inline std::string whole_file(const std::string& path) {
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return bytes.str();
}

}  // namespace surfel
