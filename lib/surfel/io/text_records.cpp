#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

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

}  // namespace

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
  std::string line = separator == ',' ? "" : "# ";
  for (const RecordColumn& column : columns) {
    std::string name = column.name;
    std::replace_if(
        name.begin(), name.end(),
        [](unsigned char c) { return c <= ' ' || c == ',' || c == ';' || c == '"' || c == 0x7f; },
        '_');
    line += name;
    line += &column == &columns.back() ? '\n' : separator;
  }
  return line;
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
