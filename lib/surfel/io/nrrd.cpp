#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/named_file.h>
#include <surfel/io/nrrd.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/voxel_values.h>

namespace surfel {
namespace {

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

/// The fields of a header, by name, with the offset of what follows the header.
class NrrdHeader {
 public:
  explicit NrrdHeader(const InputFile& input) : file_(input.name()) {
    // Headers are a few hundred bytes.
    constexpr std::size_t kMostBytes = std::size_t{1} << 20;
    if (parse(as_text(input.head(std::min(kMostBytes, input.size()))))) return;
    // A header of its own may end with the file.
    if (field_.count("data file") + field_.count("datafile") == 0) {
      throw_input(file_, "the NRRD header has no end, a blank line; the file is truncated");
    }
  }

  std::size_t end() const { return end_; }
  std::optional<std::string> find(const std::string& name) const {
    const auto found = field_.find(name);
    return found == field_.end() ? std::nullopt : std::optional(found->second);
  }
  std::string get(const std::string& name) const {
    const std::optional<std::string> text = find(name);
    if (!text) throw_input(file_, fmt::format("the NRRD header has no field \"{}\"", name));
    return *text;
  }
  [[noreturn]] void fail(const std::string& name, const std::string& message) const {
    throw_input(file_, fmt::format("field \"{}\" of the NRRD header: {}", name, message));
  }
  /// All numbers in a field, whatever brackets and commas part them; `none` counts as NaN.
  std::vector<double> numbers(const std::string& name) const {
    std::string text = get(name);
    std::replace_if(
        text.begin(), text.end(), [](char c) { return c == '(' || c == ')' || c == ','; }, ' ');
    std::vector<double> out;
    std::size_t at = 0;
    while ((at = text.find_first_not_of(" \t", at)) != std::string::npos) {
      const std::size_t end = std::min(text.find_first_of(" \t", at), text.size());
      const std::string word = text.substr(at, end - at);
      const std::optional<double> number = parse_number(word == "none" ? "nan" : word);
      if (!number) fail(name, fmt::format("\"{}\" is no number", word));
      out.push_back(*number);
      at = end;
    }
    return out;
  }

 private:
  /// Whether the text has the header's end.
  bool parse(std::string_view text) {
    std::size_t at = 0;
    bool magic = true;
    while (at < text.size()) {
      const std::size_t end = text.find('\n', at);
      const std::string_view line =
          trimmed(text.substr(at, end == std::string_view::npos ? end : end - at));
      at = end == std::string_view::npos ? text.size() : end + 1;
      if (line.empty()) {
        end_ = at;
        return true;
      }
      if (!magic && line[0] != '#') add(line);
      magic = false;
      if (end == std::string_view::npos) break;
    }
    end_ = at;
    return false;
  }
  void add(std::string_view line) {
    const std::size_t colon = line.find(':');
    // "key:=value" pairs are for people.
    if (colon == std::string_view::npos || line.substr(colon).starts_with(":=")) return;
    std::string name(trimmed(line.substr(0, colon)));
    std::transform(name.begin(), name.end(), name.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    field_[name] = trimmed(line.substr(colon + 1));
  }

  std::string file_;
  std::map<std::string, std::string> field_;
  std::size_t end_ = 0;
};

ScalarType scalar_type(const NrrdHeader& header) {
  static const std::map<std::string, ScalarType, std::less<>> types{
      {"signed char", ScalarType::kInt8},
      {"int8", ScalarType::kInt8},
      {"int8_t", ScalarType::kInt8},
      {"uchar", ScalarType::kUint8},
      {"unsigned char", ScalarType::kUint8},
      {"uint8", ScalarType::kUint8},
      {"uint8_t", ScalarType::kUint8},
      {"short", ScalarType::kInt16},
      {"short int", ScalarType::kInt16},
      {"signed short", ScalarType::kInt16},
      {"signed short int", ScalarType::kInt16},
      {"int16", ScalarType::kInt16},
      {"int16_t", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},
      {"unsigned short", ScalarType::kUint16},
      {"unsigned short int", ScalarType::kUint16},
      {"uint16", ScalarType::kUint16},
      {"uint16_t", ScalarType::kUint16},
      {"int", ScalarType::kInt32},
      {"signed int", ScalarType::kInt32},
      {"int32", ScalarType::kInt32},
      {"int32_t", ScalarType::kInt32},
      {"uint", ScalarType::kUint32},
      {"unsigned int", ScalarType::kUint32},
      {"uint32", ScalarType::kUint32},
      {"uint32_t", ScalarType::kUint32},
      {"float", ScalarType::kFloat32},
      {"double", ScalarType::kFloat64}};
  const std::string name = header.get("type");
  const auto found = types.find(name);
  if (found == types.end()) {
    header.fail("type", fmt::format("\"{}\" is not read; 8 to 32 bit integers, float and double "
                                    "are",
                                    name));
  }
  return found->second;
}

void read_grid(const NrrdHeader& header, Volume& volume) {
  const std::vector<double> dimension = header.numbers("dimension");
  if (dimension != std::vector<double>{3}) {
    header.fail("dimension", "three axes of scalars are read; extract one volume of it");
  }
  const std::vector<double> sizes = header.numbers("sizes");
  if (sizes.size() != 3) header.fail("sizes", "has other than three numbers");
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(sizes[k] >= 1 && sizes[k] < 1e9 && sizes[k] == std::floor(sizes[k]))) {
      header.fail("sizes", fmt::format("{} is no number of voxels", sizes[k]));
    }
    volume.size[k] = static_cast<std::size_t>(sizes[k]);
  }
  if (header.find("space directions")) {
    const std::vector<double> numbers = header.numbers("space directions");
    if (numbers.size() != 9)
      header.fail("space directions", "has other than three vectors of three");
    for (std::size_t k = 0; k < 3; ++k) volume.step[k] = Vec3d(numbers.data() + 3 * k);
  } else if (header.find("spacings")) {
    const std::vector<double> numbers = header.numbers("spacings");
    if (numbers.size() != 3) header.fail("spacings", "has other than three numbers");
    for (int k = 0; k < 3; ++k) {
      const double spacing = numbers[static_cast<std::size_t>(k)];
      volume.step[static_cast<std::size_t>(k)] *= std::isnan(spacing) ? 1 : spacing;
    }
  }
  if (header.find("space origin")) {
    const std::vector<double> numbers = header.numbers("space origin");
    if (numbers.size() != 3) header.fail("space origin", "has other than three numbers");
    volume.origin = Vec3d(numbers.data());
  }
  // All spaces of medicine end in "superior", the direction of the head.
  const std::string space = header.find("space").value_or("");
  const bool medical = space.find("superior") != std::string::npos || space == "LPS" ||
                       space == "RAS" || space == "LAS";
  if (medical) volume.up = Vec3d(0, 0, 1);
}

}  // namespace

Volume read_nrrd(const InputFile& input) {
  const NrrdHeader header(input);
  Volume volume;
  read_grid(header, volume);
  VoxelLayout layout;
  layout.type = scalar_type(header);
  const std::string endian = header.find("endian").value_or("little");
  if (endian != "little" && endian != "big") header.fail("endian", "is neither little nor big");
  layout.big_endian = endian == "big";
  const std::string encoding = header.get("encoding");
  layout.compressed = encoding == "gzip" || encoding == "gz";
  if (!layout.compressed && encoding != "raw") {
    header.fail("encoding", fmt::format("\"{}\" is not read; raw and gzip are", encoding));
  }
  for (const char* skip : {"line skip", "lineskip", "byte skip", "byteskip"}) {
    if (header.find(skip).value_or("0") != "0") {
      header.fail(skip, "bytes before the values are not skipped; save the volume as one file");
    }
  }
  const std::optional<std::string> detached =
      header.find("data file") ? header.find("data file") : header.find("datafile");
  if (detached) {
    if (detached->starts_with("LIST") || detached->find('%') != std::string::npos) {
      header.fail("data file", "several files are not read; save the volume as one file");
    }
    read_voxels(open_named(input.name(), named_path(input.name(), *detached)), layout, volume);
  } else {
    layout.offset = header.end();
    read_voxels(input, layout, volume);
  }
  return volume;
}

}  // namespace surfel
