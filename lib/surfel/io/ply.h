#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/io/input_file.h>
#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

enum class PlyFormat : std::uint8_t { kAscii, kBinaryLittleEndian, kBinaryBigEndian };

/// A property of an element, as the header declares it.
struct PlyProperty {
  std::string name;
  ScalarType type = ScalarType::kFloat32;     ///< Type of the value, or of a list's items.
  std::optional<ScalarType> list_count_type;  ///< Set for list properties.
  bool is_list() const { return list_count_type.has_value(); }
};

/// An element of a PLY file, as its header declares it.
struct PlyElement {
  std::string name;
  std::size_t count = 0;
  std::vector<PlyProperty> properties;
  const PlyProperty* find(std::string_view property) const;  ///< Null if there is none.
};

/// The header of a PLY file.
struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;   ///< Elements in the order of the file.
  std::vector<std::string> comments;  ///< Without the word `comment`.
  std::vector<std::string> obj_info;
  const PlyElement* find(std::string_view element) const;  ///< Null if there is none.
};

/// Lists of all records of an element. The list of record i is value[offset[i]] up to, and without,
/// value[offset[i + 1]].
template <class T>
struct PlyLists {
  Array<std::size_t> offset;  ///< One more than there are records.
  Array<T> value;
};

/// The columns of a PLY file of any kind (ascii, binary of either byte order; elements in any
/// order), decoded when they are asked for: a column that nobody asks for costs no memory, and in
/// binary files of scalars no time. Counts are checked against the file's size before memory is
/// allocated. Lines may end in LF, CR LF or CR; text records may be wrapped, but each record starts
/// on a new line. Bytes after the last record are ignored. All members throw Error(kInput) for a
/// broken header, truncated data, a value that is no number, or a missing element or property; the
/// message names the file and the line or element. One thread at a time.
class SURFEL_API PlyFile {
 public:
  /// Reads the header.
  explicit PlyFile(InputFile file);
  ~PlyFile();
  PlyFile(PlyFile&&) noexcept;
  PlyFile& operator=(PlyFile&&) = delete;

  /// Does the content start as a PLY file does?
  static bool matches(std::span<const std::byte> bytes);

  const PlyHeader& header() const;
  const std::string& name() const;  ///< Name of the file, for messages.
  const InputFile& file() const;

  /// The scalar properties of an element as records: a view into the file where it is binary and
  /// the element has no lists, otherwise into memory of this object. In text files the float
  /// properties named in `wide` become double columns, because text can hold more digits than the
  /// type that its header names. `wide` has an effect on the first request for the element only.
  const RecordTable& scalars(std::string_view element,
                             std::initializer_list<std::string_view> wide = {});

  /// One scalar property, converted. T is float, double or an integer of at most 32 bits; a value
  /// that an integer T cannot hold is an error.
  template <class T>
  Array<T> column(std::string_view element, std::string_view property);

  /// One list property, converted like column(). T is float, double, int32 or uint32.
  template <class T>
  PlyLists<T> lists(std::string_view element, std::string_view property);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
