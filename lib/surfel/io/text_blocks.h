#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include <surfel/io/input_file.h>
#include <surfel/io/text_scanner.h>

namespace surfel {

/// A text file as blocks of whole lines, which end in LF, CR LF or CR. Only blocks that are asked
/// for are in memory. Keeps a reference to the file. Internal to the io module.
class TextBlocks {
 public:
  /// Looks for the lines at which blocks begin.
  TextBlocks(const InputFile& file, const TextFormat& format);

  std::size_t size() const { return begin_.size() - 1; }
  /// Offset of a block's first line in the file; of block size() the file's end.
  std::size_t begin(std::size_t block) const { return begin_[block]; }
  /// A scanner of the bytes [begin, end) of the file, whose messages tell the line in the file. The
  /// text is in `scratch`, or in the file's own memory. Callable from any thread.
  TextScanner scan(std::size_t begin, std::size_t end, Array<std::byte>& scratch) const;

 private:
  const InputFile& file_;
  TextFormat format_;
  std::vector<std::size_t> begin_;
};

}  // namespace surfel
