#pragma once

#include <charconv>
#include <cstddef>
#include <string>
#include <string_view>

#include <surfel/base/output_file.h>

namespace surfel {

/// Appends a number to a text: the shortest decimal that reads back as the same value.
template <class T>
void append_number(std::string& text, T value) {
  char buffer[32];  // The longest, a double with sign and exponent, has 24 characters.
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
  text.append(buffer, end);
}

/// Collects records, binary or text, and writes them to a file in large pieces. Keeps a reference
/// to the file. Internal to the io module.
class RecordWriter {
 public:
  explicit RecordWriter(OutputFile& file) : file_(file) {}

  /// Appends a value's bytes in this machine's order.
  template <class T>
  void add_bytes(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void add_text(std::string_view text) { bytes_ += text; }
  void add_text(char c) { bytes_ += c; }
  template <class T>
  void add_number(T value) {
    append_number(bytes_, value);
  }
  /// Appends a keyword and the components of a vector, a blank before each.
  template <class Vector>
  void add_vector(std::string_view keyword, const Vector& v) {
    add_text(keyword);
    for (const auto component : v) {
      add_text(' ');
      add_number(component);
    }
  }
  void end_line() {
    add_text('\n');
    end_record();
  }
  void end_record() {
    constexpr std::size_t kPiece = std::size_t{1} << 20;  // A call of the system costs far less.
    if (bytes_.size() >= kPiece) flush();
  }
  void flush() {
    file_.write(bytes_);
    bytes_.clear();
  }

 private:
  OutputFile& file_;
  std::string bytes_;
};

}  // namespace surfel
