#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <surfel/laz/laz_chunk.h>

#include "support/e57_file.h"
#include "support/las_points.h"

namespace surfel::test {

using Place = std::array<double, 3>;

/// Files of points as other programs write them, made without the library's readers and writers.
enum class PointFormat {
  kPlyText,
  kPlyLittle,
  kPlyBig,
  kCsv,
  kXyz,
  kBareText,  ///< Numbers alone: `kBareColumns` names them.
  kPcdText,
  kPcdBinary,
  kPcdCompressed,
  kLas,
  kLaz,
  kPtx,
  kE57,
  kE57Steps,  ///< Coordinates as whole numbers of steps.
};
constexpr const char* kBareColumns = "x,y,z,nx,ny,nz,variance,intensity";

/// Points that are surfels of one plane where the format has columns for that.
struct FilePoints {
  std::vector<Place> places;
  bool single = false;     ///< The coordinates are floats.
  double per_unit = 1000;  ///< Steps in a unit, where the format has steps.
  double offset = 0;       ///< Of LAS, units; a whole number.
  float variance = 1;      ///< Of all points.
  float intensity = 7;     ///< Of all points but the first.
  float first_intensity = 7;
};

/// The shortest text that reads back as the number.
template <class T>
std::string shortest(T number) {
  std::array<char, 64> digits;
  return {digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), number).ptr};
}

inline bool is_text(PointFormat format) {
  return format == PointFormat::kPlyText || format == PointFormat::kPcdText ||
         format == PointFormat::kCsv || format == PointFormat::kXyz ||
         format == PointFormat::kBareText || format == PointFormat::kPtx;
}

class PointFileMaker {
 public:
  PointFileMaker(const FilePoints& points, PointFormat format) : points_(points), format_(format) {}

  std::string file() const {
    switch (format_) {
      case PointFormat::kPlyText:
      case PointFormat::kPlyLittle:
      case PointFormat::kPlyBig:
        return ply();
      case PointFormat::kCsv:
        return std::string(kBareColumns) + "\n" + lines(',');
      case PointFormat::kXyz:
        return "# x y z nx ny nz variance intensity\n" + lines(' ');
      case PointFormat::kBareText:
        return lines(' ');
      case PointFormat::kPcdText:
      case PointFormat::kPcdBinary:
      case PointFormat::kPcdCompressed:
        return pcd();
      case PointFormat::kLas:
      case PointFormat::kLaz:
        return las();
      case PointFormat::kPtx:
        return ptx();
      default:
        return e57();
    }
  }

  /// The i-th point's coordinate as the format tells it.
  double told(std::size_t i, std::size_t axis) const {
    const double value = points_.places[i][axis];
    if (is_text(format_)) return std::strtod(text(value).c_str(), nullptr);
    if (format_ != PointFormat::kLas && format_ != PointFormat::kLaz) return value;
    return steps(i, axis) * (1 / points_.per_unit) + points_.offset;
  }

 private:
  double steps(std::size_t i, std::size_t axis) const {
    return std::round(points_.places[i][axis] * points_.per_unit) -
           points_.offset * points_.per_unit;
  }
  float intensity(std::size_t i) const {
    return i == 0 ? points_.first_intensity : points_.intensity;
  }
  std::string text(double coordinate) const {
    return points_.single ? shortest(static_cast<float>(coordinate)) : shortest(coordinate);
  }
  std::array<float, 5> others(std::size_t i) const {
    return {0, 0, 1, points_.variance, intensity(i)};
  }

  std::string lines(char separator) const {
    std::string all;
    for (std::size_t i = 0; i < points_.places.size(); ++i) {
      std::string line;
      for (const double c : points_.places[i]) line += text(c) + separator;
      for (const float value : others(i)) line += shortest(value) + separator;
      line.back() = '\n';
      all += line;
    }
    return all;
  }

  template <class T>
  static void append(std::string& bytes, T value, bool big) {
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), &value, sizeof(T));
    if (big) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
  }
  std::string records(bool big) const {
    std::string bytes;
    for (std::size_t i = 0; i < points_.places.size(); ++i) {
      for (const double c : points_.places[i]) {
        if (points_.single) {
          append(bytes, static_cast<float>(c), big);
        } else {
          append(bytes, c, big);
        }
      }
      for (const float value : others(i)) append(bytes, value, big);
    }
    return bytes;
  }

  std::string ply() const {
    const bool big = format_ == PointFormat::kPlyBig;
    const bool ascii = format_ == PointFormat::kPlyText;
    std::string header = fmt::format("ply\nformat {} 1.0\nelement vertex {}\n",
                                     ascii ? "ascii"
                                     : big ? "binary_big_endian"
                                           : "binary_little_endian",
                                     points_.places.size());
    for (const char* name : {"x", "y", "z"}) {
      header += fmt::format("property {} {}\n", points_.single ? "float" : "double", name);
    }
    for (const char* name : {"nx", "ny", "nz", "variance", "intensity"}) {
      header += fmt::format("property float {}\n", name);
    }
    return header + "end_header\n" + (ascii ? lines(' ') : records(big));
  }

  std::string pcd() const {
    const std::size_t count = points_.places.size();
    const char* size = points_.single ? "4 4 4" : "8 8 8";
    const std::string header = fmt::format(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        "FIELDS x y z normal_x normal_y normal_z variance intensity\nSIZE {} 4 4 4 4 4\n"
        "TYPE F F F F F F F F\nCOUNT 1 1 1 1 1 1 1 1\nWIDTH {}\nHEIGHT 1\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA ",
        size, count, count);
    if (format_ == PointFormat::kPcdText) return header + "ascii\n" + lines(' ');
    const std::string rows = records(false);
    if (format_ == PointFormat::kPcdBinary) return header + "binary\n" + rows;
    // Field after field, as LZF that repeats nothing: runs of 32 bytes, each after its length - 1.
    std::string columns;
    const std::size_t wide = points_.single ? 4 : 8;
    const std::size_t stride = 3 * wide + 5 * 4;
    for (std::size_t field = 0, at = 0; field < 8; ++field) {
      const std::size_t bytes = field < 3 ? wide : 4;
      for (std::size_t i = 0; i < count; ++i) columns += rows.substr(i * stride + at, bytes);
      at += bytes;
    }
    std::string packed;
    for (std::size_t at = 0; at < columns.size(); at += 32) {
      const std::string run = columns.substr(at, 32);
      packed += static_cast<char>(run.size() - 1) + run;
    }
    std::string sizes;
    append(sizes, static_cast<std::uint32_t>(packed.size()), false);
    append(sizes, static_cast<std::uint32_t>(columns.size()), false);
    return header + "binary_compressed\n" + sizes + packed;
  }

  std::string las() const {
    const bool compressed = format_ == PointFormat::kLaz;
    LasFileMaker maker;
    maker.layout = layout_of(compressed ? 6 : 0, 16);
    maker.minor = compressed ? 4 : 2;
    maker.scale = 1 / points_.per_unit;
    maker.offset = points_.offset;
    for (const char* name : {"nx", "ny", "nz", "variance"}) {
      std::string description(192, '\0');
      description[2] = 9;  // A float.
      std::memcpy(description.data() + 4, name, std::strlen(name));
      maker.extra_descriptions += description;
    }
    for (std::size_t i = 0; i < points_.places.size(); ++i) {
      std::string point(maker.layout.bytes, '\0');
      for (std::size_t axis = 0; axis < 3; ++axis) {
        LasFileMaker::put(point, 4 * axis, static_cast<std::int32_t>(steps(i, axis)));
      }
      LasFileMaker::put(point, 12, static_cast<std::uint16_t>(intensity(i)));
      point[14] = compressed ? 0x11 : 0x09;
      for (std::size_t k = 0; k < 4; ++k) {
        LasFileMaker::put(point, maker.layout.format_bytes() + 4 * k, others(i)[k]);
      }
      const auto bytes = std::as_bytes(std::span(point));
      maker.points.insert(maker.points.end(), bytes.begin(), bytes.end());
    }
    return compressed ? laz_of(maker, {50000}) : maker.las();
  }

  std::string ptx() const {
    std::string all = fmt::format("{}\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n", points_.places.size()) +
                      "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    for (std::size_t i = 0; i < points_.places.size(); ++i) {
      for (const double c : points_.places[i]) all += text(c) + ' ';
      all += shortest(intensity(i)) + '\n';
    }
    return all;
  }

  std::string e57() const {
    std::vector<E57FileMaker::Field> fields;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::string name = fmt::format("cartesian{}", "XYZ"[axis]);
      fields.push_back(format_ == PointFormat::kE57Steps ? e57_steps(name, axis)
                                                         : e57_reals(name, axis));
    }
    fields.push_back({R"(<intensity type="Float" precision="single"/>)", 32, {}});
    for (std::size_t i = 0; i < points_.places.size(); ++i) {
      fields.back().values.push_back(std::bit_cast<std::uint32_t>(intensity(i)));
    }
    E57FileMaker maker;
    const std::string points = maker.points(fields);
    return maker.file({points});
  }
  E57FileMaker::Field e57_reals(const std::string& name, std::size_t axis) const {
    E57FileMaker::Field field{fmt::format(R"(<{} type="Float" precision="{}"/>)", name,
                                          points_.single ? "single" : "double"),
                              points_.single ? 32U : 64U,
                              {}};
    for (const Place& p : points_.places) {
      field.values.push_back(points_.single
                                 ? std::bit_cast<std::uint32_t>(static_cast<float>(p[axis]))
                                 : std::bit_cast<std::uint64_t>(p[axis]));
    }
    return field;
  }
  E57FileMaker::Field e57_steps(const std::string& name, std::size_t axis) const {
    std::vector<std::int64_t> steps;
    for (const Place& p : points_.places) steps.push_back(std::llround(p[axis] * points_.per_unit));
    const auto [least, most] = std::minmax_element(steps.begin(), steps.end());
    E57FileMaker::Field field{
        fmt::format(R"(<{} type="ScaledInteger" minimum="{}" maximum="{}" scale="{}" offset="0"/>)",
                    name, *least, *most, shortest(1 / points_.per_unit)),
        static_cast<unsigned>(std::bit_width(static_cast<std::uint64_t>(*most - *least))),
        {}};
    for (const std::int64_t step : steps) {
      field.values.push_back(static_cast<std::uint64_t>(step - *least));
    }
    return field;
  }

  const FilePoints& points_;
  PointFormat format_;
};

/// The coordinates in a file that a tool has written, read without the library.
struct WrittenPoints {
  std::vector<Place> places;
  bool single = false;    ///< As floats.
  bool text = false;      ///< As decimal numbers.
  bool too_long = false;  ///< A decimal number has more digits than it needs.
  Place scale{};          ///< Of LAS.
  Place offset{};
};

class PointFileReader {
 public:
  /// \param name  tells the format by its extension
  PointFileReader(const std::string& name, std::string file) : file_(std::move(file)) {
    const std::string extension = name.substr(name.rfind('.'));
    if (extension == ".ply") {
      read_ply();
    } else if (extension == ".pcd") {
      read_pcd();
    } else if (extension == ".las" || extension == ".laz") {
      read_las(extension == ".laz");
    } else {
      read_lines(extension == ".obj");
    }
  }
  const WrittenPoints& points() const { return points_; }

 private:
  template <class T>
  T at(std::size_t place) const {
    T value;
    std::memcpy(&value, file_.data() + place, sizeof(T));
    return value;
  }
  void add_text(const std::array<std::string, 3>& words) {
    Place place;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      place[axis] = std::strtod(words[axis].c_str(), nullptr);
      points_.too_long |= words[axis].size() > shortest(place[axis]).size();
    }
    points_.places.push_back(place);
  }

  void read_lines(bool obj) {
    points_.text = true;
    std::istringstream lines(file_);
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with('#') || line.starts_with('x')) continue;
      if (obj && !line.starts_with("v ")) continue;
      std::replace(line.begin(), line.end(), ',', ' ');
      std::istringstream words(obj ? line.substr(2) : line);
      std::array<std::string, 3> place;
      words >> place[0] >> place[1] >> place[2];
      add_text(place);
    }
  }

  /// Surfels of PLY; of levels of detail the finest.
  void read_ply() {
    struct Property {
      std::string name;
      std::size_t bytes;
      std::size_t at;
    };
    std::vector<Property> properties;
    std::size_t stride = 0;
    std::size_t count = 0;
    bool vertex = false;
    const std::size_t end = file_.find("end_header\n") + 11;
    std::istringstream header(file_.substr(0, end));
    for (std::string line; std::getline(header, line);) {
      std::istringstream words(line);
      std::string first;
      std::string type;
      std::string name;
      words >> first >> type >> name;
      if (first == "format") points_.text = type == "ascii";
      if (first == "element") vertex = type == "vertex";
      if (first == "element" && vertex) count = std::stoul(name);
      if (first != "property" || !vertex) continue;
      const std::size_t bytes = type == "double"                                     ? 8
                                : type == "float" || type == "int" || type == "uint" ? 4
                                : type == "short" || type == "ushort"                ? 2
                                                                                     : 1;
      properties.push_back({name, bytes, stride});
      stride += bytes;
    }
    points_.single = properties.at(0).bytes == 4;
    std::size_t level = 0;
    while (level < properties.size() && properties[level].name != "level") ++level;
    std::istringstream body(points_.text ? file_.substr(end) : "");
    for (std::size_t i = 0; i < count; ++i) {
      if (points_.text) {
        std::string line;
        std::getline(body, line);
        std::istringstream words(line);
        std::array<std::string, 3> place;
        words >> place[0] >> place[1] >> place[2];
        add_text(place);
        continue;
      }
      const std::size_t record = end + i * stride;
      if (level < properties.size() && file_.at(record + properties[level].at) != 0) continue;
      add_binary(record);
    }
  }
  void add_binary(std::size_t record) {
    Place place;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      place[axis] = points_.single ? at<float>(record + 4 * axis) : at<double>(record + 8 * axis);
    }
    points_.places.push_back(place);
  }

  void read_pcd() {
    const auto line = [&](const std::string& key) {
      const std::size_t begin = file_.find("\n" + key + " ") + key.size() + 2;
      return std::istringstream(file_.substr(begin, file_.find('\n', begin) - begin));
    };
    std::size_t stride = 0;
    std::istringstream sizes = line("SIZE");
    for (std::size_t size = 0; sizes >> size; stride += size) {
      if (stride == 0) points_.single = size == 4;
    }
    std::size_t count = 0;
    line("POINTS") >> count;
    const std::size_t begin = file_.find("\nDATA binary\n") + 13;
    for (std::size_t i = 0; i < count; ++i) add_binary(begin + i * stride);
  }

  void read_las(bool compressed) {
    const std::size_t begin = at<std::uint32_t>(96);
    const laz::PointLayout layout{.format = file_.at(104) & 63, .bytes = at<std::uint16_t>(105)};
    const std::size_t count =
        file_.at(25) >= 4 ? at<std::uint64_t>(247) : std::size_t{at<std::uint32_t>(107)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      points_.scale[axis] = at<double>(131 + 8 * axis);
      points_.offset[axis] = at<double>(155 + 8 * axis);
    }
    std::string records = file_.substr(begin);
    if (compressed) {
      // All points are in one chunk, behind the place of the table of chunks.
      const std::size_t end = at<std::uint64_t>(begin);
      const std::string chunk = file_.substr(begin + 8, end - begin - 8);
      records.resize(count * layout.bytes);
      laz::decode_chunk(layout, std::as_bytes(std::span(chunk)), count,
                        reinterpret_cast<std::byte*>(records.data()));
    }
    for (std::size_t i = 0; i < count; ++i) {
      Place place;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        std::int32_t step = 0;
        std::memcpy(&step, records.data() + i * layout.bytes + 4 * axis, sizeof(step));
        place[axis] = step * points_.scale[axis] + points_.offset[axis];
      }
      points_.places.push_back(place);
    }
  }

  std::string file_;
  WrittenPoints points_;
};

}  // namespace surfel::test
