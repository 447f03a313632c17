// The PCD file format, https://pointclouds.org/documentation/tutorials/pcd_file_format.html

#include <algorithm>
#include <bit>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/plugin.h>
#include <surfel/io/pcd.h>
#include <surfel/io/pcd_plugin.h>
#include <surfel/io/promises.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::string_view kKeywords[] = {"VERSION",   "FIELDS", "COLUMNS", "SIZE",
                                          "TYPE",      "COUNT",  "WIDTH",   "HEIGHT",
                                          "VIEWPOINT", "POINTS", "DATA"};

bool is_keyword(std::string_view word) {
  return std::find(std::begin(kKeywords), std::end(kKeywords), word) != std::end(kKeywords);
}

/// The column type of a field; nullopt for 64-bit integers, which have none, and for nonsense.
std::optional<ScalarType> scalar_type(char type, std::size_t size) {
  if (type == 'F' && size == 4) return ScalarType::kFloat32;
  if (type == 'F' && size == 8) return ScalarType::kFloat64;
  if (type != 'I' && type != 'U') return std::nullopt;
  const bool is_signed = type == 'I';
  if (size == 1) return is_signed ? ScalarType::kInt8 : ScalarType::kUint8;
  if (size == 2) return is_signed ? ScalarType::kInt16 : ScalarType::kUint16;
  if (size == 4) return is_signed ? ScalarType::kInt32 : ScalarType::kUint32;
  return std::nullopt;
}

bool is_wide_integer(char type, std::size_t size) {
  return (type == 'I' || type == 'U') && size == 8;
}

}  // namespace

/// Fills a PcdFile from its header.
class PcdHeaderParser {
 public:
  explicit PcdHeaderParser(PcdFile& pcd)
      : pcd_(pcd), in_(pcd.file_.name(), pcd.file_.header("DATA"), kHeaderText) {}

  void parse() {
    if (in_.at_end()) throw_input(pcd_.file_.name(), "is empty; make it anew");
    for (; !ended_; in_.next_line()) {
      if (!in_.skip_to_content()) {
        in_.fail("the header ends without 'DATA'; the file is truncated or is no PCD file");
      }
      parse_line();
    }
    pcd_.body_begin_ = in_.position();
    check();
  }

 private:
  void parse_line() {
    if (in_.skip('#')) {
      const std::string_view comment = in_.rest_of_line();
      if (!comment.starts_with(".PCD")) pcd_.comments_.emplace_back(comment);
      return;
    }
    const std::string_view keyword = in_.word();
    if (!is_keyword(keyword)) {
      in_.fail(fmt::format("{} is not a word of PCD headers", quoted_excerpt(keyword)));
    }
    std::vector<std::string_view> values;
    in_.rest_of_words(values);
    parse_entry(keyword, values);
  }

  void parse_entry(std::string_view keyword, std::span<const std::string_view> values) {
    if (values.empty()) in_.fail(fmt::format("{} has no value", keyword));
    if (keyword == "FIELDS" || keyword == "COLUMNS") {
      if (!pcd_.fields_.empty()) in_.fail("the fields are named twice");
      check_few(values.size());
      for (const std::string_view name : values) pcd_.fields_.push_back({std::string(name)});
    } else if (keyword == "SIZE" || keyword == "TYPE" || keyword == "COUNT") {
      parse_field_entry(keyword, values);
    } else if (keyword == "WIDTH") {
      width_ = count(values[0]);
    } else if (keyword == "HEIGHT") {
      height_ = count(values[0]);
    } else if (keyword == "POINTS") {
      points_ = count(values[0]);
    } else if (keyword == "VIEWPOINT") {
      parse_viewpoint(values);
    } else if (keyword == "DATA") {
      parse_body_kind(values[0]);
    }
  }

  void parse_field_entry(std::string_view keyword, std::span<const std::string_view> values) {
    if (values.size() != pcd_.fields_.size()) {
      in_.fail(fmt::format("{} has {} values for {} fields", keyword, values.size(),
                           pcd_.fields_.size()));
    }
    for (std::size_t k = 0; k < values.size(); ++k) {
      PcdFile::Field& field = pcd_.fields_[k];
      if (keyword == "SIZE") field.size = count(values[k]);
      if (keyword == "COUNT") field.count = count(values[k]);
      if (keyword == "TYPE") field.type = values[k].size() == 1 ? values[k][0] : '?';
    }
  }

  void parse_viewpoint(std::span<const std::string_view> values) {
    if (values.size() != 7) in_.fail("VIEWPOINT needs seven numbers: tx ty tz qw qx qy qz");
    double numbers[7];
    for (int k = 0; k < 7; ++k) {
      const auto number = parse_number(values[k]);
      if (!number) in_.fail(fmt::format("{} is not a number", quoted_excerpt(values[k])));
      numbers[k] = *number;
    }
    pcd_.viewpoint_ = Viewpoint{Vec3d(numbers), Eigen::Vector4d(numbers + 3)};
  }

  void parse_body_kind(std::string_view kind) {
    if (kind == "ascii") {
      pcd_.body_ = PcdFile::Body::kAscii;
    } else if (kind == "binary") {
      pcd_.body_ = PcdFile::Body::kBinary;
    } else if (kind == "binary_compressed") {
      pcd_.body_ = PcdFile::Body::kCompressed;
    } else {
      in_.fail(
          fmt::format("DATA {} is none of ascii, binary, binary_compressed", quoted_excerpt(kind)));
    }
    ended_ = true;
  }

  void check_few(std::size_t columns) const {
    require_few(columns, "fields", [this](const std::string& message) { in_.fail(message); });
  }

  std::size_t count(std::string_view word) const {
    const auto value = parse_count(word);
    if (!value) in_.fail(fmt::format("{} is not a count", quoted_excerpt(word)));
    return *value;
  }

  void check() {
    if (pcd_.fields_.empty()) in_.fail("the header names no FIELDS");
    check_fields();
    check_count();
  }

  void check_fields() const {
    std::size_t record = 0;
    std::size_t columns = 0;
    for (const PcdFile::Field& field : pcd_.fields_) {
      const bool padding = field.name == "_";
      if (!padding && !scalar_type(field.type, field.size) &&
          !is_wide_integer(field.type, field.size)) {
        in_.fail(
            fmt::format("field {} has the unknown TYPE {} of SIZE {}; known are F of 4 or 8 bytes, "
                        "I and U of 1, 2, 4 or 8",
                        field.name, field.type ? field.type : '?', field.size));
      }
      // Bytes of a record; real ones have hundreds.
      constexpr std::size_t kMost = std::size_t{1} << 20;
      record += std::min(kMost, field.size) * std::min(kMost, field.count);
      if (field.size == 0 || field.count == 0 || record > kMost) {
        in_.fail(
            fmt::format("field {} has {} values of {} bytes", field.name, field.count, field.size));
      }
      columns += field.count;
      check_few(columns);
      const auto same = [&](const PcdFile::Field& f) { return f.name == field.name; };
      if (!padding && std::count_if(pcd_.fields_.begin(), pcd_.fields_.end(), same) > 1) {
        in_.fail("field " + field.name + " stands there twice");
      }
    }
  }

  void check_count() {
    if (!points_ && !width_) in_.fail("the header has neither POINTS nor WIDTH");
    const std::size_t width = width_.value_or(points_.value_or(0));
    const std::size_t height = height_.value_or(1);
    // Points in rows were seen by a sensor, which may well be in the origin; of others the default
    // tells nothing.
    if (height == 1 && pcd_.viewpoint_ && is_default(*pcd_.viewpoint_)) pcd_.viewpoint_.reset();
    std::size_t product = 0;
    if (__builtin_mul_overflow(width, height, &product) || product != points_.value_or(product)) {
      in_.fail(fmt::format("WIDTH {} times HEIGHT {} is not POINTS {}", width, height,
                           points_.value_or(0)));
    }
    pcd_.table_.count = product;
  }

  PcdFile& pcd_;
  TextScanner in_;
  bool ended_ = false;
  std::optional<std::size_t> width_;
  std::optional<std::size_t> height_;
  std::optional<std::size_t> points_;
};

PcdFile::PcdFile(InputFile file) : file_(std::move(file)) {
  PcdHeaderParser(*this).parse();
  for (const Field& field : fields_) {
    const bool coordinate = field.name == "x" || field.name == "X";
    if (coordinate) double_positions_ = field.type == 'F' && field.size == 8;
  }
  add_columns();
  switch (body_) {
    case Body::kAscii:
      read_ascii();
      break;
    case Body::kBinary:
      read_binary();
      break;
    case Body::kCompressed:
      read_compressed();
      break;
  }
  if (body_ != Body::kAscii) convert_wide_integers();
  unpack_colors();
}

bool PcdFile::matches(std::span<const std::byte> bytes) {
  TextScanner in({}, as_text(bytes).substr(0, kMatched), kHeaderText);
  for (; in.skip_to_content(); in.next_line()) {
    const std::string_view first = in.word();
    if (!first.starts_with('#')) return is_keyword(first);
    if (in.word() == ".PCD") return true;
  }
  return false;
}

/// Lays out the records: as binary files have them, or (text) one value after the other with
/// coordinates as double.
void PcdFile::add_columns() {
  for (const Field& field : fields_) {
    const bool wide_text = body_ == Body::kAscii && field.name.size() == 1 && field.type == 'F' &&
                           std::string_view("xyzXYZ").find(field.name) != std::string::npos;
    const ScalarType type =
        wide_text ? ScalarType::kFloat64
                  : scalar_type(field.type, field.size).value_or(ScalarType::kFloat64);
    const std::size_t size = wide_text ? scalar_size(type) : field.size;
    for (std::size_t k = 0; k < field.count; ++k) {
      const std::string name = field.count == 1 ? field.name : fmt::format("{}_{}", field.name, k);
      if (field.name != "_") table_.columns.push_back({name, type, table_.stride});
      table_.stride += size;
    }
  }
}

void PcdFile::check_room(std::size_t least_bytes, std::size_t bytes) const {
  require_room(table_.count, least_bytes, bytes, kTheHeader, "points",
               [&](const std::string& message) { throw_input(file_.name(), message); });
}

void PcdFile::read_ascii() {
  std::size_t values = 0;
  for (const Field& field : fields_) values += field.count;
  // A value is a character and a separator, which the last one does not need.
  check_room(2 * values, file_.size() - body_begin_ + 1);
  storage_.resize(table_.count * table_.stride);
  table_.data = storage_.data();
  TextScanner text(file_.name(), as_text(file_.bytes()), {}, body_begin_);
  for (std::size_t row = 0; row < table_.count; ++row) {
    const auto what = [&] { return fmt::format("point {}", row); };
    std::byte* record = storage_.data() + row * table_.stride;
    auto column = table_.columns.begin();
    for (const Field& field : fields_) {
      for (std::size_t k = 0; k < field.count; ++k) {
        if (field.name == "_") {
          text.skip_to_content();
          text.word();
        } else {
          text.read(column->type, record + column->offset, what);
          ++column;
        }
      }
    }
    text.expect_line_end(what);
  }
}

void PcdFile::read_binary() {
  check_room(table_.stride, file_.size() - body_begin_);
  table_.file = &file_;
  table_.offset = body_begin_;
}

void PcdFile::read_compressed() {
  const auto body = file_.bytes().subspan(body_begin_);
  std::uint32_t sizes[2] = {0, 0};  // Compressed, uncompressed.
  if (body.size() >= sizeof(sizes)) std::memcpy(sizes, body.data(), sizeof(sizes));
  if (body.size() < sizeof(sizes) || body.size() - sizeof(sizes) < sizes[0]) {
    throw_input(file_.name(), "the compressed points are truncated");
  }
  // LZF spends three bytes on at most 264.
  constexpr std::uint64_t kBestRatio = 88;
  const bool too_many = table_.count > sizes[1] / table_.stride;
  if (too_many || table_.count * table_.stride != sizes[1] || sizes[1] > kBestRatio * sizes[0]) {
    throw_input(file_.name(),
                fmt::format("the header promises {} points of {} bytes, the {} compressed "
                            "bytes are said to hold {}; it is damaged",
                            table_.count, table_.stride, sizes[0], sizes[1]));
  }
  if (table_.count == 0) return;
  if (!has_plugin("pcd")) {
    throw_input(file_.name(), "its points are compressed, which needs a plug-in; " +
                                  plugin_advice("pcd") + ", or save the file with DATA binary");
  }
  PcdDecompression work{reinterpret_cast<const unsigned char*>(file_.bytes().data()), body_begin_};
  const auto decompress =
      reinterpret_cast<PcdDecompress>(plugin_symbol("pcd", "surfel_pcd_decompress"));
  if (!decompress(work) || work.stride != table_.stride || work.records.size() != sizes[1]) {
    throw_input(file_.name(), "the compressed points are damaged");
  }
  storage_.resize(work.records.size());
  std::memcpy(storage_.data(), work.records.data(), work.records.size());
  table_.data = storage_.data();
}

/// 64-bit integers to doubles, in place.
void PcdFile::convert_wide_integers() {
  std::size_t offset = 0;
  for (const Field& field : fields_) {
    const bool convert = is_wide_integer(field.type, field.size) && field.name != "_";
    if (convert && storage_.empty() && table_.count > 0) {
      const std::byte* from = table_.read(0, table_.count, storage_);
      if (storage_.empty()) storage_.assign(from, from + table_.count * table_.stride);
      table_.file = nullptr;
      table_.data = storage_.data();
    }
    for (std::size_t k = 0; k < field.count; ++k, offset += field.size) {
      for (std::size_t row = 0; convert && row < table_.count; ++row) {
        std::byte* at = storage_.data() + row * table_.stride + offset;
        const auto bits = load_scalar<double, false>(at);
        const double value = field.type == 'I'
                                 ? static_cast<double>(std::bit_cast<std::int64_t>(bits))
                                 : static_cast<double>(std::bit_cast<std::uint64_t>(bits));
        std::memcpy(at, &value, sizeof(value));
      }
    }
  }
}

/// The bytes of a packed colour, whatever its declared type, are columns of their own.
void PcdFile::unpack_colors() {
  if (table_.find("red")) return;
  for (const char* name : {"rgb", "rgba"}) {
    const RecordColumn* found = table_.find(name);
    if (!found || scalar_size(found->type) != sizeof(std::uint32_t)) continue;
    const RecordColumn packed = *found;
    table_.columns.erase(table_.columns.begin() + (found - table_.columns.data()));
    // Bits 16-23 are red, 8-15 green, 0-7 blue, 24-31 alpha.
    const auto add_byte = [&](const char* channel, std::size_t byte) {
      const std::size_t place = std::endian::native == std::endian::little ? byte : 3 - byte;
      table_.columns.push_back({channel, ScalarType::kUint8, packed.offset + place});
    };
    add_byte("red", 2);
    add_byte("green", 1);
    add_byte("blue", 0);
    if (packed.name == "rgb" || table_.find("alpha")) return;
    add_byte("alpha", 3);
    constexpr std::size_t kBlock = 4096;  // Records that are read at a time.
    Array<std::byte> scratch;
    bool any = false;
    for (std::size_t begin = 0; begin < table_.count && !any; begin += kBlock) {
      const std::size_t end = std::min(begin + kBlock, table_.count);
      const std::byte* alpha = table_.read(begin, end, scratch) + table_.columns.back().offset;
      for (std::size_t row = begin; row < end; ++row, alpha += table_.stride) {
        any |= *alpha != std::byte{0};
      }
    }
    if (!any) table_.columns.pop_back();
    return;
  }
}

std::string pcd_header(const std::vector<RecordColumn>& columns, std::size_t count,
                       const std::optional<Viewpoint>& viewpoint,
                       const std::vector<std::string>& comments) {
  std::string fields = "FIELDS";
  std::string sizes = "\nSIZE";
  std::string types = "\nTYPE";
  std::string counts = "\nCOUNT";
  for (const RecordColumn& column : columns) {
    const bool floating = column.type >= ScalarType::kFloat32;
    const bool is_unsigned = column.type == ScalarType::kUint8 ||
                             column.type == ScalarType::kUint16 ||
                             column.type == ScalarType::kUint32;
    fields += " " + column.name;
    sizes += fmt::format(" {}", scalar_size(column.type));
    types += floating ? " F" : is_unsigned ? " U" : " I";
    counts += " 1";
  }
  std::string header = "# .PCD v0.7 - Point Cloud Data file format\n";
  for (const std::string& comment : comments) header += "# " + comment + "\n";
  const Viewpoint view = viewpoint.value_or(Viewpoint{});
  const Vec3d& t = view.position;
  const Vec4d& q = view.orientation;
  return header + "VERSION 0.7\n" + fields + sizes + types + counts +
         fmt::format(
             "\nWIDTH {}\nHEIGHT 1\nVIEWPOINT {} {} {} {} {} {} {}\nPOINTS {}\nDATA binary\n",
             count, t[0], t[1], t[2], q[0], q[1], q[2], q[3], count);
}

}  // namespace surfel
