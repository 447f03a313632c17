#include "tools/render/made_by.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/resume_journal.h>
#include <surfel/io/input_file.h>

#include "tools/render/views.h"

namespace surfel::render_tool {
namespace {

// PNG, EXR, TIFF, JPEG, MP4 and WebM store texts as they are: these words find them in any.
constexpr std::string_view kBegin = "surfelMadeBy: ";
constexpr std::string_view kEnd = " :surfelMadeBy";

/// The mark that a file holds; nullopt where it holds none.
std::optional<std::string> find_mark(const std::string& path) {
  constexpr std::size_t kMostMark = std::size_t{1} << 21;  // Commands are not longer.
  const InputFile file(path, true);
  Array<std::byte> scratch;
  for (std::size_t at = 0; at < file.size(); at += kMostMark) {
    const std::size_t size = std::min(2 * kMostMark, file.size() - at);
    const std::string_view text = as_text({file.read_at(at, size, scratch), size});
    const std::size_t begin = text.find(kBegin);
    if (begin == std::string_view::npos) continue;
    const std::size_t end = text.find(kEnd, begin);
    if (end != std::string_view::npos) {
      return std::string(text.substr(begin, end + kEnd.size() - begin));
    }
  }
  return std::nullopt;
}

}  // namespace

std::string made_by(tool::Tool& tool, const Settings& s) {
  namespace fs = std::filesystem;
  std::string text = tool.provenance();
  for (const std::string& input : tool.files().inputs()) {
    std::error_code none;
    const fs::file_status status = fs::status(input, none);
    if (fs::is_regular_file(status) || fs::is_directory(status)) {
      if (input == tool.app().config_file()) continue;
      text += fmt::format(" [{}: {}]", input.substr(input.rfind('/') + 1), content_mark(input));
    } else if (s.skip_existing && (fs::exists(status) || input == tool::shown_name("-"))) {
      throw_usage(fmt::format(
          "--skip-existing compares the content of files; {} is none, name a file", input));
    }
    // Names of procedural textures are no files.
  }
  return text;
}

bool says_made_by(const Settings& s) { return s.skip_existing || is_pattern(s.output); }

std::string made_by_mark(const Settings& s, std::optional<std::size_t> picture) {
  const std::string what = picture ? fmt::format("picture {}", *picture)
                           : s.frames
                               ? fmt::format("pictures {}-{}", (*s.frames)[0], (*s.frames)[1])
                               : "all pictures";
  return fmt::format("{}{} [{}]{}", kBegin, s.made_by, what, kEnd);
}

bool is_marked(const std::string& path, const std::string& mark) {
  std::error_code none;
  if (!std::filesystem::exists(path, none)) return false;
  const std::optional<std::string> found = find_mark(path);
  if (found == mark) return true;
  const auto text = [](const std::string& of) {
    return of.substr(kBegin.size(), of.size() - kBegin.size() - kEnd.size());
  };
  const std::string why =
      found ? fmt::format("was made by \"{}\", not by \"{}\"", text(*found), text(mark))
            : "does not say what made it, as PNG, EXR, TIFF, JPEG, MP4 and WebM of --skip-existing "
              "do";
  throw_input(path, why + "; move it away, or write over it without --skip-existing");
}

}  // namespace surfel::render_tool
