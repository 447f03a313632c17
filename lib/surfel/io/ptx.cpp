#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/promises.h>
#include <surfel/io/ptx.h>
#include <surfel/io/record_table.h>
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

class PtxReader {
 public:
  explicit PtxReader(const InputFile& file)
      : name_(file.name()), in_(name_, as_text(file.bytes()), {.separators = " \t"}) {}

  SurfelCloud read() {
    while (in_.skip_to_content()) read_scan();
    if (views_.empty()) throw_input(name_, "holds no scans");
    if (points_.empty()) {
      throw_input(
          name_, fmt::format("none of its {} points was measured, as it says itself", unmeasured_));
    }
    SurfelCloud cloud = to_cloud();
    cloud.unmeasured_skipped = unmeasured_;
    const auto known = [](const std::optional<Viewpoint>& view) { return view.has_value(); };
    if (!std::all_of(views_.begin(), views_.end(), known)) return cloud;
    if (views_.size() == 1) {
      cloud.viewpoint = views_.front();
    } else {
      for (const auto& view : views_) cloud.scan_viewpoints.push_back(*view);
    }
    return cloud;
  }

 private:
  static constexpr std::size_t kShortestLine = 8;  // "0 0 0 0\n"

  /// Splits the next line that holds something into words_; `what` names what it holds.
  void next_words(const std::string& what) {
    if (!in_.skip_to_content()) {
      throw_input(name_, fmt::format("the file ends before {}; it is truncated", what));
    }
    in_.rest_of_words(words_);
  }

  double number(std::size_t word) const {
    const std::optional<double> value = parse_number(words_[word]);
    if (!value && words_[word].find(',') != std::string_view::npos) {
      in_.fail(quoted_excerpt(words_[word]) + kDecimalCommas);
    }
    if (!value) in_.fail(quoted_excerpt(words_[word]) + " is not a number");
    return *value;
  }

  std::uint64_t read_count(const std::string& what) {
    next_words(what);
    const std::optional<std::size_t> count = parse_count(words_[0]);
    if (words_.size() != 1 || !count || *count == 0) {
      in_.fail(fmt::format("{} is not {}; a scan begins with two lines of one number each",
                           quoted_excerpt(words_[0]), what));
    }
    return *count;
  }

  /// Reads a line of the header into a row of a matrix.
  template <class Row>
  void read_row(Row&& row, const std::string& what) {
    next_words(what);
    if (words_.size() != static_cast<std::size_t>(row.size())) {
      in_.fail(fmt::format("{} values, where {} has {}", words_.size(), what, row.size()));
    }
    for (Eigen::Index k = 0; k < row.size(); ++k) {
      row[k] = number(static_cast<std::size_t>(k));
      if (!std::isfinite(row[k])) in_.fail(what + " is not finite");
    }
  }

  void read_scan() {
    require_few(views_.size() + 1, "scans", [&](const std::string& text) { in_.fail(text); });
    const std::string scan = fmt::format("scan {}", views_.size() + 1);
    const std::uint64_t columns = read_count("the number of columns of " + scan);
    const std::uint64_t rows = read_count("the number of rows of " + scan);
    const auto room = [&](std::uint64_t count, std::uint64_t least, const char* things) {
      require_room(
          count, least, in_.remaining() + 1, [&] { return scan; }, things,
          [&](const std::string& message) { in_.fail(message); });
    };
    room(columns, kShortestLine, "columns");
    // The product of both fits into 64 bits where one of them is below the file's size.
    room(rows, columns * kShortestLine, "rows");
    Vec3d scanner;
    Eigen::Matrix3d axes;
    Eigen::Matrix4d matrix;
    read_row(scanner, "the scanner's place of " + scan);
    for (int k = 0; k < 3; ++k) read_row(axes.row(k), "the axes of " + scan);
    for (int k = 0; k < 4; ++k) read_row(matrix.row(k), "the matrix of " + scan);
    note_viewpoint(scanner, matrix, columns > 1 && rows > 1);
    read_points(columns, rows, matrix, scan);
  }

  void note_viewpoint(const Vec3d& scanner, const Eigen::Matrix4d& matrix, bool grid) {
    std::optional<Viewpoint>& view = views_.emplace_back();
    if (matrix.isIdentity(0)) {
      if (grid || !scanner.isZero(0)) view = Viewpoint{.position = scanner};
      return;
    }
    view.emplace().position = matrix.block<1, 3>(3, 0).transpose();
    const Eigen::Matrix3d turn = matrix.block<3, 3>(0, 0).transpose();
    constexpr double kRounding = 1e-3;  // Files have six digits, or fewer.
    if ((turn * turn.transpose()).isIdentity(kRounding) && turn.determinant() > 0) {
      const Eigen::Quaterniond q(turn);
      view->orientation = Vec4d(q.w(), q.x(), q.y(), q.z()).normalized();
    }
  }

  void read_points(std::uint64_t columns, std::uint64_t rows, const Eigen::Matrix4d& matrix,
                   const std::string& scan) {
    std::size_t values = 0;
    for (std::uint64_t c = 0; c < columns; ++c) {
      for (std::uint64_t r = 0; r < rows; ++r) {
        if (!in_.skip_to_content()) {
          throw_input(name_, fmt::format("{} has {} of {} points; it is truncated", scan,
                                         c * rows + r, columns * rows));
        }
        in_.rest_of_words(words_);
        if (values == 0) values = words_.size();
        if (words_.size() != values || (values != 4 && values != 7)) {
          in_.fail(
              fmt::format("{} values; the points of a scan all have 4 (x y z intensity) or "
                          "all have 7 (and r g b)",
                          words_.size()));
        }
        add_point(matrix, static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(c));
      }
    }
  }

  void add_point(const Eigen::Matrix4d& matrix, std::uint32_t row, std::uint32_t column) {
    const Vec3d own(number(0), number(1), number(2));
    if (own.isZero(0)) {
      ++unmeasured_;
      return;
    }
    const Vec3d place = (own.transpose() * matrix.block<3, 3>(0, 0) + matrix.block<1, 3>(3, 0));
    static const std::uint8_t gray = linear_to_srgb8(SurfelCloud::colorless()[0]);
    PtxPoint point{.place = {place[0], place[1], place[2]},
                   .intensity = static_cast<float>(number(3)),
                   .row = row,
                   .column = column,
                   .scan = static_cast<std::uint16_t>(views_.size() - 1),
                   .color = {gray, gray, gray}};
    if (words_.size() == 7) {
      colored_ = true;
      for (std::size_t k = 0; k < 3; ++k) {
        const double code = number(4 + k);
        if (!representable<std::uint8_t>(code)) {
          in_.fail(quoted_excerpt(words_[4 + k]) + " is no colour; colours are whole, 0 to 255");
        }
        point.color[k] = static_cast<std::uint8_t>(code);
      }
    }
    points_.push_back(point);
  }

  SurfelCloud to_cloud() const {
    RecordTable table;
    table.data = reinterpret_cast<const std::byte*>(points_.data());
    table.count = points_.size();
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
    for (std::size_t k = 0; k < 3 && colored_; ++k) {
      add(kColor[k], ScalarType::kUint8, offsetof(PtxPoint, color) + k);
    }
    add("row_index", ScalarType::kUint32, offsetof(PtxPoint, row));
    add("column_index", ScalarType::kUint32, offsetof(PtxPoint, column));
    if (views_.size() > 1) add("scan", ScalarType::kUint16, offsetof(PtxPoint, scan));
    return cloud_from_records(table, name_, true);
  }

  const std::string name_;
  TextScanner in_;
  std::vector<std::string_view> words_;
  Array<PtxPoint> points_;
  std::vector<std::optional<Viewpoint>> views_;  ///< Of the scans.
  std::size_t unmeasured_ = 0;
  bool colored_ = false;
};

}  // namespace

bool is_ptx_name(const std::string& path) { return lower_extension(path) == ".ptx"; }

SurfelCloud read_ptx(const InputFile& file) { return PtxReader(file).read(); }

}  // namespace surfel
