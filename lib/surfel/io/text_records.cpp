#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/color.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/record_writer.h>
#include <surfel/io/text_records.h>

namespace surfel {
namespace {

/// The shortest decimals that read back as the same colour code.
float code_share(float linear) {
  constexpr float kMost = 65535;
  constexpr float kDigits = 1e6F;
  return std::round(static_cast<float>(linear_to_srgb16(linear)) / kMost * kDigits) / kDigits;
}

void append_vector(std::string_view keyword, const Vec3f& v, std::string& text) {
  text += keyword;
  for (const float component : v) {
    text += ' ';
    append_number(text, component);
  }
  text += '\n';
}

/// The names of columns without the characters that would end a name, each there once.
std::vector<std::string> text_names(const std::vector<RecordColumn>& columns) {
  std::vector<std::string> names;
  for (const RecordColumn& column : columns) {
    std::string& name = names.emplace_back(column.name);
    std::replace_if(
        name.begin(), name.end(),
        [](unsigned char c) { return c <= ' ' || c == ',' || c == ';' || c == '"' || c == 0x7f; },
        '_');
  }
  number_repeated_names(names);
  return names;
}

}  // namespace

void number_repeated_names(std::vector<std::string>& names) {
  for (std::size_t k = 1; k < names.size(); ++k) {
    const auto is_among_first = [&](const std::string& name, std::size_t count) {
      return std::any_of(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(count),
                         [&](const std::string& other) { return same_name(other, name); });
    };
    if (!is_among_first(names[k], k)) continue;
    int number = 2;
    std::string own;
    do {
      own = fmt::format("{}_{}", names[k], number++);
    } while (is_among_first(own, names.size()));
    names[k] = std::move(own);
  }
}

void append_record(const std::byte* record, const std::vector<RecordColumn>& columns,
                   char separator, std::string& text) {
  for (const RecordColumn& column : columns) {
    visit_type(column.type, [&]<class T>(T) {
      append_number(text, load_scalar<T, false>(record + column.offset));
    });
    text += &column == &columns.back() ? '\n' : separator;
  }
}

bool are_known_columns(const std::vector<RecordColumn>& columns) {
  std::string names;
  for (const RecordColumn& column : columns) {
    const bool is_normal = column.name.starts_with('n');
    const bool is_place = column.name == "x" || column.name == "y" || column.name == "z";
    if (column.type >= ScalarType::kFloat32 && !is_normal && !is_place) return false;
    names += column.name + ' ';
  }
  return names == "x y z " || names == "x y z nx ny nz " || names == "x y z red green blue " ||
         names == "x y z nx ny nz red green blue ";
}

std::string column_line(const std::vector<RecordColumn>& columns, char separator) {
  return fmt::format("{}{}\n", separator == ',' ? "" : "# ",
                     fmt::join(text_names(columns), std::string(1, separator)));
}

std::vector<std::string> renamed_in_text(const std::vector<RecordColumn>& columns) {
  std::vector<std::string> lines;
  const std::vector<std::string> names = text_names(columns);
  for (std::size_t k = 0; k < columns.size(); ++k) {
    if (names[k] == columns[k].name) continue;
    lines.push_back(
        fmt::format("{} is named {}: names in text have no blanks, commas or quotes, "
                    "and differ in more than their case",
                    columns[k].name, names[k]));
  }
  return lines;
}

std::string obj_points(const SurfelCloud& cloud, std::size_t begin, std::size_t end) {
  const CloudRecords records(cloud, {.for_text = true});
  // The coordinates are the first columns.
  const std::vector<RecordColumn> position(records.columns().begin(),
                                           records.columns().begin() + 3);
  Array<std::byte> bytes((end - begin) * records.stride());
  records.encode(begin, end, bytes.data());
  std::string text;
  for (std::size_t i = begin; i < end; ++i) {
    text += "v ";
    append_record(bytes.data() + (i - begin) * records.stride(), position, ' ', text);
    if (!cloud.color.empty()) {
      text.pop_back();
      append_vector("", cloud.color[i].unaryExpr(&code_share), text);
    }
  }
  for (std::size_t i = begin; i < end && !cloud.normal.empty(); ++i) {
    append_vector("vn", cloud.normal[i], text);
  }
  return text;
}

std::vector<std::string> columns_without_place_in_obj(const SurfelCloud& cloud) {
  constexpr std::array<std::string_view, 9> kPlaced{"x",  "y",   "z",     "nx",  "ny",
                                                    "nz", "red", "green", "blue"};
  std::vector<std::string> others;
  const CloudRecords records(cloud, {});
  for (const RecordColumn& column : records.columns()) {
    if (std::find(kPlaced.begin(), kPlaced.end(), column.name) == kPlaced.end()) {
      others.push_back(column.name);
    }
  }
  return others;
}

}  // namespace surfel
