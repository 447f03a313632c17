// The PLY polygon file format, G. Turk, 1994.

#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/ply.h>
#include <surfel/io/promises.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::size_t kPlyGrain = std::size_t{1} << 15;

std::optional<ScalarType> scalar_type(std::string_view name) {
  constexpr std::pair<std::string_view, ScalarType> kTypes[] = {
      {"char", ScalarType::kInt8},      {"int8", ScalarType::kInt8},
      {"uchar", ScalarType::kUint8},    {"uint8", ScalarType::kUint8},
      {"short", ScalarType::kInt16},    {"int16", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},  {"uint16", ScalarType::kUint16},
      {"int", ScalarType::kInt32},      {"int32", ScalarType::kInt32},
      {"uint", ScalarType::kUint32},    {"uint32", ScalarType::kUint32},
      {"float", ScalarType::kFloat32},  {"float32", ScalarType::kFloat32},
      {"double", ScalarType::kFloat64}, {"float64", ScalarType::kFloat64}};
  for (const auto& [known, type] : kTypes) {
    if (known == name) return type;
  }
  return std::nullopt;
}

/// Format of a header. A first line that ends in CR alone says that all header lines do.
TextFormat header_format(std::string_view text) {
  const std::size_t end = std::min(text.find_first_of("\r\n"), text.size());
  const std::string_view first = text.substr(end, 2);
  if (first.starts_with('\r') && first != "\r\n") return {.line_ends = "\r"};
  return kHeaderText;
}

/// Parses the header line by line; `body` is then the offset of the first record.
class HeaderParser {
 public:
  HeaderParser(const std::string& file, std::string_view text)
      : file_(file), in_(file, text, header_format(text)) {}

  PlyHeader parse() {
    if (in_.remaining() == 0) throw_input(file_, "is empty; make it anew");
    if (in_.rest_of_line() != "ply") {
      throw_input(file_, "is not a PLY file: it does not start with 'ply'");
    }
    for (bool ended = false; !ended; in_.next_line()) {
      if (!in_.skip_to_content()) {
        in_.fail("the header ends without 'end_header'; the file is truncated");
      }
      ended = parse_line();
    }
    if (!has_format_) in_.fail("the header has no 'format' line");
    return std::move(header_);
  }

  std::size_t body() const { return in_.position(); }

 private:
  auto fails() const {
    return [this](const std::string& message) { in_.fail(message); };
  }

  /// True at the header's end.
  bool parse_line() {
    const std::string_view keyword = in_.word();
    if (keyword == "end_header") return true;
    if (keyword == "comment") {
      header_.comments.emplace_back(in_.rest_of_line());
    } else if (keyword == "obj_info") {
      header_.obj_info.emplace_back(in_.rest_of_line());
    } else if (keyword == "format") {
      parse_format();
    } else if (keyword == "element") {
      parse_element();
    } else if (keyword == "property") {
      parse_property();
    } else {
      in_.fail(fmt::format("{} is not a word of PLY headers", quoted_excerpt(keyword)));
    }
    return false;
  }

  void parse_format() {
    const std::string_view format = in_.word();
    constexpr std::pair<std::string_view, PlyFormat> kFormats[] = {
        {"ascii", PlyFormat::kAscii},
        {"binary_little_endian", PlyFormat::kBinaryLittleEndian},
        {"binary_big_endian", PlyFormat::kBinaryBigEndian}};
    for (const auto& [name, value] : kFormats) {
      if (name != format) continue;
      header_.format = value;
      has_format_ = true;
      return;
    }
    in_.fail(fmt::format("format {} is none of ascii, binary_little_endian, binary_big_endian",
                         quoted_excerpt(format)));
  }

  void parse_element() {
    PlyElement element;
    element.name = in_.word();
    const std::string_view word = in_.word();
    const auto count = parse_count(word);
    if (element.name.empty() || !count) {
      in_.fail(fmt::format("{} is not a count of elements", quoted_excerpt(word)));
    }
    element.count = *count;
    require_few(header_.elements.size() + 1, "elements", fails());
    if (header_.find(element.name)) in_.fail("element " + element.name + " stands there twice");
    header_.elements.push_back(std::move(element));
  }

  ScalarType parse_type(std::string_view word) const {
    const auto type = scalar_type(word);
    if (!type) {
      in_.fail(
          fmt::format("type {} is unknown; known are char, uchar, short, ushort, int, uint, float, "
                      "double and int8 to float64",
                      quoted_excerpt(word)));
    }
    return *type;
  }

  void parse_property() {
    if (header_.elements.empty()) in_.fail("a property stands before the first element");
    PlyElement& element = header_.elements.back();
    PlyProperty property;
    std::string_view type = in_.word();
    if (type == "list") {
      property.list_count_type = parse_type(in_.word());
      if (*property.list_count_type >= ScalarType::kFloat32) {
        in_.fail("a list is counted by an integer type");
      }
      type = in_.word();
    }
    property.type = parse_type(type);
    property.name = in_.word();
    if (property.name.empty()) in_.fail("the property has no name");
    require_few(element.properties.size() + 1, "properties of an element", fails());
    if (element.find(property.name)) {
      in_.fail("property " + property.name + " of element " + element.name + " stands there twice");
    }
    element.properties.push_back(std::move(property));
  }

  const std::string& file_;
  TextScanner in_;
  PlyHeader header_;
  bool has_format_ = false;
};

/// Values of binary records, read one after the other into this machine's byte order.
class BinaryNumbers {
 public:
  BinaryNumbers(std::string file, std::span<const std::byte> bytes, std::size_t begin, bool swapped)
      : file_(std::move(file)), bytes_(bytes), at_(begin), swapped_(swapped) {}

  std::size_t position() const { return at_; }
  std::size_t remaining() const { return bytes_.size() - at_; }

  void read(ScalarType type, std::byte* to, FunctionRef<std::string()> what) {
    const std::size_t size = scalar_size(type);
    if (size > remaining()) fail(fmt::format("the file ends within {}; it is truncated", what()));
    std::copy_n(bytes_.data() + at_, size, to);
    if (swapped_) std::reverse(to, to + size);
    at_ += size;
  }

  void expect_line_end(FunctionRef<std::string()>) {}
  [[noreturn]] void fail(const std::string& message) const { throw_input(file_, message); }

 private:
  std::string file_;
  std::span<const std::byte> bytes_;
  std::size_t at_;
  bool swapped_;
};

/// One list property of all records, in this machine's byte order.
struct RawLists {
  Array<std::size_t> offset;
  Array<std::byte> value;
};

/// State of an element's decoding.
struct ElementData {
  std::size_t begin = 0;  ///< Offset in the file.
  std::optional<std::size_t> end;
  bool decoded = false;
  RecordTable scalars;
  Array<std::byte> records;     ///< Owns the memory that `scalars` shows, unless it is the file's.
  std::vector<RawLists> lists;  ///< One for each property; empty for scalar properties.
};

/// Where a value stands, for messages: "face 17 (vertex_indices)".
std::string place(const PlyElement& element, std::size_t row, const PlyProperty& property) {
  return fmt::format("{} {} ({})", element.name, row, property.name);
}

/// Fewest bytes that a value can take: in text a character and a separator, which the last value of
/// a file does not need.
template <bool kText>
std::size_t least_bytes(ScalarType type) {
  return kText ? 2 : scalar_size(type);
}

/// Fewest bytes that a record can take.
std::size_t least_record_size(const PlyElement& element, PlyFormat format) {
  std::size_t bytes = 0;
  for (const PlyProperty& property : element.properties) {
    const ScalarType type = property.list_count_type.value_or(property.type);
    bytes += format == PlyFormat::kAscii ? least_bytes<true>(type) : least_bytes<false>(type);
  }
  return bytes;
}

/// Reads a list's count, then its items; appends them to `lists` unless that is null.
template <class Source>
void read_list(Source& source, const PlyProperty& property, FunctionRef<std::string()> what,
               RawLists* lists) {
  constexpr bool kText = std::is_same_v<Source, TextScanner>;
  std::byte count_bytes[sizeof(double)];
  source.read(*property.list_count_type, count_bytes, what);
  const std::int64_t count = visit_type(*property.list_count_type, [&]<class T>(T) {
    return static_cast<std::int64_t>(load_scalar<T, false>(count_bytes));
  });
  if (count < 0) source.fail(fmt::format("{} items in {}", count, what()));
  const std::size_t size = scalar_size(property.type);
  require_room(static_cast<std::uint64_t>(count), least_bytes<kText>(property.type),
               source.remaining() + kText, what, "items",
               [&](const std::string& message) { source.fail(message); });
  std::byte skipped[sizeof(double)];
  const std::size_t begin = lists ? lists->value.size() : 0;
  if (lists) lists->value.resize(begin + static_cast<std::size_t>(count) * size);
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    source.read(property.type, lists ? lists->value.data() + begin + i * size : skipped, what);
  }
  if (lists) lists->offset.push_back(lists->value.size() / size);
}

/// Reads all records of an element one after the other, into `data` or, if that is null, past them.
template <class Source>
void read_records(Source& source, const PlyElement& element, ElementData* data) {
  std::byte skipped[sizeof(double)];
  for (std::size_t row = 0; row < element.count; ++row) {
    std::byte* record = data ? data->records.data() + row * data->scalars.stride : nullptr;
    std::size_t scalar = 0;
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      const PlyProperty& property = element.properties[k];
      const auto what = [&] { return place(element, row, property); };
      if (property.is_list()) {
        read_list(source, property, what, data ? &data->lists[k] : nullptr);
      } else {
        const RecordColumn* column = data ? &data->scalars.columns[scalar++] : nullptr;
        source.read(column ? column->type : property.type,
                    column ? record + column->offset : skipped, what);
      }
    }
    source.expect_line_end([&] { return fmt::format("{} {}", element.name, row); });
  }
}

template <class T, bool kSwapped>
void convert_column(const RecordTable& table, const RecordColumn& column, Array<T>& out,
                    FunctionRef<void(std::size_t, double)> refuse) {
  // Columns of one table are converted one by one: the file's bytes stay for all of them.
  if (table.file) table.file->bytes();
  Array<std::byte> none;
  const std::byte* records = table.read(0, table.count, none);
  visit_type(column.type, [&]<class From>(From) {
    parallel_for(table.count, kPlyGrain, [&](std::size_t begin, std::size_t end, int) {
      const std::byte* at = records + begin * table.stride + column.offset;
      for (std::size_t i = begin; i < end; ++i) {
        const From value = load_scalar<From, kSwapped>(at);
        at += table.stride;
        if (!representable<T>(value)) refuse(i, static_cast<double>(value));
        out[i] = static_cast<T>(value);
      }
    });
  });
}

}  // namespace

struct PlyFile::Impl {
  explicit Impl(InputFile input) : file(std::move(input)) {
    HeaderParser parser(file.name(), file.header("end_header"));
    header = parser.parse();
    elements.resize(header.elements.size());
    if (!elements.empty()) elements.front().begin = parser.body();
  }

  bool swapped() const {
    return (header.format == PlyFormat::kBinaryLittleEndian) !=
           (std::endian::native == std::endian::little);
  }

  std::size_t index_of(std::string_view element) const;
  std::size_t index_of_property(const PlyElement& element, std::string_view property,
                                bool list) const;
  void check_count(std::size_t index) const;
  void describe_records(std::size_t index, std::initializer_list<std::string_view> wide);
  std::size_t read(std::size_t index, bool keep);
  void locate(std::size_t index);
  ElementData& decode(std::size_t index, std::initializer_list<std::string_view> wide = {});

  InputFile file;
  PlyHeader header;
  std::vector<ElementData> elements;
};

std::size_t PlyFile::Impl::index_of(std::string_view element) const {
  const PlyElement* found = header.find(element);
  if (!found) throw_input(file.name(), fmt::format("has no element '{}'", element));
  return static_cast<std::size_t>(found - header.elements.data());
}

std::size_t PlyFile::Impl::index_of_property(const PlyElement& element, std::string_view property,
                                             bool list) const {
  const PlyProperty* found = element.find(property);
  if (!found || found->is_list() != list) {
    throw_input(file.name(), fmt::format("element {} has no {} property '{}'", element.name,
                                         list ? "list" : "scalar", property));
  }
  return static_cast<std::size_t>(found - element.properties.data());
}

/// Refuses a count that the rest of the file has no room for.
void PlyFile::Impl::check_count(std::size_t index) const {
  const PlyElement& element = header.elements[index];
  const std::size_t rest =
      file.size() - elements[index].begin + (header.format == PlyFormat::kAscii ? 1 : 0);
  require_room(element.count, least_record_size(element, header.format), rest, kTheHeader,
               "of element " + element.name,
               [&](const std::string& message) { throw_input(file.name(), message); });
}

/// Lays out the scalar columns.
void PlyFile::Impl::describe_records(std::size_t index,
                                     std::initializer_list<std::string_view> wide) {
  const PlyElement& element = header.elements[index];
  RecordTable& table = elements[index].scalars;
  table.count = element.count;
  for (const PlyProperty& property : element.properties) {
    if (property.is_list()) continue;
    const bool widen = header.format == PlyFormat::kAscii &&
                       property.type == ScalarType::kFloat32 &&
                       std::find(wide.begin(), wide.end(), property.name) != wide.end();
    const ScalarType type = widen ? ScalarType::kFloat64 : property.type;
    table.columns.push_back({property.name, type, table.stride});
    table.stride += scalar_size(type);
  }
}

/// Reads an element value by value and returns where it ends.
std::size_t PlyFile::Impl::read(std::size_t index, bool keep) {
  const PlyElement& element = header.elements[index];
  ElementData& data = elements[index];
  if (element.properties.empty()) return data.begin;
  if (keep) {
    data.records.resize(data.scalars.count * data.scalars.stride);
    data.scalars.data = data.records.data();
    data.lists.resize(element.properties.size());
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      if (!element.properties[k].is_list()) continue;
      data.lists[k].offset.reserve(element.count + 1);
      data.lists[k].offset.push_back(0);
    }
  }
  ElementData* target = keep ? &data : nullptr;
  if (header.format == PlyFormat::kAscii) {
    TextScanner text(file.name(), as_text(file.bytes()), {}, data.begin);
    read_records(text, element, target);
    return text.position();
  }
  BinaryNumbers binary(file.name(), file.bytes(), data.begin, swapped());
  read_records(binary, element, target);
  return binary.position();
}

/// Finds where an element begins, for which all elements before it are located first.
void PlyFile::Impl::locate(std::size_t index) {
  for (std::size_t k = 0; k < index; ++k) {
    ElementData& data = elements[k];
    if (!data.end) {
      check_count(k);
      const PlyElement& element = header.elements[k];
      const bool fixed_size =
          header.format != PlyFormat::kAscii &&
          std::none_of(element.properties.begin(), element.properties.end(),
                       [](const PlyProperty& property) { return property.is_list(); });
      data.end = fixed_size ? data.begin + element.count * least_record_size(element, header.format)
                            : read(k, false);
    }
    elements[k + 1].begin = *data.end;
  }
}

ElementData& PlyFile::Impl::decode(std::size_t index,
                                   std::initializer_list<std::string_view> wide) {
  ElementData& data = elements[index];
  if (data.decoded) return data;
  locate(index);
  check_count(index);
  describe_records(index, wide);
  const PlyElement& element = header.elements[index];
  const bool only_scalars = data.scalars.columns.size() == element.properties.size();
  if (header.format != PlyFormat::kAscii && only_scalars) {
    data.scalars.file = &file;
    data.scalars.offset = data.begin;
    data.scalars.swapped = swapped();
    data.end = data.begin + data.scalars.count * data.scalars.stride;
  } else {
    data.end = read(index, true);
  }
  data.decoded = true;
  return data;
}

const PlyProperty* PlyElement::find(std::string_view property) const {
  const auto found = std::find_if(properties.begin(), properties.end(),
                                  [&](const PlyProperty& p) { return p.name == property; });
  return found == properties.end() ? nullptr : &*found;
}

const PlyElement* PlyHeader::find(std::string_view element) const {
  const auto found = std::find_if(elements.begin(), elements.end(),
                                  [&](const PlyElement& e) { return e.name == element; });
  return found == elements.end() ? nullptr : &*found;
}

PlyFile::PlyFile(InputFile file) : impl_(std::make_unique<Impl>(std::move(file))) {}
PlyFile::~PlyFile() = default;
PlyFile::PlyFile(PlyFile&&) noexcept = default;

bool PlyFile::matches(std::span<const std::byte> bytes) {
  return TextScanner({}, as_text(bytes).substr(0, 4)).word() == "ply";
}

const PlyHeader& PlyFile::header() const { return impl_->header; }
const std::string& PlyFile::name() const { return impl_->file.name(); }
const InputFile& PlyFile::file() const { return impl_->file; }

const RecordTable& PlyFile::scalars(std::string_view element,
                                    std::initializer_list<std::string_view> wide) {
  return impl_->decode(impl_->index_of(element), wide).scalars;
}

template <class T>
Array<T> PlyFile::column(std::string_view element, std::string_view property) {
  const std::size_t index = impl_->index_of(element);
  impl_->index_of_property(impl_->header.elements[index], property, false);
  const RecordTable& table = impl_->decode(index).scalars;
  const auto refuse = [&](std::size_t row, double value) {
    throw_input(name(), fmt::format("{} {}: {} is {}, which is out of range", element, row,
                                    property, value));
  };
  Array<T> out(table.count);
  if (table.swapped) {
    convert_column<T, true>(table, *table.find(property), out, refuse);
  } else {
    convert_column<T, false>(table, *table.find(property), out, refuse);
  }
  return out;
}

template <class T>
PlyLists<T> PlyFile::lists(std::string_view element, std::string_view property) {
  const std::size_t index = impl_->index_of(element);
  const PlyElement& described = impl_->header.elements[index];
  const std::size_t k = impl_->index_of_property(described, property, true);
  const RawLists& raw = impl_->decode(index).lists[k];
  PlyLists<T> out;
  out.offset = raw.offset;
  out.value.resize(raw.offset.back());
  visit_type(described.properties[k].type, [&]<class From>(From) {
    for (std::size_t i = 0; i < out.value.size(); ++i) {
      const From value = load_scalar<From, false>(raw.value.data() + i * sizeof(From));
      if (!representable<T>(value)) {
        const auto next = std::upper_bound(raw.offset.begin(), raw.offset.end(), i);
        throw_input(name(), fmt::format("{} {}: an item of {} is {}, which is out of range",
                                        element, next - raw.offset.begin() - 1, property, value));
      }
      out.value[i] = static_cast<T>(value);
    }
  });
  return out;
}

#define SURFEL_PLY_COLUMN(T) \
  template SURFEL_API Array<T> PlyFile::column<T>(std::string_view, std::string_view);
#define SURFEL_PLY_LISTS(T) \
  template SURFEL_API PlyLists<T> PlyFile::lists<T>(std::string_view, std::string_view);
SURFEL_PLY_COLUMN(std::int8_t)
SURFEL_PLY_COLUMN(std::uint8_t)
SURFEL_PLY_COLUMN(std::int16_t)
SURFEL_PLY_COLUMN(std::uint16_t)
SURFEL_PLY_COLUMN(std::int32_t)
SURFEL_PLY_COLUMN(std::uint32_t)
SURFEL_PLY_COLUMN(float)
SURFEL_PLY_COLUMN(double)
SURFEL_PLY_LISTS(std::int32_t)
SURFEL_PLY_LISTS(std::uint32_t)
SURFEL_PLY_LISTS(float)
SURFEL_PLY_LISTS(double)
#undef SURFEL_PLY_COLUMN
#undef SURFEL_PLY_LISTS

}  // namespace surfel
