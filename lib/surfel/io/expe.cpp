#include <array>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/expe.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::string_view kExpeMagic = "[Expe/PointSet/";

/// A property that is read, and the columns that its values are.
struct ExpeProperty {
  std::string_view name;
  std::size_t bytes;
  ScalarType type;
  std::array<const char*, 3> columns;
};
constexpr std::array<ExpeProperty, 4> kExpeProperties{
    {{"position", 12, ScalarType::kFloat32, {"x", "y", "z"}},
     {"normal", 12, ScalarType::kFloat32, {"nx", "ny", "nz"}},
     {"radius", 4, ScalarType::kFloat32, {"radius"}},
     {"color", 4, ScalarType::kUint8, {"red", "green", "blue"}}}};

/// Adds the columns of a property whose values begin at the table's stride.
void add_property(std::string_view name, std::size_t bytes, RecordTable& table) {
  for (const ExpeProperty& property : kExpeProperties) {
    if (property.name != name || property.bytes != bytes) continue;
    std::size_t at = table.stride;
    for (const char* column : property.columns) {
      if (!column) break;
      table.columns.push_back({column, property.type, at});
      at += scalar_size(property.type);
    }
  }
  table.stride += bytes;
}

}  // namespace

bool is_expe(const InputFile& file) {
  return as_text(file.head(kExpeMagic.size())).starts_with(kExpeMagic);
}

SurfelCloud read_expe(const InputFile& file) {
  TextScanner in(file.name(), file.header("data"), kHeaderText);
  if (!in.rest_of_line().starts_with("[Expe/PointSet/Binary/0.1]")) {
    in.fail("binary Expe point sets of version 0.1 alone are read; convert it");
  }
  constexpr std::size_t kMostBytes = 1024;
  const auto fails = [&](const std::string& message) { in.fail(message); };
  RecordTable table;
  std::uint64_t count = 0;
  bool data = false;
  std::size_t properties = 0;
  while (!data) {
    in.next_line();
    if (in.at_end()) in.fail("the header has no line 'data'; the file is truncated");
    const std::string_view word = in.word();
    if (word == "property") {
      require_few(++properties, "properties of a point", fails);
      const std::string_view name = in.word();
      const std::optional<std::size_t> bytes = parse_count(in.word());
      if (!bytes || *bytes == 0 || *bytes > kMostBytes) {
        in.fail(fmt::format("the property {} has no number of bytes in 1..{}", quoted_excerpt(name),
                            kMostBytes));
      }
      add_property(name, *bytes, table);
    } else if (word == "nofpoints") {
      const std::optional<std::size_t> number = parse_count(in.word());
      if (!number) in.fail("nofpoints is no number of points");
      count = *number;
    } else if (word == "data") {
      data = true;
    }
  }
  in.next_line();
  const std::size_t begin = in.position();
  require_room(count, table.stride, file.size() - begin, kTheHeader, "points",
               [&](const std::string& message) { throw_input(file.name(), message); });
  table.file = &file;
  table.offset = begin;
  table.count = table.stride == 0 ? 0 : count;
  SurfelCloud cloud = cloud_from_records(table, file.name(), false);
  // They were made of meshes: white surfels shown unlit would not be seen on a white picture.
  if (!cloud.color.empty()) cloud.color_light = ColorLight::kReflectance;
  return cloud;
}

}  // namespace surfel
