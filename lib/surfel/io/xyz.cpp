#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

/// Is the word a number once a comma between two of its digits is a point? Sets `comma` if it has
/// one.
bool has_decimal_comma(std::string_view word, bool& comma) {
  const std::size_t at = word.find(',');
  if (word.find('.') != std::string_view::npos) return false;
  if (at == std::string_view::npos) return parse_number(word).has_value();
  const auto digit = [&](std::size_t place) {
    return place < word.size() && word[place] >= '0' && word[place] <= '9';
  };
  if (at == 0 || !digit(at - 1) || !digit(at + 1)) return false;
  comma = true;
  return parse_number(std::string(word).replace(at, 1, ".")).has_value();
}

/// Do blanks, tabs or semicolons part the line into numbers with decimal commas? At least three,
/// all of which may have one, since "1, 2, 3" and "1,2,3 4,5,6" are numbers parted by commas.
bool has_decimal_commas(std::string_view line) {
  TextScanner in({}, line, {.separators = " \t;"});
  std::vector<std::string_view> words;
  in.rest_of_words(words);
  bool comma = false;
  return words.size() >= 3 &&
         std::all_of(words.begin(), words.end(),
                     [&](std::string_view word) { return has_decimal_comma(word, comma); }) &&
         comma;
}

class XyzReader {
 public:
  XyzReader(const InputFile& file, const std::vector<std::string>& columns)
      : name_(file.name()),
        in_(name_, as_text(file.bytes()), {.separators = " \t,;"}),
        given_(!columns.empty()),
        names_(columns) {
    for (std::string& name : names_) name = lower_case(name);
  }

  SurfelCloud read() {
    std::optional<std::size_t> count;
    while (next_line()) {
      const bool complete = count && rows() == *count;
      if (words_.size() == 1 && (complete || (!named_ && values_.empty() && !count))) {
        // Several scans in a file follow one another, each with its count.
        count = count.value_or(0) + read_count();
      } else if (!named_ && values_.empty() && !parse_number(words_.front())) {
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
    linear_ = linear_ || std::find(names.begin(), names.end(), "linear") != names.end();
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
    named_ = true;
    if (given_) return;
    names_ = to_names();
    columns_ = names_.size();
    if (!has_coordinates(names_)) {
      in_.fail(fmt::format("{} is no number, and the line does not name the columns x, y, z",
                           quoted_excerpt(words_[0])));
    }
  }

  void read_values() {
    const bool first = values_.empty();
    if (first || words_.size() != columns_) refuse_decimal_commas();
    if (columns_ == 0) {
      columns_ = words_.size();
      if (!given_ && comment_names_.size() == columns_) names_ = comment_names_;
    }
    if (given_ && words_.size() != names_.size()) {
      in_.fail(fmt::format("{} values, and `columns` names {}; name all of them, - leaves one out",
                           words_.size(), names_.size()));
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

  void refuse_decimal_commas() const {
    const char* begin = words_.front().data();
    const char* end = words_.back().data() + words_.back().size();
    const std::string_view line(begin, static_cast<std::size_t>(end - begin));
    if (has_decimal_commas(line)) in_.fail(quoted_excerpt(line) + kDecimalCommas);
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

  /// The type of the colour columns: sRGB codes of 8 or 16 bits if all their values are whole
  /// numbers that fit, but not 0 and 1 alone, else float. Makes floats linear light.
  ScalarType make_colors() {
    double largest = 0;
    bool whole = true;
    const auto each = [&](const auto& visit) {
      for (std::size_t i = 0; i < values_.size(); ++i) {
        if (is_color(i % columns_)) visit(values_[i]);
      }
    };
    each([&](double value) {
      whole = whole && value >= 0 && value == std::trunc(value);
      if (std::isfinite(value)) largest = std::max(largest, value);
    });
    if (linear_ || largest > 65535) return ScalarType::kFloat32;
    if (whole && largest != 1) return largest <= 255 ? ScalarType::kUint8 : ScalarType::kUint16;
    const double white = largest <= 1 ? 1 : largest <= 255 ? 255 : 65535;
    each([&](double& value) {
      value = static_cast<double>(srgb_to_linear(static_cast<float>(value / white)));
    });
    return ScalarType::kFloat32;
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
    const ScalarType color = make_colors();
    std::vector<std::size_t> from;  // Columns of the file.
    for (std::size_t k = 0; k < columns_; ++k) {
      if (given_ && names_[k] == "-") continue;
      from.push_back(k);
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
      for (std::size_t k = 0; k < from.size(); ++k) {
        const RecordColumn& column = table.columns[k];
        visit_type(column.type, [&]<class T>(T) {
          const T value = static_cast<T>(values_[i * columns_ + from[k]]);
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
  const bool given_;                ///< The caller names the columns.
  bool named_ = false;              ///< A line of names was read.
  bool linear_ = false;             ///< Colours are linear light.
  std::vector<std::string> names_;  ///< Of the columns, "-" where one is left out.
  std::vector<std::string> comment_names_;
  std::size_t columns_ = 0;
  Array<double> values_;
};

}  // namespace

bool is_xyz_name(const std::string& path) {
  constexpr std::array<std::string_view, 7> kTextExtensions{".xyz", ".txt",  ".pts",   ".asc",
                                                            ".csv", ".xyzn", ".xyzrgb"};
  const std::string extension = lower_extension(path);
  return std::find(kTextExtensions.begin(), kTextExtensions.end(), extension) !=
         kTextExtensions.end();
}

SurfelCloud read_xyz(const InputFile& file, const std::vector<std::string>& columns) {
  return XyzReader(file, columns).read();
}

}  // namespace surfel
