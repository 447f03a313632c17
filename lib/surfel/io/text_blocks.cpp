#include <algorithm>

#include <surfel/io/text_blocks.h>

namespace surfel {
namespace {

/// Bytes of a block, roughly: some ten thousand lines.
constexpr std::size_t kTextBlock = std::size_t{1} << 20;
/// Bytes that are searched for a line's end at a time.
constexpr std::size_t kWindow = std::size_t{1} << 12;

/// The first line that begins at `from` or behind it; the file's end if there is none.
std::size_t next_line_begin(const InputFile& file, std::size_t from) {
  Array<std::byte> scratch;
  // The line end before `from` may be the one that counts.
  for (std::size_t at = from - 1; at < file.size(); at += kWindow) {
    // One byte more tells whether a CR has its LF.
    const std::size_t size = std::min(kWindow + 1, file.size() - at);
    const std::string_view text = as_text({file.read_at(at, size, scratch), size});
    const std::size_t end = text.substr(0, kWindow).find_first_of("\r\n");
    if (end == std::string_view::npos) continue;
    const bool pair = text.substr(end).starts_with("\r\n");
    return at + end + (pair ? 2 : 1);
  }
  return file.size();
}

}  // namespace

TextBlocks::TextBlocks(const InputFile& file, const TextFormat& format)
    : file_(file), format_(format), begin_{0} {
  while (begin_.back() + kTextBlock < file.size()) {
    begin_.push_back(next_line_begin(file, begin_.back() + kTextBlock));
  }
  if (begin_.back() < file.size()) begin_.push_back(file.size());
}

TextScanner TextBlocks::scan(std::size_t begin, std::size_t end, Array<std::byte>& scratch) const {
  const std::size_t size = end - begin;
  TextScanner in(file_.name(), as_text({file_.read_at(begin, size, scratch), size}), format_);
  in.count_lines_before([this, begin] {
    std::size_t lines = 0;
    Array<std::byte> text;
    for (std::size_t at = 0; at < begin; at += kTextBlock) {
      const std::size_t count = std::min(kTextBlock, begin - at);
      // A pair of CR and LF may be parted by two reads: the LF that follows a CR ends no line.
      const std::size_t before = at == 0 ? 0 : 1;
      const std::byte* from = file_.read_at(at - before, count + before, text);
      const std::string_view part = as_text({from, count + before});
      for (std::size_t i = before; i < part.size(); ++i) {
        lines += part[i] == '\r' || (part[i] == '\n' && (i == 0 || part[i - 1] != '\r'));
      }
    }
    return lines;
  });
  return in;
}

}  // namespace surfel
