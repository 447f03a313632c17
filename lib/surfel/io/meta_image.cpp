#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/meta_image.h>
#include <surfel/io/named_file.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/voxel_values.h>

namespace surfel {
namespace {

constexpr std::string_view kDataFile = "ElementDataFile";

/// The keys of a header, and the offset of what follows it.
class MetaHeader {
 public:
  explicit MetaHeader(const InputFile& input) : file_(input.name()) {
    const std::string_view text = input.header(kDataFile);
    while (end_ < text.size()) {
      const std::size_t line_end = std::min(text.find('\n', end_), text.size());
      const std::string_view line = text.substr(end_, line_end - end_);
      end_ = std::min(line_end + 1, text.size());
      const std::size_t equals = line.find('=');
      if (equals == std::string_view::npos) continue;
      const std::string key = words(line.substr(0, equals));
      key_[key] = words(line.substr(equals + 1));
      if (key == kDataFile) return;
    }
    throw_input(file_, fmt::format("the MetaImage header has no {}; the file is truncated or of "
                                   "another format",
                                   kDataFile));
  }

  std::size_t end() const { return end_; }
  std::optional<std::string> find(const std::string& name) const {
    const auto found = key_.find(name);
    return found == key_.end() ? std::nullopt : std::optional(found->second);
  }
  std::string get(const std::string& name) const {
    const std::optional<std::string> text = find(name);
    if (!text) fail(name, "is missing");
    return *text;
  }
  bool flag(const std::string& name) const {
    const std::string text = find(name).value_or("False");
    return text == "True" || text == "true" || text == "1";
  }
  [[noreturn]] void fail(const std::string& name, const std::string& message) const {
    throw_input(file_, fmt::format("key \"{}\" of the MetaImage header: {}", name, message));
  }
  std::vector<double> numbers(const std::string& name, std::size_t count) const {
    const std::string text = get(name);
    std::vector<double> out;
    std::size_t at = 0;
    while (at < text.size()) {
      const std::size_t end = std::min(text.find(' ', at), text.size());
      const std::optional<double> number = parse_number(text.substr(at, end - at));
      if (!number) fail(name, fmt::format("\"{}\" is no number", text.substr(at, end - at)));
      out.push_back(*number);
      at = end + 1;
    }
    if (out.size() != count) fail(name, fmt::format("has {} numbers, not {}", out.size(), count));
    return out;
  }

 private:
  /// A text with one blank between its words.
  static std::string words(std::string_view text) {
    std::string out;
    for (const char c : text) {
      const bool blank = c == ' ' || c == '\t' || c == '\r';
      if (!blank) out += c;
      if (blank && !out.empty() && out.back() != ' ') out += ' ';
    }
    if (!out.empty() && out.back() == ' ') out.pop_back();
    return out;
  }

  std::string file_;
  std::map<std::string, std::string> key_;
  std::size_t end_ = 0;
};

ScalarType scalar_type(const MetaHeader& header) {
  static const std::map<std::string, ScalarType, std::less<>> types{
      {"MET_CHAR", ScalarType::kInt8},     {"MET_UCHAR", ScalarType::kUint8},
      {"MET_SHORT", ScalarType::kInt16},   {"MET_USHORT", ScalarType::kUint16},
      {"MET_INT", ScalarType::kInt32},     {"MET_UINT", ScalarType::kUint32},
      {"MET_FLOAT", ScalarType::kFloat32}, {"MET_DOUBLE", ScalarType::kFloat64}};
  const std::string name = header.get("ElementType");
  const auto found = types.find(name);
  if (found == types.end()) {
    header.fail("ElementType", fmt::format("\"{}\" is not read; scalars of 8 to 32 bits, float and "
                                           "double are",
                                           name));
  }
  return found->second;
}

void read_grid(const MetaHeader& header, Volume& volume) {
  if (header.get("NDims") != "3") header.fail("NDims", "volumes of three dimensions are read");
  const std::vector<double> sizes = header.numbers("DimSize", 3);
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(sizes[k] >= 1 && sizes[k] < 1e9 && sizes[k] == std::floor(sizes[k]))) {
      header.fail("DimSize", fmt::format("{} is no number of voxels", sizes[k]));
    }
    volume.size[k] = static_cast<std::size_t>(sizes[k]);
  }
  for (const char* key : {"TransformMatrix", "Orientation", "Rotation"}) {
    if (!header.find(key)) continue;
    const std::vector<double> numbers = header.numbers(key, 9);
    for (std::size_t k = 0; k < 3; ++k) volume.step[k] = Vec3d(numbers.data() + 3 * k);
    break;
  }
  for (const char* key : {"ElementSpacing", "ElementSize"}) {
    if (!header.find(key)) continue;
    const std::vector<double> numbers = header.numbers(key, 3);
    for (std::size_t k = 0; k < 3; ++k) volume.step[k] *= numbers[k];
    break;
  }
  for (const char* key : {"Offset", "Position", "Origin"}) {
    if (!header.find(key)) continue;
    volume.origin = Vec3d(header.numbers(key, 3).data());
    break;
  }
  // MetaImage has ITK's coordinates: left, posterior, superior.
  volume.up = Vec3d(0, 0, 1);
}

}  // namespace

Volume read_meta_image(const InputFile& input) {
  const MetaHeader header(input);
  Volume volume;
  read_grid(header, volume);
  VoxelLayout layout;
  layout.type = scalar_type(header);
  layout.big_endian = header.flag("ElementByteOrderMSB") || header.flag("BinaryDataByteOrderMSB");
  layout.compressed = header.flag("CompressedData");
  if (header.find("ElementNumberOfChannels").value_or("1") != "1") {
    header.fail("ElementNumberOfChannels", "one scalar a voxel is read");
  }
  const std::string data = header.get(std::string(kDataFile));
  if (data == "LIST" || data.find('%') != std::string::npos) {
    header.fail(std::string(kDataFile), "several files are not read; save the volume as one file");
  }
  if (data == "LOCAL") {
    layout.offset = header.end();
    read_voxels(input, layout, volume);
    return volume;
  }
  const std::string skip = header.find("HeaderSize").value_or("0");
  const std::optional<std::size_t> bytes = parse_count(skip);
  if (!bytes && skip != "-1") header.fail("HeaderSize", "is no number of bytes");
  const InputFile file = open_named(input.name(), named_path(input.name(), data));
  const std::size_t size = volume.voxels() * scalar_size(layout.type);
  // -1: the values are the end of the file.
  layout.offset = bytes ? *bytes : file.size() - std::min(file.size(), size);
  read_voxels(file, layout, volume);
  return volume;
}

}  // namespace surfel
