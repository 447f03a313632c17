#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/io/input_file.h>
#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The points of a PCD file (versions 0.5 to 0.7; ascii, binary, binary_compressed). An organised
/// cloud is flattened row by row. A field of several values becomes the columns NAME_0, NAME_1 and
/// so on; packed colours (`rgb`, `rgba`) become `red green blue` and `alpha`, but an alpha that is
/// zero everywhere is left out, since most writers that have none store zeros; 64-bit integers
/// become doubles. The header is checked against the file's size before anything is allocated.
///
/// Compressed bodies are read by PCL. Ascii and binary bodies are tables, as in PLY files, and are
/// read here: no run waits for PCL's files library to load, coordinates of text keep digits that
/// float fields would round off (UTM coordinates, for example), and errors name the line. Internal
/// to the io module.
class PcdFile {
 public:
  /// Throws Error(kInput) naming the file and the header line, text line or point.
  explicit PcdFile(InputFile file);
  PcdFile(const PcdFile&) = delete;
  PcdFile& operator=(const PcdFile&) = delete;

  /// Does the content start as a PCD file does? The first kMatched bytes of it suffice.
  static constexpr std::size_t kMatched = 4096;
  static bool matches(std::span<const std::byte> bytes);

  const RecordTable& records() const { return table_; }
  bool double_positions() const { return double_positions_; }
  /// The header's, unless it is the format's default and the points are not organised.
  const std::optional<Viewpoint>& viewpoint() const { return viewpoint_; }
  const std::vector<std::string>& comments() const { return comments_; }

 private:
  friend class PcdHeaderParser;
  enum class Body { kAscii, kBinary, kCompressed };
  struct Field {
    std::string name;
    std::size_t size = 0;
    char type = '\0';
    std::size_t count = 1;
    std::size_t bytes() const { return size * count; }
  };

  void add_columns();
  void read_ascii();
  void read_binary();
  void read_compressed();
  void convert_wide_integers();
  void unpack_colors();
  void check_room(std::size_t least_bytes, std::size_t bytes) const;

  InputFile file_;
  std::vector<Field> fields_;
  Body body_ = Body::kAscii;
  std::size_t body_begin_ = 0;
  RecordTable table_;
  Array<std::byte> storage_;  ///< The records of `table_`, unless they are in the file.
  bool double_positions_ = false;
  std::optional<Viewpoint> viewpoint_;
  std::vector<std::string> comments_;
};

/// The header of a binary PCD file with these columns, from "# .PCD" to the line DATA.
std::string pcd_header(const std::vector<RecordColumn>& columns, std::size_t count,
                       const std::optional<Viewpoint>& viewpoint,
                       const std::vector<std::string>& comments);

}  // namespace surfel
