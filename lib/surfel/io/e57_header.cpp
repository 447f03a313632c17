#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <pugixml.hpp>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/e57_header.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::string_view kE57Signature = "ASTM-E57";
constexpr std::size_t kE57HeaderBytes = 48;
/// Memory that a byte of XML takes as a tree, roughly: an element of four letters is 72 bytes.
constexpr std::uint64_t kXmlTreeBytes = 16;

std::string_view trimmed_xml(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\n";
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

std::string_view e57_type_of(const pugi::xml_node& node) { return node.attribute("type").value(); }

/// Checks the header, in the first page, and returns the pages of the file.
E57Pages e57_pages_of(const InputFile& file) {
  const auto fail = [&](const std::string& message) { throw_input(file.name(), message); };
  const std::span<const std::byte> head = file.head(kE57HeaderBytes);
  if (head.size() < kE57HeaderBytes) fail("is cut off within the E57 header");
  const auto major = load_scalar<std::uint32_t, false>(head.data() + 8);
  if (major != 1) {
    fail(fmt::format("is E57 {}.{}; 1.0 is supported", major,
                     load_scalar<std::uint32_t, false>(head.data() + 12)));
  }
  const auto page = load_scalar<std::uint64_t, false>(head.data() + 40);
  if (page != E57Pages::kPage) {
    fail(fmt::format("has pages of {} bytes; E57 has pages of {}", page, E57Pages::kPage));
  }
  const auto bytes = load_scalar<std::uint64_t, false>(head.data() + 16);
  if (bytes > file.size() || bytes % E57Pages::kPage != 0 || bytes == 0) {
    fail(
        fmt::format("the header promises {} bytes, in pages of {}, and the file has {}; it is "
                    "truncated or its header is wrong",
                    bytes, E57Pages::kPage, file.size()));
  }
  return {file, bytes};
}

/// Reads the description of one scan.
class E57ScanReader {
 public:
  E57ScanReader(const E57Pages& pages, std::size_t number) : pages_(pages), number_(number) {}

  /// Nothing for a scan without points.
  std::optional<E57Scan> read(const pugi::xml_node& node) {
    const pugi::xml_node points = node.child("points");
    if (!points) return std::nullopt;
    if (e57_type_of(points) != "CompressedVector") {
      fail("its points are of the type " + quoted_excerpt(e57_type_of(points)) +
           ", not a CompressedVector");
    }
    E57Scan scan;
    scan.number = number_;
    scan.name = trimmed_xml(node.child("name").child_value());
    const std::int64_t count = integer(points.attribute("recordCount").value(), "recordCount", -1);
    if (count < 0) fail("recordCount is no number of points");
    if (count == 0) return std::nullopt;
    scan.count = static_cast<std::uint64_t>(count);
    const std::int64_t offset = integer(points.attribute("fileOffset").value(), "fileOffset", -1);
    if (offset < 0) fail("fileOffset is no place in the file");
    scan.section = pages_.logical(static_cast<std::uint64_t>(offset), "points");
    read_fields(points, scan);
    if (const pugi::xml_node pose = node.child("pose")) scan.pose = read_pose(pose);
    read_colors(node.child("colorLimits"), scan);
    return scan;
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw_input(pages_.file().name(), fmt::format("scan {}: {}", number_ + 1, message));
  }

  double number(std::string_view text, std::string_view what, double missing) const {
    const std::string_view word = trimmed_xml(text);
    if (word.empty()) return missing;
    const std::optional<double> value = parse_number(word);
    if (!value || !std::isfinite(*value)) {
      fail(fmt::format("{} is {}, not a finite number", what, quoted_excerpt(word)));
    }
    return *value;
  }

  std::int64_t integer(std::string_view text, std::string_view what, std::int64_t missing) const {
    const std::string_view word = trimmed_xml(text);
    if (word.empty()) return missing;
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error == std::errc() && end == word.data() + word.size()) return value;
    // Some writers print integers as 255.0 or 1e3.
    const std::optional<double> parsed = parse_number(word);
    constexpr double kEnd = 0x1p63;
    if (!parsed || *parsed != std::trunc(*parsed) || *parsed < -kEnd || *parsed >= kEnd) {
      fail(fmt::format("{} is {}, not an integer", what, quoted_excerpt(word)));
    }
    return static_cast<std::int64_t>(*parsed);
  }

  void read_fields(const pugi::xml_node& points, E57Scan& scan) const {
    const pugi::xml_node prototype = points.child("prototype");
    if (!prototype) fail("its points have no prototype, which says what they hold");
    for (const pugi::xml_node& codec : points.child("codecs")) {
      if (codec.type() == pugi::node_element && !codec.child("bitPackCodec")) {
        fail("its points are compressed by a codec that E57 1.0 does not have");
      }
    }
    std::size_t count = 0;
    for (const pugi::xml_node& node : prototype) {
      if (node.type() != pugi::node_element) continue;
      require_few(++count, "fields of a point", [&](const std::string& message) { fail(message); });
      E57Field field = read_field(node);
      if (scan.find(field.name)) fail("its points have two fields " + quoted_excerpt(field.name));
      scan.fields.push_back(std::move(field));
    }
    if (scan.fields.empty()) fail("the prototype of its points has no fields");
  }

  E57Field read_field(const pugi::xml_node& node) const {
    E57Field field;
    field.name = node.name();
    const auto what = [&](const char* attribute) {
      return "the " + std::string(attribute) + " of " + quoted_excerpt(field.name);
    };
    const std::string_view type = e57_type_of(node);
    if (type == "Float") {
      const std::string_view precision = node.attribute("precision").value();
      if (precision != "single" && precision != "double" && !precision.empty()) {
        fail(fmt::format("{} is {}, neither single nor double", what("precision"),
                         quoted_excerpt(precision)));
      }
      field.type = precision == "single" ? E57Type::kSingle : E57Type::kDouble;
      return field;
    }
    if (type == "String") {
      field.type = E57Type::kText;
      return field;
    }
    if (type != "Integer" && type != "ScaledInteger") {
      fail(fmt::format("{} is {}; Float, Integer, ScaledInteger and String are supported",
                       what("type"), quoted_excerpt(type)));
    }
    using Limits = std::numeric_limits<std::int64_t>;
    field.min = integer(node.attribute("minimum").value(), what("minimum"), Limits::min());
    field.max = integer(node.attribute("maximum").value(), what("maximum"), Limits::max());
    if (field.max < field.min) {
      fail(fmt::format("{} is {}, and its minimum {}", what("maximum"), field.max, field.min));
    }
    field.type = E57Type::kInteger;
    if (type == "Integer") return field;
    field.type = E57Type::kScaled;
    field.scale = number(node.attribute("scale").value(), what("scale"), 1);
    field.offset = number(node.attribute("offset").value(), what("offset"), 0);
    if (field.scale == 0) fail(what("scale") + " is 0");
    return field;
  }

  Viewpoint read_pose(const pugi::xml_node& node) const {
    Viewpoint pose;
    const auto read = [&](const char* group, const auto& names, auto& to) {
      const pugi::xml_node from = node.child(group);
      if (!from) return;
      for (std::size_t k = 0; k < std::size(names); ++k) {
        to[static_cast<Eigen::Index>(k)] =
            number(from.child(names[k]).child_value(),
                   fmt::format("{} of its pose's {}", names[k], group), 0);
      }
    };
    constexpr std::array<const char*, 3> kPlace{"x", "y", "z"};
    constexpr std::array<const char*, 4> kTurn{"w", "x", "y", "z"};
    read("translation", kPlace, pose.position);
    read("rotation", kTurn, pose.orientation);
    const double length = pose.orientation.norm();
    // Writers that leave the rotation out may still write the four zeros of their empty structure.
    pose.orientation = length > 0 ? Vec4d(pose.orientation / length) : Viewpoint{}.orientation;
    if (!pose.orientation.allFinite()) fail("the rotation of its pose is no quaternion");
    return pose;
  }

  void read_colors(const pugi::xml_node& limits, E57Scan& scan) const {
    constexpr std::array<const char*, 3> kChannels{"colorRed", "colorGreen", "colorBlue"};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::string name = kChannels[k];
      const pugi::xml_node min = limits.child((name + "Minimum").c_str());
      const pugi::xml_node max = limits.child((name + "Maximum").c_str());
      if (!max) continue;
      const E57Limits told{number(min.child_value(), name + "Minimum", 0),
                           number(max.child_value(), name + "Maximum", 0)};
      if (told.max > told.min) scan.color[k] = told;
    }
  }

  const E57Pages& pages_;
  std::size_t number_;
};

}  // namespace

unsigned E57Field::bits() const {
  switch (type) {
    case E57Type::kSingle:
      return 32;
    case E57Type::kDouble:
      return 64;
    case E57Type::kText:
      return 0;
    case E57Type::kInteger:
    case E57Type::kScaled:
      break;
  }
  const std::uint64_t range = static_cast<std::uint64_t>(max) - static_cast<std::uint64_t>(min);
  return static_cast<unsigned>(std::bit_width(range));
}

double E57Field::most() const {
  return (static_cast<double>(min) + (std::ldexp(1.0, static_cast<int>(bits())) - 1)) * scale +
         offset;
}

const E57Field* E57Scan::find(std::string_view field) const {
  for (const E57Field& f : fields) {
    if (f.name == field) return &f;
  }
  return nullptr;
}

bool E57Header::matches(std::span<const std::byte> bytes) {
  return as_text(bytes).starts_with(kE57Signature);
}

E57Header::E57Header(const InputFile& file) : pages(e57_pages_of(file)) {
  const auto fail = [&](const std::string& message) { throw_input(file.name(), message); };
  E57Window window(pages, 64);
  std::array<std::byte, kE57HeaderBytes> head;
  window.copy(0, head.size(), head.data());
  const std::uint64_t begin =
      pages.logical(load_scalar<std::uint64_t, false>(head.data() + 24), "its XML");
  const auto length = load_scalar<std::uint64_t, false>(head.data() + 32);
  require_room(length, 1, pages.size() - begin, kTheHeader, "bytes of XML", fail);
  if (const std::uint64_t tree = length * kXmlTreeBytes; tree > available_memory_for(tree)) {
    fail("describes its scans in more XML than this machine's memory can hold");
  }
  Array<std::byte> text(length);
  window.copy(begin, text.size(), text.data());
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(
      text.data(), text.size(), pugi::parse_minimal | pugi::parse_cdata | pugi::parse_escapes);
  if (!parsed) {
    fail(fmt::format("its XML is broken at byte {}: {}; the file is damaged", parsed.offset,
                     lower_case(parsed.description())));
  }
  const pugi::xml_node root = document.child("e57Root");
  if (!root) fail("its XML has no e57Root");
  std::size_t all = 0;
  for (const pugi::xml_node& node : root.child("data3D")) {
    if (node.type() != pugi::node_element) continue;
    require_few(++all, "scans", fail);
    if (auto scan = E57ScanReader(pages, all - 1).read(node)) scans.push_back(std::move(*scan));
  }
  if (scans.empty()) {
    fail(all == 0 ? "holds no scans"
                  : fmt::format("holds no points; its number of scans is {}", all));
  }
}

}  // namespace surfel
