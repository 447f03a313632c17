#include <array>
#include <cstdint>

#include <surfel/io/uri.h>

namespace surfel {
namespace {

constexpr std::string_view kScheme = "data:";

/// Value of a letter of base64 (RFC 4648, section 4); -1 for other characters.
int base64_value(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  if (c == '+') return 62;
  return c == '/' ? 63 : -1;
}

int hex_value(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

}  // namespace

bool is_data_uri(std::string_view uri) { return uri.starts_with(kScheme); }

std::optional<Array<std::byte>> decode_data_uri(std::string_view uri) {
  const std::size_t comma = uri.find(',');
  if (comma == std::string_view::npos || !uri.substr(0, comma).ends_with(";base64")) {
    return std::nullopt;
  }
  std::string_view coded = uri.substr(comma + 1);
  while (coded.ends_with('=')) coded.remove_suffix(1);
  if (coded.size() % 4 == 1) return std::nullopt;
  Array<std::byte> bytes;
  bytes.reserve(coded.size() / 4 * 3 + 2);
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : coded) {
    const int value = base64_value(c);
    if (value < 0) return std::nullopt;
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes.push_back(static_cast<std::byte>(bits >> count & 0xffU));
  }
  return bytes;
}

std::optional<std::string> path_of_uri(std::string_view uri) {
  constexpr std::string_view kFileScheme = "file://";
  if (uri.starts_with(kFileScheme)) uri.remove_prefix(kFileScheme.size());
  // A colon before any slash ends a scheme, or the letter of a drive.
  const std::size_t colon = uri.substr(0, uri.find_first_of("/\\")).find(':');
  if (colon != std::string_view::npos && colon != 1) return std::nullopt;
  std::string path;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    const bool coded = uri[i] == '%' && i + 2 < uri.size() && hex_value(uri[i + 1]) >= 0 &&
                       hex_value(uri[i + 2]) >= 0;
    if (coded) {
      path += static_cast<char>(16 * hex_value(uri[i + 1]) + hex_value(uri[i + 2]));
      i += 2;
    } else {
      path += uri[i];
    }
  }
  if (path.empty() || path.find('\0') != std::string::npos) return std::nullopt;
  return path;
}

}  // namespace surfel
