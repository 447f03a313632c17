#include <algorithm>
#include <charconv>
#include <cstdint>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/plugin.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/input_file.h>
#include <surfel/io/picture_part.h>

namespace surfel {
namespace {

/// Names of the attributes of a part's file.
constexpr char kPart[] = "surfelPart";
constexpr char kMadeBy[] = "surfelMadeBy";

/// Reads a part; throws Error(kInput) where the file is none.
std::pair<PartHeader, Image> read_part(const std::string& path) {
  InputFile file(path);
  const std::string name = file.name();
  if (!is_exr(file)) throw_input(name, "is no EXR file; give parts of a picture, which are");
  const auto read = reinterpret_cast<ReadWindowFunction*>(plugin_symbol("exr", kReadWindowSymbol));
  ExrWindow window;
  Image image;
  read(file, window, image);
  PartHeader header{.height = window.height, .world_to_camera = window.world_to_camera};
  std::optional<PartNumber> part;
  for (const auto& [key, value] : window.metadata) {
    if (key == kPart) {
      part = PartNumber::parse(value);
    } else if (key == kMadeBy) {
      header.made_by = value;
    } else {
      header.metadata.emplace_back(key, value);
    }
  }
  if (!part) {
    throw_input(
        name,
        "is no part of a picture; surfel-render makes parts, as EXR, where `tiles` are asked for");
  }
  header.part = *part;
  const bool fits = part->parts <= PartNumber::most_parts(window.height);
  const RowRange rows = fits ? part->rows(window.height) : RowRange{0, 0};
  if (window.first_row != rows.begin || image.height != rows.end - rows.begin) {
    throw_input(name, fmt::format("says that it is part {}/{} of a picture of {} rows, but has "
                                  "rows {} to {}; make it again",
                                  part->number, part->parts, window.height, window.first_row,
                                  window.first_row + image.height - 1));
  }
  return {std::move(header), std::move(image)};
}

/// How a part differs from the parts before; empty if it does not.
std::string difference(const PartHeader& a, const Image& a_rows, const PartHeader& b,
                       const Image& b_rows) {
  if (a_rows.width != b_rows.width || a.height != b.height) {
    return fmt::format("is of {}x{} pixels, not {}x{}", b_rows.width, b.height, a_rows.width,
                       a.height);
  }
  if (a.part.parts != b.part.parts) {
    return fmt::format("is one of {} parts, not of {}", b.part.parts, a.part.parts);
  }
  if (a_rows.channels != b_rows.channels) return "has other channels";
  if (a.made_by != b.made_by) {
    return fmt::format("was made by \"{}\", not by \"{}\"", b.made_by, a.made_by);
  }
  if (a.world_to_camera != b.world_to_camera) return "is seen by another camera";
  if (a.metadata != b.metadata) return "says something else of how it was made";
  return {};
}

}  // namespace

std::optional<PartNumber> PartNumber::parse(const std::string& text) {
  PartNumber part;
  const char* const end = text.data() + text.size();
  const auto [slash, bad_number] = std::from_chars(text.data(), end, part.number);
  if (bad_number != std::errc() || slash == end || *slash != '/') return std::nullopt;
  const auto [rest, bad_parts] = std::from_chars(slash + 1, end, part.parts);
  if (bad_parts != std::errc() || rest != end) return std::nullopt;
  if (part.number < 1 || part.number > part.parts) return std::nullopt;
  return part;
}

int PartNumber::most_parts(int height) { return (height + kRowsTogether - 1) / kRowsTogether; }

RowRange PartNumber::rows(int height) const {
  const auto first = [&](int part) {
    const auto together = std::int64_t{most_parts(height)} * part / parts;
    return std::min(height, static_cast<int>(together) * kRowsTogether);
  };
  return {first(number - 1), first(number)};
}

Image part_of(const Image& picture, const PartNumber& part) {
  const RowRange rows = part.rows(picture.height);
  Image out{picture.width, rows.end - rows.begin, picture.channels, {}};
  out.data.assign(picture.pixel(0, rows.begin), picture.pixel(0, rows.end));
  return out;
}

ImageWriteOptions part_options(const PartNumber& part, int height, const std::string& made_by,
                               ImageWriteOptions options) {
  options.rows_of = RowsOfPicture{part.rows(height).begin, height};
  options.metadata.emplace_back(kPart, fmt::format("{}/{}", part.number, part.parts));
  options.metadata.emplace_back(kMadeBy, made_by);
  return options;
}

bool part_is_there(const std::string& path, const PartNumber& part, const std::string& made_by) {
  try {
    const PartHeader header = read_part(path).first;
    return header.part.number == part.number && header.part.parts == part.parts &&
           header.made_by == made_by;
  } catch (const Error&) {
    return false;
  }
}

void PictureJoin::add(const std::string& path) {
  auto [header, rows] = read_part(path);
  if (!header_) {
    picture_ = Image{rows.width, header.height, rows.channels, {}};
    picture_.data.resize(static_cast<std::size_t>(rows.width) *
                         static_cast<std::size_t>(header.height) * rows.channels.size());
    files_.resize(static_cast<std::size_t>(header.part.parts));
    header_ = header;
  }
  if (const std::string other = difference(*header_, picture_, header, rows); !other.empty()) {
    const auto first = std::find_if(files_.begin(), files_.end(),
                                    [](const std::string& file) { return !file.empty(); });
    throw_input(path, fmt::format("{}, unlike {}; join parts of one picture", other, *first));
  }
  std::string& file = files_[static_cast<std::size_t>(header.part.number - 1)];
  if (!file.empty()) {
    throw_input(path, fmt::format("is part {} of {}, and so is {}", header.part.number,
                                  header.part.parts, file));
  }
  file = path;
  const RowRange range = header.part.rows(header.height);
  std::copy(rows.data.begin(), rows.data.end(), picture_.pixel(0, range.begin));
}

std::vector<int> PictureJoin::missing() const {
  std::vector<int> numbers;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    if (files_[i].empty()) numbers.push_back(static_cast<int>(i) + 1);
  }
  return numbers;
}

}  // namespace surfel
