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

std::string mark_of(const std::string& text) {
  return std::string(kBegin) + text + std::string(kEnd);
}

std::string picture_mark(const Settings& s, std::size_t number) {
  return mark_of(fmt::format("{} [picture {}]", s.made_by, number));
}

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

/// Does the file hold this mark? Throws Error(kInput) where there is a file that does not.
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

std::string film_mark(const Settings& s) {
  const std::string pictures =
      s.frames ? fmt::format("{}-{}", (*s.frames)[0], (*s.frames)[1]) : std::string("all");
  return mark_of(fmt::format("{} [pictures {}]", s.made_by, pictures));
}

bool picture_is_made(const Settings& s, const std::string& file, std::size_t number) {
  return s.tiles ? part_is_there(file, *s.tiles, s.made_by)
                 : is_marked(file, picture_mark(s, number));
}

bool film_is_made(const Settings& s) { return is_marked(s.output, film_mark(s)); }

void mark_picture(const Settings& s, std::size_t number, ImageWriteOptions& options) {
  options.metadata.emplace_back("ImageDescription", picture_mark(s, number));
}

}  // namespace surfel::render_tool
