#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include <surfel/base/error.h>
#include <unistd.h>

namespace surfel::fuzz {

/// A file in memory that takes the bytes of one run after another, since readers tell formats by
/// the names of files.
class FuzzFile {
 public:
  explicit FuzzFile(const std::string& name)
      : folder_("/dev/shm/surfel-fuzz-" + std::to_string(getpid())), path_(folder_ / name) {
    std::filesystem::create_directories(folder_);
  }
  ~FuzzFile() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  FuzzFile(const FuzzFile&) = delete;
  FuzzFile& operator=(const FuzzFile&) = delete;

  const std::string& write(const std::uint8_t* data, std::size_t size) {
    std::ofstream file(path_, std::ios::binary | std::ios::trunc);
    file.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
    return name_ = path_.string();
  }
  std::string folder() const { return folder_.string(); }

 private:
  std::filesystem::path folder_;
  std::filesystem::path path_;
  std::string name_;
};

/// Ends the process, which libFuzzer takes for a finding.
[[noreturn]] inline void fail(std::string_view what) {
  std::fprintf(stderr, "%.*s\n", static_cast<int>(what.size()), what.data());
  std::abort();
}

inline void require(bool holds, std::string_view what) {
  if (!holds) fail(what);
}

/// Calls read(), which must end well or with an Error whose message names the file.
template <class Read>
void read_or_refuse(const std::string& path, const Read& read) {
  try {
    read();
  } catch (const Error& error) {
    require(std::string_view(error.what()).find(path) != std::string_view::npos,
            std::string("a message does not name the file: ") + error.what());
  }
}

/// Numbers made of the bytes of a run, one after another; zero when there are no more.
class Numbers {
 public:
  Numbers(const std::uint8_t* data, std::size_t size) : data_(data), end_(data + size) {}

  bool done() const { return data_ == end_; }
  std::uint8_t byte() { return done() ? std::uint8_t{0} : *data_++; }
  /// Any float, not finite ones among them.
  float any() {
    std::uint32_t bits = 0;
    for (int i = 0; i < 4; ++i) bits = bits << 8 | byte();
    float value = 0;
    static_assert(sizeof value == sizeof bits);
    __builtin_memcpy(&value, &bits, sizeof value);
    return value;
  }
  /// -1 to 1, in 1/128.
  float unit() { return static_cast<float>(static_cast<std::int8_t>(byte())) / 128; }

 private:
  const std::uint8_t* data_;
  const std::uint8_t* end_;
};

/// Numbers of a cloud: its first two bytes choose options, and whether coordinates are any floats
/// or lengths of one scale.
class CloudNumbers : public Numbers {
 public:
  CloudNumbers(const std::uint8_t* data, std::size_t size)
      : Numbers(data, size),
        choice_(byte()),
        scale_(std::ldexp(1.0F, static_cast<int>(byte()) % 64 - 32)) {}

  /// For options: 0..63.
  int choice() const { return choice_ / 4; }
  bool are_any() const { return choice_ % 4 == 3; }
  float scale() const { return scale_; }
  float length() { return are_any() ? any() : scale_ * unit(); }
  /// A number without a unit.
  float number() { return are_any() ? any() : unit(); }

 private:
  std::uint8_t choice_;
  float scale_;
};

}  // namespace surfel::fuzz
