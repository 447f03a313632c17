#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

class XyzReader {
 public:
  explicit XyzReader(const InputFile& file)
      : name_(file.name()), in_(name_, as_text(file.bytes()), {.separators = " \t,;"}) {}

  SurfelCloud read() {
    std::optional<std::size_t> count;
    while (next_line()) {
      const bool complete = count && rows() == *count;
      if (words_.size() == 1 && (complete || (names_.empty() && values_.empty() && !count))) {
        // Several scans in a file follow one another, each with its count.
        count = count.value_or(0) + read_count();
      } else if (names_.empty() && values_.empty() && !parse_number(words_.front())) {
        read_names();
      } else if (complete) {
        in_.fail(fmt::format("more points than the {} that the count promises", *count));
      } else {
        read_values();
      }
    }
    if (rows() == 0) throw_input(name_, "holds no points");
    if (count && rows() < *count) {
      throw_input(name_, fmt::format("the count promises {} points, but {} follow; it is truncated",
                                     *count, rows()));
    }
    if (names_.empty()) name_columns();
    return to_cloud(rows());
  }

 private:
  auto fails() const {
    return [this](const std::string& message) { in_.fail(message); };
  }
  std::size_t rows() const { return columns_ == 0 ? 0 : values_.size() / columns_; }

  /// Splits the next line that holds something into words_.
  bool next_line() {
    for (; in_.skip_to_content(); in_.next_line()) {
      const char mark = in_.peek();
      const bool comment = mark == '#' || (mark == '/' && in_.peek_word().starts_with("//"));
      while (comment && in_.skip(mark)) {
      }
      in_.rest_of_words(words_);
      if (!comment) return true;
      note_names();
    }
    return false;
  }

  /// words_ as names of columns.
  std::vector<std::string> to_names() const {
    std::vector<std::string> names;
    for (const std::string_view word : words_) {
      names.push_back(lower_case(word));
      std::erase(names.back(), '"');
    }
    return names;
  }

  static bool has_coordinates(const std::vector<std::string>& names) {
    for (const char* needed : {"x", "y", "z"}) {
      if (std::find(names.begin(), names.end(), needed) == names.end()) return false;
    }
    return true;
  }

  /// A comment may name the columns ("//X Y Z R G B"): the lines below tell by their number.
  void note_names() {
    if (!values_.empty()) return;
    std::vector<std::string> names = to_names();
    if (has_coordinates(names)) comment_names_ = std::move(names);
  }

  std::size_t read_count() const {
    const std::optional<double> value = parse_number(words_[0]);
    if (!value || *value < 0 || *value != std::trunc(*value)) {
      in_.fail(fmt::format("{} alone is neither a point nor a count of points",
                           quoted_excerpt(words_[0])));
    }
    constexpr std::size_t kShortestLine = 6;  // "0 0 0\n"
    // Beyond 2^63 a count is refused like 2^63.
    const auto count = static_cast<std::uint64_t>(std::min(*value, 0x1p63));
    // The line's end has not been read yet, the last line need not have one.
    require_room(
        count, kShortestLine, in_.remaining() + 1, [] { return std::string("the count"); },
        "points", fails());
    return count;
  }

  void read_names() {
    require_few(words_.size(), "columns", fails());
    names_ = to_names();
    columns_ = names_.size();
    if (!has_coordinates(names_)) {
      in_.fail(fmt::format("{} is no number, and the line does not name the columns x, y, z",
                           quoted_excerpt(words_[0])));
    }
  }

  void read_values() {
    if (columns_ == 0) {
      columns_ = words_.size();
      if (comment_names_.size() == columns_) names_ = comment_names_;
    }
    if (words_.size() != columns_) {
      in_.fail(fmt::format("{} values; the lines before have {}", words_.size(), columns_));
    }
    for (const std::string_view word : words_) {
      const std::optional<double> value = parse_number(word);
      if (!value)
        in_.fail(fmt::format("{} is not a number; below the first line a line holds numbers alone",
                             quoted_excerpt(word)));
      values_.push_back(*value);
    }
  }

  /// Do the three columns from `first` on have length 1 in some line, and length 1 or 0 (an unknown
  /// normal) in every line?
  bool unit_length(std::size_t first) const {
    bool any = false;
    for (std::size_t i = first; i < values_.size(); i += columns_) {
      const double length = portable::hypot(values_[i], values_[i + 1], values_[i + 2]);
      const bool unit = std::abs(length - 1) < 0.01;
      if (!unit && length != 0) return false;
      any |= unit;
    }
    return any;
  }

  void name_columns() {
    const std::array<const char*, 3> normal{"nx", "ny", "nz"};
    const std::array<const char*, 3> color{"red", "green", "blue"};
    const auto add = [&](const auto& names) {
      names_.insert(names_.end(), names.begin(), names.end());
    };
    add(std::array<const char*, 3>{"x", "y", "z"});
    switch (columns_) {
      case 3:
        return;
      case 4:
        names_.emplace_back("intensity");
        return;
      case 6:
        add(unit_length(3) ? normal : color);
        return;
      case 7:
        names_.emplace_back("intensity");
        add(color);
        return;
      case 9: {
        const bool normal_first = unit_length(3);
        add(normal_first ? normal : color);
        add(normal_first ? color : normal);
        return;
      }
      default:
        throw_input(name_,
                    fmt::format("{} columns without names; known are 3 (x y z), 4 (and intensity), "
                                "6 (and a normal or r g b), 7 (intensity r g b) and 9; write their "
                                "names into a first line",
                                columns_));
    }
  }

  bool is_color(std::size_t column) const {
    constexpr std::array<std::string_view, 6> kNames{"red", "green", "blue", "r", "g", "b"};
    return std::find(kNames.begin(), kNames.end(), names_[column]) != kNames.end();
  }

  /// The type of the colour columns: sRGB of 8 or 16 bits if all their values are whole numbers
  /// that fit, else float.
  ScalarType color_type() const {
    double largest = 0;
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (!is_color(i % columns_)) continue;
      if (!(values_[i] >= 0) || values_[i] != std::trunc(values_[i])) return ScalarType::kFloat32;
      largest = std::max(largest, values_[i]);
    }
    if (largest <= 255) return ScalarType::kUint8;
    return largest <= 65535 ? ScalarType::kUint16 : ScalarType::kFloat32;
  }

  /// Has the number so few digits that a float tells it?
  static bool fits_float(double value) {
    constexpr double kMost = 1e7;
    if (!std::isfinite(value) || value == static_cast<double>(static_cast<float>(value)))
      return true;
    for (double scaled = value; std::abs(scaled) < kMost && scaled != 0; scaled *= 10) {
      if (std::abs(scaled - std::round(scaled)) <= 1e-14 * std::abs(scaled)) return true;
    }
    return false;
  }

  /// Columns of many digits, such as times, are double.
  ScalarType number_type(std::size_t column) const {
    for (std::size_t i = column; i < values_.size(); i += columns_) {
      if (!fits_float(values_[i])) return ScalarType::kFloat64;
    }
    return ScalarType::kFloat32;
  }

  SurfelCloud to_cloud(std::size_t rows) {
    RecordTable table;
    const ScalarType color = color_type();
    for (std::size_t k = 0; k < columns_; ++k) {
      // Coordinates are double, because coordinates of maps have more digits than float.
      const bool coordinate = names_[k] == "x" || names_[k] == "y" || names_[k] == "z";
      const ScalarType type = coordinate    ? ScalarType::kFloat64
                              : is_color(k) ? color
                                            : number_type(k);
      table.columns.push_back({names_[k], type, table.stride});
      table.stride += scalar_size(type);
    }
    Array<std::byte> records(rows * table.stride);
    for (std::size_t i = 0; i < rows; ++i) {
      for (std::size_t k = 0; k < columns_; ++k) {
        const RecordColumn& column = table.columns[k];
        visit_type(column.type, [&]<class T>(T) {
          const T value = static_cast<T>(values_[i * columns_ + k]);
          std::memcpy(records.data() + i * table.stride + column.offset, &value, sizeof(T));
        });
      }
    }
    table.data = records.data();
    table.count = rows;
    return cloud_from_records(table, name_, false);
  }

  const std::string name_;
  TextScanner in_;
  std::vector<std::string_view> words_;
  std::vector<std::string> names_;
  std::vector<std::string> comment_names_;
  std::size_t columns_ = 0;
  Array<double> values_;
};

}  // namespace

bool is_xyz_name(const std::string& path) {
  constexpr std::array<std::string_view, 7> kExtensions{".xyz", ".txt",  ".pts",   ".asc",
                                                        ".csv", ".xyzn", ".xyzrgb"};
  const std::string extension = lower_extension(path);
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

SurfelCloud read_xyz(const InputFile& file) { return XyzReader(file).read(); }

}  // namespace surfel
