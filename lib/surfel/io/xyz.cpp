#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_blocks.h>
#include <surfel/io/text_records.h>
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

constexpr TextFormat kXyzText{.separators = " \t,;"};

/// What the values of a column tell about the type that holds them.
struct ValueFacts {
  double largest = 0;    ///< Of the finite values, or 0.
  bool codes = true;     ///< All are whole numbers >= 0.
  bool in_float = true;  ///< All are floats, or what floats are written as.
};

/// A line of one number, which may be the count of a further list of points.
struct CountLine {
  std::size_t row;    ///< Points of the block above it.
  std::size_t begin;  ///< Offsets in the file.
  std::size_t end;
};

/// What a block of lines holds.
struct LineFacts {
  std::size_t rows = 0;
  std::vector<CountLine> counts;
  std::vector<ValueFacts> columns;
  /// Whether the fourth to sixth columns have length 1 in some line, and length 1 or 0 (an unknown
  /// normal) in every line.
  bool some_unit = false;
  bool all_unit = true;
  Bounds box;  ///< Of the finite coordinates.
};

/// Is the number a float, or what a float is written as?
bool fits_float(double value) {
  const auto nearest = static_cast<float>(value);
  if (!std::isfinite(value) || value == static_cast<double>(nearest)) return true;
  std::array<char, 32> text{};
  const char* const end = std::to_chars(text.data(), text.data() + text.size(), nearest).ptr;
  double written = 0;
  std::from_chars(text.data(), end, written);
  return written == value;
}

/// Goes to the next line that holds something and splits it into words. A comment's words are
/// those behind its mark. False at the end of the text.
bool next_line(TextScanner& in, std::vector<std::string_view>& words, bool& comment) {
  if (!in.skip_to_content()) return false;
  const char mark = in.peek();
  comment = mark == '#' || (mark == '/' && in.peek_word().starts_with("//"));
  while (comment && in.skip(mark)) {
  }
  in.rest_of_words(words);
  return true;
}

/// The points as records, which are made of the text block by block. The constructor reads all of
/// the text once, because the values decide on the types of the columns.
class XyzBlocks final : public RecordBlocks {
 public:
  XyzBlocks(const InputFile& file, const std::vector<std::string>& columns);

  std::size_t blocks() const override { return text_.size(); }
  std::size_t first(std::size_t block) const override { return first_[block]; }
  const std::byte* read(std::size_t block, Array<std::byte>& scratch) const override;

  RecordTable table() const;

 private:
  void read_head();
  void read_names(const TextScanner& in);
  void note_names();
  std::uint64_t read_count(const TextScanner& in, std::string_view word, std::size_t end) const;
  void start_points(const TextScanner& in);
  TextScanner scan(std::size_t block, Array<std::byte>& scratch) const {
    const bool first = block == head_block_;
    return text_.scan(first ? points_begin_ : text_.begin(block), text_.begin(block + 1), scratch);
  }
  template <class Row, class Count>
  void for_rows(std::size_t block, const Row& row, const Count& count) const;
  LineFacts look_at(std::size_t block) const;
  void add_up(const std::vector<LineFacts>& facts);
  [[noreturn]] void fail_beyond_count(std::size_t row) const;
  void name_columns();
  void lay_out();
  bool is_color(std::size_t column) const;
  bool is_place(std::size_t column) const {
    return names_[column] == "x" || names_[column] == "y" || names_[column] == "z";
  }
  std::array<std::size_t, 3> places() const;

  const InputFile& file_;
  TextBlocks text_;
  const bool given_;                ///< The caller names the columns.
  std::vector<std::string> names_;  ///< Of the columns, "-" where one is left out.
  std::vector<std::string> comment_names_;
  std::vector<std::string_view> words_;  ///< Of a line above the points.
  bool named_ = false;                   ///< A line of names was read.
  bool linear_ = false;                  ///< Colours are linear light.
  std::optional<std::uint64_t> count_;   ///< The sum of the counts that were read.
  std::size_t head_block_ = 0;           ///< The block of the first point.
  std::size_t points_begin_ = 0;         ///< Offset of its line in the file.
  std::size_t columns_ = 0;
  std::vector<std::size_t> first_;  ///< Points before each block.
  LineFacts all_;                   ///< Of all blocks; without counts.
  std::vector<RecordColumn> layout_;
  std::vector<std::size_t> from_;  ///< The file's column of each in the layout.
  std::vector<bool> colors_;       ///< Is it a channel of a colour? By column of the layout.
  std::size_t stride_ = 0;
  double white_ = 0;  ///< The largest code of colours that become linear light; 0: none do.
};

XyzBlocks::XyzBlocks(const InputFile& file, const std::vector<std::string>& columns)
    : file_(file), text_(file, kXyzText), given_(!columns.empty()), names_(columns) {
  for (std::string& name : names_) name = lower_case(name);
  read_head();
  std::vector<LineFacts> facts(text_.size());
  {
    ProgressStage stage("looking through " + file.name(), file.size(), "B");
    parallel_each(text_.size(), 1, [&](std::size_t block) {
      if (block >= head_block_) facts[block] = look_at(block);
      stage.add(text_.begin(block + 1) - text_.begin(block));
    });
  }
  add_up(facts);
  if (names_.empty()) name_columns();
  lay_out();
}

bool has_coordinates(const std::vector<std::string>& names) {
  for (const char* needed : {"x", "y", "z"}) {
    if (std::find(names.begin(), names.end(), needed) == names.end()) return false;
  }
  return true;
}

std::vector<std::string> to_names(const std::vector<std::string_view>& words) {
  std::vector<std::string> names;
  for (const std::string_view word : words) {
    names.push_back(lower_case(word));
    std::erase(names.back(), '"');
  }
  return names;
}

/// Reads what stands above the points.
void XyzBlocks::read_head() {
  Array<std::byte> scratch;
  for (head_block_ = 0; head_block_ < text_.size(); ++head_block_) {
    const std::size_t begin = text_.begin(head_block_);
    const std::size_t end = text_.begin(head_block_ + 1);
    TextScanner in = text_.scan(begin, end, scratch);
    for (bool comment = false; in.skip_to_content();) {
      points_begin_ = begin + in.position();
      next_line(in, words_, comment);
      // Several scans in a file follow one another, each with its count.
      const bool counts = words_.size() == 1 && (count_ ? *count_ == 0 : !named_);
      if (comment) {
        note_names();
      } else if (counts) {
        count_ = count_.value_or(0) + read_count(in, words_[0], begin + in.position());
      } else if (!named_ && !parse_number(words_.front())) {
        read_names(in);
      } else {
        return start_points(in);
      }
    }
  }
  if (count_.value_or(0) == 0) throw_input(file_.name(), "holds no points");
  throw_input(file_.name(),
              fmt::format("the count promises {} points, but 0 follow; it is truncated", *count_));
}

/// A comment may name the columns ("//X Y Z R G B"): the lines below tell by their number.
void XyzBlocks::note_names() {
  std::vector<std::string> names = to_names(words_);
  linear_ = linear_ || std::find(names.begin(), names.end(), "linear") != names.end();
  if (has_coordinates(names)) comment_names_ = std::move(names);
}

/// \param end  Offset of the count line's end in the file.
std::uint64_t XyzBlocks::read_count(const TextScanner& in, std::string_view word,
                                    std::size_t end) const {
  const std::optional<double> value = parse_number(word);
  if (!value || *value < 0 || *value != std::trunc(*value)) {
    in.fail(fmt::format("{} alone is neither a point nor a count of points", quoted_excerpt(word)));
  }
  constexpr std::size_t kShortestLine = 6;  // "0 0 0\n"
  // Beyond 2^63 a count is refused like 2^63.
  const auto count = static_cast<std::uint64_t>(std::min(*value, 0x1p63));
  // The line's end is among the bytes behind it, the last line need not have one.
  require_room(
      count, kShortestLine, file_.size() - end + 1, [] { return std::string("the count"); },
      "points", [&](const std::string& message) { in.fail(message); });
  return count;
}

void XyzBlocks::read_names(const TextScanner& in) {
  require_few(words_.size(), "columns", [&](const std::string& message) { in.fail(message); });
  named_ = true;
  if (given_) return;
  names_ = to_names(words_);
  number_repeated_names(names_);
  columns_ = names_.size();
  if (!has_coordinates(names_)) {
    in.fail(fmt::format("{} is no number, and the line does not name the columns x, y, z",
                        quoted_excerpt(words_[0])));
  }
}

void refuse_decimal_commas(const TextScanner& in, const std::vector<std::string_view>& words) {
  const char* begin = words.front().data();
  const char* end = words.back().data() + words.back().size();
  const std::string_view line(begin, static_cast<std::size_t>(end - begin));
  if (has_decimal_commas(line)) in.fail(quoted_excerpt(line) + kDecimalCommas);
}

/// Takes the number of columns from the first point.
void XyzBlocks::start_points(const TextScanner& in) {
  if (count_ && *count_ == 0) in.fail("more points than the 0 that the count promises");
  refuse_decimal_commas(in, words_);
  if (columns_ == 0) {
    columns_ = words_.size();
    if (!given_ && comment_names_.size() == columns_) {
      names_ = comment_names_;
      number_repeated_names(names_);
    }
  }
  if (given_ && words_.size() != names_.size()) {
    in.fail(fmt::format("{} values, and `columns` names {}; name all of them, - leaves one out",
                        words_.size(), names_.size()));
  }
}

/// Calls row(values) for every point of a block, and count(at, word) for every line of one word,
/// which no point is, with its offset from the first point or the block's begin.
template <class Row, class Count>
void XyzBlocks::for_rows(std::size_t block, const Row& row, const Count& count) const {
  static thread_local Array<std::byte> scratch;
  static thread_local std::vector<std::string_view> words;
  static thread_local std::vector<double> values;
  TextScanner in = scan(block, scratch);
  values.resize(columns_);
  for (bool comment = false; in.skip_to_content();) {
    const std::size_t at = in.position();
    next_line(in, words, comment);
    if (comment) continue;
    if (words.size() == 1 && columns_ != 1) {
      count(at, words[0]);
      continue;
    }
    if (words.size() != columns_) {
      refuse_decimal_commas(in, words);
      in.fail(fmt::format("{} values; the lines before have {}", words.size(), columns_));
    }
    for (std::size_t k = 0; k < columns_; ++k) {
      const std::optional<double> value = parse_number(words[k]);
      if (!value) {
        in.fail(fmt::format("{} is not a number; below the first line a line holds numbers alone",
                            quoted_excerpt(words[k])));
      }
      values[k] = *value;
    }
    row(values);
  }
}

LineFacts XyzBlocks::look_at(std::size_t block) const {
  LineFacts facts;
  facts.columns.resize(columns_);
  const std::array<std::size_t, 3> place = places();
  const bool normals = names_.empty() && (columns_ == 6 || columns_ == 9);
  std::vector<bool> typed(columns_);  // Columns whose type the values decide.
  for (std::size_t k = 0; k < columns_; ++k) {
    typed[k] = names_.empty() ? k >= 3 : !is_place(k) && names_[k] != "-";
  }
  const std::size_t from = block == head_block_ ? points_begin_ : text_.begin(block);
  for_rows(
      block,
      [&](const std::vector<double>& values) {
        ++facts.rows;
        const Vec3d position(values[place[0]], values[place[1]], values[place[2]]);
        if (position.allFinite()) facts.box.add(position);
        for (std::size_t k = 0; k < columns_; ++k) {
          if (!typed[k]) continue;
          ValueFacts& column = facts.columns[k];
          column.codes = column.codes && values[k] >= 0 && values[k] == std::trunc(values[k]);
          if (std::isfinite(values[k])) column.largest = std::max(column.largest, values[k]);
          column.in_float = column.in_float && fits_float(values[k]);
        }
        if (!normals) return;
        const double length = portable::hypot(values[3], values[4], values[5]);
        const bool unit = std::abs(length - 1) < 0.01;
        facts.some_unit = facts.some_unit || unit;
        facts.all_unit = facts.all_unit && (unit || length == 0);
      },
      [&](std::size_t at, std::string_view word) {
        facts.counts.push_back({facts.rows, from + at, from + at + word.size()});
      });
  return facts;
}

/// Adds up the blocks' rows and facts, and follows the counts.
void XyzBlocks::add_up(const std::vector<LineFacts>& facts) {
  all_.columns.resize(columns_);
  const auto beyond = [&](std::size_t rows) { return count_ && rows > *count_; };
  for (std::size_t block = 0; block < facts.size(); ++block) {
    const LineFacts& part = facts[block];
    first_.push_back(all_.rows);
    for (const CountLine& line : part.counts) {
      const std::size_t rows = all_.rows + line.row;
      if (beyond(rows)) fail_beyond_count(*count_);
      Array<std::byte> scratch;
      TextScanner in = text_.scan(line.begin, line.end, scratch);
      const std::string_view word = in.word();
      if (!count_ || rows != *count_) {
        in.fail(fmt::format("1 values; the lines before have {}", columns_));
      }
      *count_ += read_count(in, word, line.end);
    }
    all_.rows += part.rows;
    all_.some_unit = all_.some_unit || part.some_unit;
    all_.all_unit = all_.all_unit && part.all_unit;
    all_.box.min = all_.box.min.cwiseMin(part.box.min);
    all_.box.max = all_.box.max.cwiseMax(part.box.max);
    for (std::size_t k = 0; k < part.columns.size(); ++k) {
      ValueFacts& column = all_.columns[k];
      column.largest = std::max(column.largest, part.columns[k].largest);
      column.codes = column.codes && part.columns[k].codes;
      column.in_float = column.in_float && part.columns[k].in_float;
    }
  }
  first_.push_back(all_.rows);
  if (beyond(all_.rows)) fail_beyond_count(*count_);
  if (count_ && all_.rows < *count_) {
    throw_input(file_.name(),
                fmt::format("the count promises {} points, but {} follow; it is truncated", *count_,
                            all_.rows));
  }
}

/// Names the line of the first point that the counts do not promise.
void XyzBlocks::fail_beyond_count(std::size_t row) const {
  const auto after = std::upper_bound(first_.begin(), first_.end(), row);
  const auto block = static_cast<std::size_t>(after - first_.begin()) - 1;
  Array<std::byte> scratch;
  std::vector<std::string_view> words;
  TextScanner in = scan(block, scratch);
  std::size_t at = first_[block];
  for (bool comment = false; next_line(in, words, comment);) {
    if (!comment && words.size() == columns_ && at++ == row) break;
  }
  in.fail(fmt::format("more points than the {} that the count promises", row));
}

void XyzBlocks::name_columns() {
  const std::array<const char*, 3> normal{"nx", "ny", "nz"};
  const std::array<const char*, 3> color{"red", "green", "blue"};
  const bool normal_first = all_.some_unit && all_.all_unit;
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
      add(normal_first ? normal : color);
      return;
    case 7:
      names_.emplace_back("intensity");
      add(color);
      return;
    case 9:
      add(normal_first ? normal : color);
      add(normal_first ? color : normal);
      return;
    default:
      throw_input(file_.name(),
                  fmt::format("{} columns without names; known are 3 (x y z), 4 (and intensity), "
                              "6 (and a normal or r g b), 7 (intensity r g b) and 9; write their "
                              "names into a first line",
                              columns_));
  }
}

/// Is it a channel of a colour, all three of which are there? One alone is a column of numbers.
bool XyzBlocks::is_color(std::size_t column) const {
  using Names = std::array<std::string_view, 3>;
  const auto holds = [](const auto& names, std::string_view name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const Names& channels : {Names{"red", "green", "blue"}, Names{"r", "g", "b"}}) {
    if (!holds(channels, names_[column])) continue;
    return std::all_of(channels.begin(), channels.end(),
                       [&](std::string_view channel) { return holds(names_, channel); });
  }
  return false;
}

/// The columns of x, y and z.
std::array<std::size_t, 3> XyzBlocks::places() const {
  std::array<std::size_t, 3> found{0, std::min<std::size_t>(1, columns_ - 1),
                                   std::min<std::size_t>(2, columns_ - 1)};
  constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
  for (std::size_t k = 0; k < names_.size(); ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (names_[k] == kNames[axis]) found[axis] = k;
    }
  }
  return found;
}

/// Decides on the types: coordinates are double, because coordinates of maps have more digits than
/// a float, as are columns of many digits, such as times. Colours are sRGB codes of 8 or 16 bits if
/// all their values are whole numbers that fit, but not 0 and 1 alone, else linear light.
void XyzBlocks::lay_out() {
  ValueFacts colors;
  for (std::size_t k = 0; k < columns_; ++k) {
    if (!is_color(k)) continue;
    colors.largest = std::max(colors.largest, all_.columns[k].largest);
    colors.codes = colors.codes && all_.columns[k].codes;
  }
  ScalarType color = ScalarType::kFloat32;
  if (!linear_ && colors.largest <= 65535) {
    if (colors.codes && colors.largest != 1) {
      color = colors.largest <= 255 ? ScalarType::kUint8 : ScalarType::kUint16;
    } else {
      white_ = colors.largest <= 1 ? 1 : colors.largest <= 255 ? 255 : 65535;
    }
  }
  for (std::size_t k = 0; k < columns_; ++k) {
    if (given_ && names_[k] == "-") continue;
    const ScalarType number =
        all_.columns[k].in_float ? ScalarType::kFloat32 : ScalarType::kFloat64;
    const ScalarType type = is_place(k) ? ScalarType::kFloat64 : is_color(k) ? color : number;
    layout_.push_back({names_[k], type, stride_});
    from_.push_back(k);
    colors_.push_back(is_color(k));
    stride_ += scalar_size(type);
  }
}

const std::byte* XyzBlocks::read(std::size_t block, Array<std::byte>& scratch) const {
  const std::size_t count = first_[block + 1] - first_[block];
  if (scratch.size() < count * stride_) scratch.resize(count * stride_);
  std::size_t rows = 0;
  const auto fail_changed = [&] {
    throw_input(file_.name(), "was changed while it was read; read it again");
  };
  for_rows(
      block,
      [&](const std::vector<double>& values) {
        if (rows == count) fail_changed();
        std::byte* const record = scratch.data() + rows++ * stride_;
        for (std::size_t c = 0; c < layout_.size(); ++c) {
          double value = values[from_[c]];
          if (white_ > 0 && colors_[c]) {
            value = static_cast<double>(srgb_to_linear(static_cast<float>(value / white_)));
          }
          visit_type(layout_[c].type, [&]<class T>(T) {
            const T stored = static_cast<T>(value);
            std::memcpy(record + layout_[c].offset, &stored, sizeof(T));
          });
        }
      },
      [](std::size_t, std::string_view) {});
  if (rows != count) fail_changed();
  return scratch.data();
}

RecordTable XyzBlocks::table() const {
  RecordTable table;
  table.blocks = this;
  table.count = all_.rows;
  table.stride = stride_;
  table.columns = layout_;
  if (!all_.box.empty()) table.said_bounds = all_.box;
  return table;
}

}  // namespace

bool is_xyz_name(const std::string& path) {
  constexpr std::array<std::string_view, 7> kTextExtensions{".xyz", ".txt",  ".pts",   ".asc",
                                                            ".csv", ".xyzn", ".xyzrgb"};
  const std::string extension = lower_extension(path);
  return std::find(kTextExtensions.begin(), kTextExtensions.end(), extension) !=
         kTextExtensions.end();
}

struct XyzPoints::Impl {
  InputFile input;
  XyzBlocks blocks;
  RecordTable table;

  Impl(InputFile file, const std::vector<std::string>& columns)
      : input(std::move(file)), blocks(input, columns), table(blocks.table()) {}
};

XyzPoints::XyzPoints(InputFile file, const std::vector<std::string>& columns)
    : impl_(std::make_unique<Impl>(std::move(file), columns)) {}
XyzPoints::~XyzPoints() = default;

const RecordTable& XyzPoints::table() const { return impl_->table; }
const std::string& XyzPoints::file() const { return impl_->input.name(); }

}  // namespace surfel
