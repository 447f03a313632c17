#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/io/promises.h>
#include <surfel/io/ptx.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_blocks.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

/// A point as it is kept, and the columns that are made of it.
struct PtxPoint {
  double place[3];
  float intensity;
  std::uint32_t row;
  std::uint32_t column;
  std::uint16_t scan;
  std::uint8_t color[3];
};

constexpr TextFormat kPtxText{.separators = " \t"};
constexpr std::size_t kShortestPtxLine = 8;  // "0 0 0 0\n"

using Words = std::vector<std::string_view>;

/// The lines of a text that hold something, one after the other. Blocks all of whose lines are
/// skipped are not read.
class LineCursor {
 public:
  /// \param lines  how many lines of each block hold something
  LineCursor(const TextBlocks& text, std::vector<std::uint64_t> lines)
      : text_(text), lines_(std::move(lines)) {}

  bool at_end() {
    for (; block_ < lines_.size() && line_ == lines_[block_]; ++block_) {
      line_ = 0;
      in_.reset();
    }
    return block_ == lines_.size();
  }
  /// Splits the next line into words and goes behind it. There is one, as for all that follow.
  void take(Words& words) {
    line().rest_of_words(words);
    ++line_;
  }
  /// Splits the next line into words.
  void peek(Words& words) { TextScanner(line()).rest_of_words(words); }
  /// Offset behind the words of the line that was taken last.
  std::size_t taken() const { return text_.begin(block_) + in_->position(); }
  /// Offset of the next line's first word.
  std::size_t offset() { return text_.begin(block_) + line().position(); }
  /// Offset behind the block of the next line.
  std::size_t block_end() const { return text_.begin(block_ + 1); }
  /// How many lines are left in the block of the next one.
  std::uint64_t left() const { return lines_[block_] - line_; }
  /// Skips lines of the block.
  void skip(std::uint64_t lines) {
    line_ += lines;
    if (line_ == lines_[block_]) return;
    for (; lines > 0; --lines) {
      in_->skip_to_content();
      in_->next_line();
    }
  }
  /// Throws Error(kInput) that names the line that was taken last.
  [[noreturn]] void fail(const std::string& message) const { in_->fail(message); }

 private:
  TextScanner& line() {
    if (!in_) in_.emplace(text_.scan(text_.begin(block_), block_end(), scratch_));
    in_->skip_to_content();
    return *in_;
  }

  const TextBlocks& text_;
  std::vector<std::uint64_t> lines_;
  std::size_t block_ = 0;
  std::uint64_t line_ = 0;  ///< Of the block's lines the next one.
  std::optional<TextScanner> in_;
  Array<std::byte> scratch_;
};

/// What the header of a scan says.
struct PtxScan {
  std::uint64_t rows = 0;
  std::size_t values = 0;  ///< Of each point.
  Eigen::Matrix4d matrix;
  std::optional<Viewpoint> view;
};

/// Points of a scan whose lines are in one block of the text.
struct PtxLines {
  std::size_t scan;
  std::uint64_t point;  ///< The number of the first one in the scan.
  std::uint64_t count;
  std::size_t begin;  ///< Offset of the first line.
  std::size_t end;    ///< Offset behind the last line, or farther.
};

template <class Text>
double number(const Text& in, std::string_view word) {
  const std::optional<double> value = parse_number(word);
  if (!value && word.find(',') != std::string_view::npos) {
    in.fail(quoted_excerpt(word) + kDecimalCommas);
  }
  if (!value) in.fail(quoted_excerpt(word) + " is not a number");
  return *value;
}

/// The points of all scans as records, which are made of the text block by block. The constructor
/// reads all of the text: where lines are, and how many points were measured.
class PtxBlocks final : public RecordBlocks {
 public:
  explicit PtxBlocks(const InputFile& file);

  std::size_t blocks() const override { return lines_.size(); }
  std::size_t first(std::size_t block) const override { return first_[block]; }
  const std::byte* read(std::size_t block, Array<std::byte>& scratch) const override;

  RecordTable table() const;
  std::size_t unmeasured() const { return unmeasured_; }
  const std::vector<PtxScan>& scans() const { return scans_; }

 private:
  void next_words(const std::string& what);
  std::uint64_t read_count(const std::string& what);
  template <class Row>
  void read_row(Row&& row, const std::string& what);
  void read_scan();
  void find_points(std::uint64_t count, const std::string& scan);
  std::size_t make_points(const PtxLines& lines, std::byte* to) const;

  const InputFile& file_;
  TextBlocks text_;
  std::optional<LineCursor> cursor_;
  Words words_;
  std::vector<PtxScan> scans_;
  std::vector<PtxLines> lines_;
  std::vector<std::size_t> first_;  ///< Points that were measured before each block.
  std::size_t unmeasured_ = 0;
};

PtxBlocks::PtxBlocks(const InputFile& file) : file_(file), text_(file, kPtxText) {
  std::vector<std::uint64_t> lines(text_.size());
  PerWorker<Array<std::byte>> buffers;
  parallel_for(text_.size(), 1, [&](std::size_t block, std::size_t, int worker) {
    TextScanner in = text_.scan(text_.begin(block), text_.begin(block + 1), buffers[worker]);
    for (; in.skip_to_content(); in.next_line()) ++lines[block];
  });
  cursor_.emplace(text_, std::move(lines));
  while (!cursor_->at_end()) read_scan();
  cursor_.reset();
  if (scans_.empty()) throw_input(file.name(), "holds no scans");

  std::vector<std::size_t> measured(lines_.size());
  {
    ProgressStage stage("looking through " + file.name(), file.size(), "B");
    parallel_for(lines_.size(), 1, [&](std::size_t block, std::size_t, int worker) {
      Array<std::byte>& points = buffers[worker];
      points.resize(lines_[block].count * sizeof(PtxPoint));
      measured[block] = make_points(lines_[block], points.data());
      stage.add(lines_[block].end - lines_[block].begin);
    });
  }
  first_.push_back(0);
  for (std::size_t block = 0; block < lines_.size(); ++block) {
    first_.push_back(first_.back() + measured[block]);
    unmeasured_ += lines_[block].count - measured[block];
  }
  if (first_.back() == 0) {
    throw_input(file.name(),
                fmt::format("none of its {} points was measured, as it says itself", unmeasured_));
  }
}

/// Splits the next line into words_; `what` names what it holds.
void PtxBlocks::next_words(const std::string& what) {
  if (cursor_->at_end()) {
    throw_input(file_.name(), fmt::format("the file ends before {}; it is truncated", what));
  }
  cursor_->take(words_);
}

std::uint64_t PtxBlocks::read_count(const std::string& what) {
  next_words(what);
  const std::optional<std::size_t> count = parse_count(words_[0]);
  if (words_.size() != 1 || !count || *count == 0) {
    cursor_->fail(fmt::format("{} is not {}; a scan begins with two lines of one number each",
                              quoted_excerpt(words_[0]), what));
  }
  return *count;
}

/// Reads a line of the header into a row of a matrix.
template <class Row>
void PtxBlocks::read_row(Row&& row, const std::string& what) {
  next_words(what);
  if (words_.size() != static_cast<std::size_t>(row.size())) {
    cursor_->fail(fmt::format("{} values, where {} has {}", words_.size(), what, row.size()));
  }
  for (Eigen::Index k = 0; k < row.size(); ++k) {
    row[k] = number(*cursor_, words_[static_cast<std::size_t>(k)]);
    if (!std::isfinite(row[k])) cursor_->fail(what + " is not finite");
  }
}

std::optional<Viewpoint> ptx_viewpoint(const Vec3d& scanner, const Eigen::Matrix4d& matrix,
                                       bool grid) {
  if (matrix.isIdentity(0)) {
    if (grid || !scanner.isZero(0)) return Viewpoint{.position = scanner};
    return std::nullopt;
  }
  Viewpoint view{.position = matrix.block<1, 3>(3, 0).transpose()};
  const Eigen::Matrix3d turn = matrix.block<3, 3>(0, 0).transpose();
  constexpr double kRounding = 1e-3;  // Files have six digits, or fewer.
  if ((turn * turn.transpose()).isIdentity(kRounding) && turn.determinant() > 0) {
    const Eigen::Quaterniond q(turn);
    view.orientation = Vec4d(q.w(), q.x(), q.y(), q.z()).normalized();
  }
  return view;
}

void PtxBlocks::read_scan() {
  const auto fails = [&](const std::string& message) { cursor_->fail(message); };
  const std::string scan = fmt::format("scan {}", scans_.size() + 1);
  const std::uint64_t columns = read_count("the number of columns of " + scan);
  require_few(scans_.size() + 1, "scans", fails);
  const std::uint64_t rows = read_count("the number of rows of " + scan);
  // The last line need not have an end.
  const std::size_t left = file_.size() - cursor_->taken() + 1;
  const auto room = [&](std::uint64_t count, std::uint64_t least, const char* things) {
    require_room(
        count, least, left, [&] { return scan; }, things, fails);
  };
  room(columns, kShortestPtxLine, "columns");
  // The product of both fits into 64 bits where one of them is below the file's size.
  room(rows, columns * kShortestPtxLine, "rows");
  Vec3d scanner;
  Eigen::Matrix3d axes;
  PtxScan& made = scans_.emplace_back();
  read_row(scanner, "the scanner's place of " + scan);
  for (int k = 0; k < 3; ++k) read_row(axes.row(k), "the axes of " + scan);
  for (int k = 0; k < 4; ++k) read_row(made.matrix.row(k), "the matrix of " + scan);
  made.rows = rows;
  made.view = ptx_viewpoint(scanner, made.matrix, columns > 1 && rows > 1);
  find_points(columns * rows, scan);
}

/// Notes where the lines of the last scan's points are, and goes behind them.
void PtxBlocks::find_points(std::uint64_t count, const std::string& scan) {
  for (std::uint64_t point = 0; point < count;) {
    if (cursor_->at_end()) {
      throw_input(file_.name(),
                  fmt::format("{} has {} of {} points; it is truncated", scan, point, count));
    }
    if (point == 0) {
      cursor_->peek(words_);
      scans_.back().values = words_.size();
    }
    PtxLines& lines = lines_.emplace_back();
    lines = {.scan = scans_.size() - 1,
             .point = point,
             .count = std::min(cursor_->left(), count - point),
             .begin = cursor_->offset(),
             .end = cursor_->block_end()};
    const bool whole = lines.count == cursor_->left();
    cursor_->skip(lines.count);
    if (!whole) lines.end = cursor_->offset();
    point += lines.count;
  }
}

/// Writes the points that were measured, and returns how many they are.
std::size_t PtxBlocks::make_points(const PtxLines& lines, std::byte* to) const {
  static thread_local Array<std::byte> text;
  static thread_local Words words;
  const PtxScan& scan = scans_[lines.scan];
  static const std::uint8_t gray = linear_to_srgb8(SurfelCloud::colorless()[0]);
  TextScanner in = text_.scan(lines.begin, lines.end, text);
  std::size_t made = 0;
  for (std::uint64_t i = 0; i < lines.count && in.skip_to_content(); ++i) {
    in.rest_of_words(words);
    if (words.size() != scan.values || (scan.values != 4 && scan.values != 7)) {
      in.fail(
          fmt::format("{} values; the points of a scan all have 4 (x y z intensity) or "
                      "all have 7 (and r g b)",
                      words.size()));
    }
    const Vec3d own(number(in, words[0]), number(in, words[1]), number(in, words[2]));
    if (own.isZero(0)) continue;
    const Vec3d place =
        own.transpose() * scan.matrix.block<3, 3>(0, 0) + scan.matrix.block<1, 3>(3, 0);
    const std::uint64_t at = lines.point + i;
    PtxPoint point{.place = {place[0], place[1], place[2]},
                   .intensity = static_cast<float>(number(in, words[3])),
                   .row = static_cast<std::uint32_t>(at % scan.rows),
                   .column = static_cast<std::uint32_t>(at / scan.rows),
                   .scan = static_cast<std::uint16_t>(lines.scan),
                   .color = {gray, gray, gray}};
    for (std::size_t k = 0; k < 3 && words.size() == 7; ++k) {
      const double code = number(in, words[4 + k]);
      if (!representable<std::uint8_t>(code)) {
        in.fail(quoted_excerpt(words[4 + k]) + " is no colour; colours are whole, 0 to 255");
      }
      point.color[k] = static_cast<std::uint8_t>(code);
    }
    std::memcpy(to + made++ * sizeof(PtxPoint), &point, sizeof(PtxPoint));
  }
  return made;
}

const std::byte* PtxBlocks::read(std::size_t block, Array<std::byte>& scratch) const {
  const std::size_t bytes = lines_[block].count * sizeof(PtxPoint);
  if (scratch.size() < bytes) scratch.resize(bytes);
  if (make_points(lines_[block], scratch.data()) != first_[block + 1] - first_[block]) {
    throw_input(file_.name(), "was changed while it was read; read it again");
  }
  return scratch.data();
}

RecordTable PtxBlocks::table() const {
  RecordTable table;
  table.blocks = this;
  table.count = first_.back();
  table.stride = sizeof(PtxPoint);
  const auto add = [&](const char* name, ScalarType type, std::size_t offset) {
    table.columns.push_back({name, type, offset});
  };
  constexpr std::array<const char*, 3> kPlace{"x", "y", "z"};
  constexpr std::array<const char*, 3> kColor{"red", "green", "blue"};
  for (std::size_t k = 0; k < 3; ++k) {
    add(kPlace[k], ScalarType::kFloat64, offsetof(PtxPoint, place) + k * sizeof(double));
  }
  add("intensity", ScalarType::kFloat32, offsetof(PtxPoint, intensity));
  const bool colored = std::any_of(scans_.begin(), scans_.end(),
                                   [](const PtxScan& scan) { return scan.values == 7; });
  for (std::size_t k = 0; k < 3 && colored; ++k) {
    add(kColor[k], ScalarType::kUint8, offsetof(PtxPoint, color) + k);
  }
  add("row_index", ScalarType::kUint32, offsetof(PtxPoint, row));
  add("column_index", ScalarType::kUint32, offsetof(PtxPoint, column));
  if (scans_.size() > 1) add("scan", ScalarType::kUint16, offsetof(PtxPoint, scan));
  return table;
}

}  // namespace

bool is_ptx_name(const std::string& path) { return lower_extension(path) == ".ptx"; }

struct PtxPoints::Impl {
  InputFile input;
  PtxBlocks blocks;
  RecordTable table;

  explicit Impl(InputFile file) : input(std::move(file)), blocks(input), table(blocks.table()) {}
};

PtxPoints::PtxPoints(InputFile file) : impl_(std::make_unique<Impl>(std::move(file))) {}
PtxPoints::~PtxPoints() = default;

const RecordTable& PtxPoints::table() const { return impl_->table; }
const std::string& PtxPoints::file() const { return impl_->input.name(); }

void PtxPoints::describe(SurfelCloud& cloud) const {
  cloud.unmeasured_skipped = impl_->blocks.unmeasured();
  std::vector<Viewpoint> views;
  for (const PtxScan& scan : impl_->blocks.scans()) {
    if (!scan.view) return;
    views.push_back(*scan.view);
  }
  if (views.size() == 1) {
    cloud.viewpoint = views.front();
  } else {
    cloud.scan_viewpoints = std::move(views);
  }
}

}  // namespace surfel
