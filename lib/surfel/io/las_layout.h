#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <surfel/base/scalar_type.h>
#include <surfel/io/las_header.h>
#include <surfel/io/record_table.h>

namespace surfel {

/// A field of a LAS point: some bits of an integer, or a value of its own.
struct LasField {
  const char* name;
  ScalarType type;     ///< Of the column that stands for it.
  std::size_t offset;  ///< Bytes from the point's start.
  int shift = 0;       ///< Lowest bit.
  int bits = 0;        ///< How many; 0: the whole value, as `type` says.
};

/// The fields of a point format but x, y and z, in the order of their offsets: names as laspy
/// gives them. A 64-bit integer (`wave_packet_offset`) is not among them.
std::vector<LasField> las_fields(int point_format);
/// Offset of the red of a point format; 0 where points have no colours.
std::size_t las_color_offset(int point_format);

/// Turns LAS points into records of plain scalars (SurfelDecoder): x y z as double, every field of
/// the format, and the extra bytes under the names that their descriptions give them, or as
/// `extra_0`, `extra_1` and so on, byte by byte. Extra bytes with a scale, and 64-bit integers,
/// become double. Internal to the io module.
class LasLayout {
 public:
  /// Throws Error(kInput) naming `file` for more columns than are supported.
  LasLayout(const LasHeader& header, const std::string& file);

  const std::vector<RecordColumn>& columns() const { return columns_; }
  /// Bytes of a record.
  std::size_t stride() const { return stride_; }
  /// Makes records of `count` points; returns the largest value of their colours, 0 where they have
  /// none. Callable from any thread.
  std::uint16_t expand(const std::byte* points, std::size_t count, std::byte* records) const;

 private:
  /// What is no scalar of a column's type already.
  struct Made {
    ScalarType from;
    bool wide = false;  ///< `from` is a 64-bit integer, unsigned or (kInt32) signed.
    int shift = 0;
    unsigned mask = 0;  ///< 0: a number, which becomes double.
    double scale = 1;
    double offset = 0;
    std::size_t at = 0;  ///< Offset in the point.
    std::size_t to = 0;  ///< Offset in the record.
  };

  void add(std::string name, ScalarType type, std::size_t offset);
  void add_made(const std::string& name, ScalarType type, Made made);
  void add_fields(int point_format);
  void add_extra(const LasHeader& header);
  void add_described(const std::string& description, std::size_t& at, std::size_t end);

  static constexpr std::size_t kPosition = 3 * sizeof(double);
  static constexpr std::size_t kKept = 12;  ///< Bytes of a point that records do not repeat.
  Vec3d scale_;
  Vec3d offset_;
  std::size_t point_;  ///< Bytes of a point.
  std::size_t color_;  ///< Offset of red in a point; 0: none.
  std::size_t stride_;
  std::vector<RecordColumn> columns_;
  std::vector<Made> made_;
  /// The names of columns in lower case, each with the last number that was tried behind it.
  std::map<std::string, int> names_;
};

}  // namespace surfel
