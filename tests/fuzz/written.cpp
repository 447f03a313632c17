#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/error.h>
#include <surfel/base/scalar_type.h>
#include <surfel/io/cloud_io.h>

#include "fuzz/checks.h"
#include "support/test_data.h"

namespace surfel::fuzz {
namespace {

constexpr std::size_t kMostRows = 24;
constexpr std::size_t kMostColumns = 6;

/// Names of fields of LAS, names that differ in what LAS does not keep, and words that mean
/// something in text.
constexpr const char* kColumnNames[] = {"intensity",
                                        "return_number",
                                        "number_of_returns",
                                        "classification",
                                        "scan_angle",
                                        "scan_angle_rank",
                                        "point_source_id",
                                        "user_data",
                                        "withheld",
                                        "synthetic",
                                        "key_point",
                                        "overlap",
                                        "scanner_channel",
                                        "scan_direction_flag",
                                        "edge_of_flight_line",
                                        "gps_time",
                                        "nir",
                                        "Intensity",
                                        "intensity_2",
                                        "INTENSITY_2",
                                        "a_column_of_more_than_32_characters_a",
                                        "a_column_of_more_than_32_characters_b",
                                        "a_column_of_exactly_32_character",
                                        "extra_0",
                                        "red",
                                        "amplitude",
                                        "nan",
                                        "a,b",
                                        "\"q\"",
                                        "x_2"};

/// Numbers that fields, types and texts have no room for, or lose digits of.
constexpr double kAwkward[] = {std::numeric_limits<double>::quiet_NaN(),
                               std::numeric_limits<double>::infinity(),
                               -std::numeric_limits<double>::infinity(),
                               -0.0,
                               0.1,
                               1.0 / 3,
                               255,
                               256,
                               65535,
                               65536,
                               4294967295.0,
                               4294967296.0,
                               1e9,
                               1e17,
                               1e22,
                               3.5e38,
                               1e300,
                               5e-324};

/// Numbers of few bytes, most of them such as files have.
class FieldNumbers : public Numbers {
 public:
  using Numbers::Numbers;

  double number() {
    switch (byte() % 8) {
      case 0:
        return byte();
      case 1:
        return whole(2);
      case 2:
        return whole(2) / 1000.0;
      case 3:
        return (500000000 + whole(3)) / 1000.0;
      case 4:
        return std::bit_cast<double>(bits(8));
      case 5:
        return static_cast<double>(any());
      case 6:
        return kAwkward[byte() % std::size(kAwkward)];
      default:
        return byte() / 255.0;
    }
  }

 private:
  std::uint64_t bits(int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) value = value << 8 | byte();
    return value;
  }
  double whole(int bytes) {
    return static_cast<double>(static_cast<std::int64_t>(bits(bytes)) - (1 << (8 * bytes - 1)));
  }
};

/// A column of a table, whose values its type holds.
struct TableColumn {
  std::string name;
  ScalarType type;
  std::vector<double> values{};
};

struct Table {
  std::vector<TableColumn> columns;  ///< x, y and z first.
  std::size_t rows = 0;
};

Table made_table(FieldNumbers& numbers) {
  Table table;
  const std::uint8_t kinds = numbers.byte();
  const ScalarType coordinate = kinds % 4 == 0 ? ScalarType::kFloat32 : ScalarType::kFloat64;
  for (const char* axis : {"x", "y", "z"}) table.columns.push_back({axis, coordinate});
  if (kinds / 4 % 4 == 0) {
    const ScalarType color = kinds / 16 % 2 == 0 ? ScalarType::kUint8 : ScalarType::kUint16;
    for (const char* channel : {"red", "green", "blue"}) table.columns.push_back({channel, color});
  }
  const std::size_t others = numbers.byte() % (kMostColumns + 1);
  for (std::size_t k = 0; k < others; ++k) {
    const std::string name = kColumnNames[numbers.byte() % std::size(kColumnNames)];
    const auto type = static_cast<ScalarType>(numbers.byte() % 8);
    const bool taken = std::any_of(table.columns.begin(), table.columns.end(),
                                   [&](const TableColumn& other) { return other.name == name; });
    if (!taken) table.columns.push_back({name, type});
  }
  for (; !numbers.done() && table.rows < kMostRows; ++table.rows) {
    for (TableColumn& column : table.columns) {
      const double value = numbers.number();
      column.values.push_back(visit_type(column.type, [&]<class T>(T) {
        using Limits = std::numeric_limits<T>;
        if (std::is_same_v<T, double>) return value;
        const bool real = std::is_floating_point_v<T>;
        const bool fits = value >= static_cast<double>(Limits::lowest()) &&
                          value <= static_cast<double>(Limits::max());
        if (!fits && !(real && !std::isfinite(value))) return 1.0;
        return static_cast<double>(static_cast<T>(value));
      }));
    }
  }
  return table;
}

/// The table as binary PLY.
std::string ply_of(const Table& table) {
  constexpr const char* kTypes[] = {"char", "uchar", "short", "ushort",
                                    "int",  "uint",  "float", "double"};
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(table.rows) + "\n";
  for (const TableColumn& column : table.columns) {
    const char* type = kTypes[static_cast<std::size_t>(column.type)];
    file += std::string("property ") + type + " " + column.name + "\n";
  }
  file += "end_header\n";
  for (std::size_t row = 0; row < table.rows; ++row) {
    for (const TableColumn& column : table.columns) {
      visit_type(column.type, [&]<class T>(T) {
        const auto value = static_cast<T>(column.values[row]);
        file.append(reinterpret_cast<const char*>(&value), sizeof(value));
      });
    }
  }
  return file;
}

bool same_value(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

/// Is a number a float that is written as the other?
bool is_float_of(double number, double written) {
  const auto nearest = static_cast<float>(number);
  if (number != static_cast<double>(nearest)) return false;
  std::array<char, 32> text{};
  const char* const end = std::to_chars(text.data(), text.data() + text.size(), nearest).ptr;
  double value = 0;
  std::from_chars(text.data(), end, value);
  return value == written;
}

/// Text tells a float by the shortest decimal that reads back as the same float.
bool same_text(double a, double b) {
  return same_value(a, b) || is_float_of(a, b) || is_float_of(b, a);
}

std::string in_lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// The values of a column of what was read; empty if there is none of that name. Case counts only
/// where two names differ in nothing else.
std::vector<double> column_values(const SurfelCloud& cloud, const std::string& name) {
  const auto find = [&](auto is_same) {
    return std::find_if(cloud.extra.begin(), cloud.extra.end(),
                        [&](const ExtraProperty& property) { return is_same(property.name); });
  };
  auto found = find([&](const std::string& other) { return other == name; });
  if (found == cloud.extra.end()) {
    found =
        find([&](const std::string& other) { return in_lower_case(other) == in_lower_case(name); });
  }
  std::vector<double> values;
  if (found == cloud.extra.end()) return values;
  values.resize(cloud.size());
  load_scalars(found->type, found->data.data(), values.size(), values.data());
  return values;
}

/// A kind of file that clouds are written to.
struct FileKind {
  const char* extension;
  bool las;  ///< Whole steps of coordinates, fields of few bits, names of 32 characters.
  bool text;
};
constexpr FileKind kFileKinds[] = {
    {".ply", false, false}, {".csv", false, true}, {".xyz", false, true},
    {".pcd", false, false}, {".las", true, false}, {".laz", true, false},
};

constexpr std::size_t kLas = 4;
constexpr std::size_t kLaz = 5;

/// The coordinate of a file that was read, to the last bit. Offsets from the origin tell numbers of
/// few decimals, and the steps of LAS, apart; which one it was, the decimals or the steps say.
double file_coordinate(const SurfelCloud& cloud, std::size_t i, std::size_t axis) {
  const auto a = static_cast<Eigen::Index>(axis);
  const double x = cloud.world(i)[a];
  if (!cloud.exact.empty()) return x;
  if (cloud.las) {
    const double offset = cloud.las->offset[a];
    return std::round((x - offset) / cloud.las->scale[a]) * cloud.las->scale[a] + offset;
  }
  if (!cloud.decimals) return x;
  const double per_unit = std::pow(10, *cloud.decimals);
  return std::abs(x) * per_unit < 0x1p53 ? std::round(x * per_unit) / per_unit : x;
}

void require_same_coordinates(const Table& table, const SurfelCloud& read, bool text) {
  const auto same = text ? same_text : same_value;
  for (std::size_t i = 0; i < table.rows; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      require(same(file_coordinate(read, i, axis), table.columns[axis].values[i]),
              "a coordinate is another one after writing");
    }
  }
}

/// Coordinates of LAS are whole steps. Without a note they are those that were read, but for digits
/// that the cloud's floats do not have.
void require_near_coordinates(const Table& table, const SurfelCloud& cloud, const SurfelCloud& read,
                              bool said) {
  float reach = 0;
  for (const Vec3f& position : cloud.position) {
    reach = std::max(reach, position.cwiseAbs().maxCoeff());
  }
  const double most_unsaid = cloud.exact.empty() ? static_cast<double>(reach) * 0x1p-24 : 0;
  require(read.las.has_value(), "a LAS file tells no steps");
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    for (std::size_t i = 0; i < table.rows; ++i) {
      const double truth = table.columns[axis].values[i];
      const double rounding = (std::abs(truth) + std::abs(read.las->offset[a])) * 0x1p-50;
      const double error = std::abs(file_coordinate(read, i, axis) - truth) - rounding;
      require(error <= 0.5 * std::abs(read.las->scale[a]),
              "a coordinate is off by more than half a step");
      require(said || error <= most_unsaid, "a coordinate is rounded, and no note says so");
    }
  }
}

/// The largest code of the table's colours; nullopt where it has none.
std::optional<double> brightest_code(const Table& table) {
  if (table.columns.size() < 6 || table.columns[4].name != "green") return {};
  double most = 0;
  for (std::size_t k = 3; k < 6; ++k) {
    for (const double code : table.columns[k].values) most = std::max(most, code);
  }
  return most;
}

/// Are these colours that a file cannot tell from something else? LAS has zeros where there are no
/// colours, and text that holds 0 and 1 alone means shares of white, or normals. Codes of 16 bits
/// that fit into 8 are read as such by both.
bool are_ambiguous_colors(const Table& table, const FileKind& kind) {
  const std::optional<double> most = brightest_code(table);
  if (!most || !(kind.las || kind.text)) return false;
  return *most <= (table.columns[3].type == ScalarType::kUint16 ? 255 : kind.text ? 1 : 0);
}

/// Every column comes back as it was, or a note that begins with its name says what changed.
void require_columns(const Table& table, const SurfelCloud& read, const FileKind& kind,
                     const std::vector<std::string>& notes) {
  const bool skips_colors =
      brightest_code(table) && (!read.color.empty() || are_ambiguous_colors(table, kind));
  for (std::size_t k = skips_colors ? 6 : 3; k < table.columns.size(); ++k) {
    const TableColumn& column = table.columns[k];
    const bool noted = std::any_of(notes.begin(), notes.end(), [&](const std::string& note) {
      return note.starts_with(column.name + ": ") || note.starts_with(column.name + " is named ");
    });
    if (noted) continue;
    const std::vector<double> after =
        column_values(read, kind.las ? column.name.substr(0, 32) : column.name);
    require(std::equal(column.values.begin(), column.values.end(), after.begin(), after.end(),
                       kind.text ? same_text : same_value),
            "column " + column.name + " is another one after writing, and no note says so");
  }
}

/// Colours come back as the same codes, whose linear light differs by rounding alone.
void require_colors(const Table& table, const SurfelCloud& cloud, const SurfelCloud& read,
                    const FileKind& kind) {
  constexpr float kRounding = 1e-6F;
  if (cloud.color.empty() || are_ambiguous_colors(table, kind)) return;
  require(read.color.size() == cloud.color.size(), "colours are lost");
  for (std::size_t i = 0; i < cloud.color.size(); ++i) {
    require((read.color[i] - cloud.color[i]).cwiseAbs().maxCoeff() <= kRounding,
            "a colour is another one after writing");
  }
}

/// What was read and written once more is the same.
void require_same_cloud(const SurfelCloud& a, const SurfelCloud& b, bool text) {
  const auto same = text ? same_text : same_value;
  require(a.size() == b.size() && a.extra.size() == b.extra.size() && a.color == b.color,
          "what was read is another cloud after writing");
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      require(same(file_coordinate(a, i, axis), file_coordinate(b, i, axis)),
              "a coordinate that was read is another one after writing");
    }
  }
  for (std::size_t k = 0; k < a.extra.size(); ++k) {
    require(a.extra[k].name == b.extra[k].name && a.extra[k].data == b.extra[k].data,
            "column " + a.extra[k].name + " that was read is another one after writing");
  }
}

}  // namespace

/// Do the finite coordinates lie within a box that docs/reliability.md promises to work with?
bool has_usable_extent(const Table& table) {
  Bounds box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double x : table.columns[axis].values) {
      if (!std::isfinite(x)) continue;
      double& min = box.min[static_cast<Eigen::Index>(axis)];
      double& max = box.max[static_cast<Eigen::Index>(axis)];
      min = std::min(min, x);
      max = std::max(max, x);
    }
  }
  const double extent = (box.max - box.min).maxCoeff();
  return extent <= 0 || (extent >= 1e-15 && extent <= 1e18);
}

/// Makes a table of few rows of the bytes, whose columns have names of LAS fields and any values,
/// and writes it as the first byte says: coordinates and columns are read again as they were, but
/// for what notes say. What was read of one in four inputs is written once more, as it is.
void written(Bytes bytes) {
  static const test::TemporaryFolder folder;
  FieldNumbers numbers(bytes);
  const std::uint8_t choice = numbers.byte();
  // LAZ takes twice as long as the others, and its coder has fuzzers of its own.
  const bool as_las = choice % std::size(kFileKinds) == kLaz && choice >= 128;
  const FileKind& kind = kFileKinds[as_las ? kLas : choice % std::size(kFileKinds)];
  const Table table = made_table(numbers);
  if (table.rows == 0) return;
  const std::string source = ply_of(table);
  SurfelCloud cloud;
  try {
    cloud = read_cloud({"/fuzz/table.ply", std::as_bytes(std::span(source.data(), source.size()))});
  } catch (const Error& error) {
    require(!has_usable_extent(table), std::string("a cloud is not read: ") + error.what());
    return;
  }
  require(has_usable_extent(table), "a cloud of an extent that is not promised is read");
  require_same_coordinates(table, cloud, false);

  const std::string path = folder / (std::string("a") + kind.extension);
  std::vector<std::string> notes;
  try {
    notes = write_cloud(cloud, path);
  } catch (const Error& error) {
    const bool finite = std::all_of(table.columns.begin(), table.columns.begin() + 3, [](auto& c) {
      return std::all_of(c.values.begin(), c.values.end(),
                         [](double x) { return std::abs(x) <= 3e38; });
    });
    require(kind.las && !finite, std::string("a cloud is not written: ") + error.what());
    return;
  }
  const SurfelCloud read = read_cloud(path);
  require(read.size() == table.rows, "points are lost");
  if (kind.las) {
    const bool said = std::any_of(notes.begin(), notes.end(), [](const std::string& note) {
      return note.starts_with("coordinates ");
    });
    require_near_coordinates(table, cloud, read, said);
  } else {
    require_same_coordinates(table, read, kind.text);
  }
  require_columns(table, read, kind, notes);
  require_colors(table, cloud, read, kind);

  // To write and read once more takes as long as all before, and seldom finds more.
  if (bytes.size() % 4 != 0) return;
  require(write_cloud(read, path).empty(), "what was read is not written as it is");
  require_same_cloud(read, read_cloud(path), kind.text);
}

}  // namespace surfel::fuzz
