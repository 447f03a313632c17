#include <algorithm>
#include <string>
#include <string_view>

#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/toml_settings.h>
#include <surfel/io/view_file.h>

#include "fuzz/checks.h"

namespace surfel::fuzz {
namespace {

/// Bytes of a text that few bytes make. Readers refuse more than 32 values around a value.
constexpr std::size_t kMostText = std::size_t{1} << 10;
/// 50,000 brackets in one another end a parser that knows no limit. Texts of this length take most
/// of the time, and few inputs make them.
constexpr std::size_t kMostLongText = std::size_t{1} << 16;
constexpr std::size_t kLongTextEvery = 64;

/// Bytes below 128 are themselves; others repeat the last one to four bytes of the text.
std::string expanded(Bytes bytes) {
  const std::size_t most = bytes.size() % kLongTextEvery == 0 ? kMostLongText : kMostText;
  std::string text;
  for (const std::byte byte : bytes) {
    const auto code = std::to_integer<unsigned>(byte);
    if (code < 128) {
      text += static_cast<char>(code);
      continue;
    }
    const std::string last =
        text.substr(text.size() - std::min<std::size_t>(text.size(), code % 4 + 1));
    const std::size_t times = std::size_t{1} << (code / 4 % 16);
    for (std::size_t i = 0; i < times && text.size() < most; ++i) text += last;
  }
  return text;
}

/// Calls read(), which must end well or with an Error whose message names the file.
template <class Read>
void read_settings(const Read& read) {
  try {
    read();
  } catch (const Error& error) {
    require(std::string_view(error.what()).starts_with("/fuzz/"),
            "a message does not name the file");
  }
}

}  // namespace

/// Reads a text that may be long and deep as the kind of settings that the first byte tells:
/// configuration, cameras, views, the JSON of glTF.
void settings(Bytes bytes) {
  if (bytes.empty()) return;
  const std::string text = expanded(bytes.subspan(1));
  const Bytes file = std::as_bytes(std::span(text.data(), text.size()));
  read_settings([&] {
    switch (std::to_integer<unsigned>(bytes.front()) % 4) {
      case 0:
        read_toml_settings(text, "/fuzz/config");
        break;
      case 1:
        read_cameras({"/fuzz/camera.toml", file}, {});
        break;
      case 2:
        read_views({"/fuzz/views.json", file}, {.width = 8, .height = 6});
        break;
      default:
        read_mesh({"/fuzz/mesh.gltf", file});
    }
  });
}

}  // namespace surfel::fuzz
