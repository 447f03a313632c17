#include <array>
#include <bit>
#include <limits>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/tree_records.h>

namespace surfel {
namespace {

struct Column {
  const char* name;
  ScalarType type;
};
constexpr Column kColumns[] = {{"begin", ScalarType::kUint32},
                               {"count", ScalarType::kUint32},
                               {"first_child", ScalarType::kUint32},
                               {"child_count", ScalarType::kUint32},
                               {"level", ScalarType::kUint8},
                               {"x", ScalarType::kFloat64},
                               {"y", ScalarType::kFloat64},
                               {"z", ScalarType::kFloat64},
                               {"radius", ScalarType::kFloat32},
                               {"spacing", ScalarType::kFloat32},
                               {"max_deviation", ScalarType::kFloat32},
                               {"cone_x", ScalarType::kFloat32},
                               {"cone_y", ScalarType::kFloat32},
                               {"cone_z", ScalarType::kFloat32},
                               {"cone_cosine", ScalarType::kFloat32},
                               {"min_x", ScalarType::kFloat64},
                               {"min_y", ScalarType::kFloat64},
                               {"min_z", ScalarType::kFloat64},
                               {"max_x", ScalarType::kFloat64},
                               {"max_y", ScalarType::kFloat64},
                               {"max_z", ScalarType::kFloat64}};
constexpr std::size_t kColumnCount = std::size(kColumns);
using Row = std::array<double, kColumnCount>;

/// The values of a cluster in the order of kColumns.
Row to_row(const TreeCluster& c, const Vec3d& origin) {
  const ClusterBounds& b = c.bounds;
  const auto world = [&](const Vec3f& v) -> Vec3d { return origin + v.cast<double>(); };
  Row row;
  double* out = row.data();
  const auto add = [&](auto... values) { ((*out++ = static_cast<double>(values)), ...); };
  const auto add_vector = [&](const auto& v) { add(v.x(), v.y(), v.z()); };
  add(c.begin, c.end - c.begin, c.first_child, c.child_count, c.level);
  add_vector(world(b.center));
  add(b.radius, c.spacing, b.max_deviation);
  add_vector(b.cone_axis);
  add(b.cone_cosine);
  add_vector(world(c.reach_min));
  add_vector(world(c.reach_max));
  return row;
}

/// Largest coordinate that is accepted: the difference of two such coordinates is finite in float.
constexpr double kFurthest = 1e37;

/// A count or index, whose column may be of any type.
std::uint32_t whole(double value, const char* name, std::size_t row, const std::string& file) {
  if (!(value >= 0 && value <= std::numeric_limits<std::uint32_t>::max())) {
    throw_input(file, fmt::format("{} {}: {} is {}, which is out of range; run surfel-lod again",
                                  kTreeElement, row, name, value));
  }
  return static_cast<std::uint32_t>(value);
}

/// Decodes a column of consecutive records into element k of the rows.
void decode_column(const RecordTable& table, const RecordColumn& column, const std::byte* records,
                   std::size_t k, std::vector<Row>& rows) {
  visit_type(column.type, [&]<class T>(T) {
    const std::byte* at = records + column.offset;
    for (Row& row : rows) {
      row[k] =
          static_cast<double>(table.swapped ? load_scalar<T, true>(at) : load_scalar<T, false>(at));
      at += table.stride;
    }
  });
}

/// Reads clusters from the records of the element.
class TreeReader {
 public:
  /// Throws Error(kInput) if a column is missing. Keeps references.
  TreeReader(const RecordTable& table, const std::string& file) : table_(table), file_(file) {
    if (table.count == 0) throw_input(file, fmt::format("element {} is empty", kTreeElement));
    for (std::size_t k = 0; k < kColumnCount; ++k) {
      columns_[k] = table.find(kColumns[k].name);
      if (!columns_[k]) {
        throw_input(file, fmt::format("element {} has no property {}; run surfel-lod again",
                                      kTreeElement, kColumns[k].name));
      }
    }
  }

  TreeRecords read() const {
    TreeRecords out;
    out.tree.resize(table_.count);
    out.center.resize(table_.count);
    out.reach.resize(table_.count);
    constexpr std::size_t kGrain = 256;  // Records and rows stay in the second-level cache.
    parallel_for(table_.count, kGrain, [&](std::size_t begin, std::size_t end, int) {
      Array<std::byte> scratch;
      const std::byte* records = table_.read(begin, end, scratch);
      std::vector<Row> rows(end - begin);
      for (std::size_t k = 0; k < kColumnCount; ++k) {
        decode_column(table_, *columns_[k], records, k, rows);
      }
      for (std::size_t i = begin; i < end; ++i) take(rows[i - begin], i, out);
    });
    return out;
  }

 private:
  /// Makes cluster i of `out` of its values.
  void take(const Row& row, std::size_t i, TreeRecords& out) const {
    const auto count = [&](std::size_t k) { return whole(row[k], kColumns[k].name, i, file_); };
    const auto real = [&](std::size_t k) { return static_cast<float>(row[k]); };
    TreeCluster& c = out.tree[i];
    c.begin = count(0);
    // A sum past 2^32 wraps to an end that tree_problem() refuses.
    c.end = c.begin + count(1);
    c.first_child = count(2);
    c.child_count = count(3);
    const std::uint32_t level = count(4);
    if (level > std::numeric_limits<std::uint8_t>::max()) {
      throw_input(file_, fmt::format("{} {}: level is {}, which is out of range; run surfel-lod "
                                     "again",
                                     kTreeElement, i, level));
    }
    c.level = static_cast<std::uint8_t>(level);
    out.center[i] = Vec3d(row[5], row[6], row[7]);
    c.bounds.radius = real(8);
    c.spacing = real(9);
    c.bounds.max_deviation = real(10);
    c.bounds.cone_axis = {real(11), real(12), real(13)};
    c.bounds.cone_cosine = real(14);
    Bounds& reach = out.reach[i];
    reach.min = {row[15], row[16], row[17]};
    reach.max = {row[18], row[19], row[20]};
    const auto usable = [](const Vec3d& v) { return (v.array().abs() <= kFurthest).all(); };
    const bool sound = usable(out.center[i]) && usable(reach.min) && usable(reach.max) &&
                       (reach.min.array() <= reach.max.array()).all();
    if (!sound) c.bounds.radius = std::numeric_limits<float>::quiet_NaN();
  }

  const RecordTable& table_;
  const std::string& file_;
  const RecordColumn* columns_[kColumnCount];
};

}  // namespace

std::vector<RecordColumn> tree_columns() {
  std::vector<RecordColumn> columns;
  std::size_t offset = 0;
  for (const Column& column : kColumns) {
    columns.push_back({column.name, column.type, offset});
    offset += scalar_size(column.type);
  }
  return columns;
}

std::string ply_element(const std::string& name, const std::vector<RecordColumn>& columns,
                        std::size_t count) {
  std::string lines = fmt::format("element {} {}\n", name, count);
  for (const RecordColumn& column : columns) {
    lines += fmt::format("property {} {}\n", scalar_name(column.type), column.name);
  }
  return lines;
}

Array<std::byte> tree_to_records(std::span<const TreeCluster> tree, const Vec3d& origin) {
  const std::vector<RecordColumn> columns = tree_columns();
  const std::size_t stride = columns.back().offset + scalar_size(columns.back().type);
  Array<std::byte> bytes(tree.size() * stride);
  for (std::size_t i = 0; i < tree.size(); ++i) {
    const Row row = to_row(tree[i], origin);
    for (std::size_t k = 0; k < row.size(); ++k) {
      visit_type(columns[k].type, [&]<class T>(T) {
        const T value = static_cast<T>(row[k]);
        std::memcpy(bytes.data() + i * stride + columns[k].offset, &value, sizeof(T));
      });
    }
  }
  return bytes;
}

TreeRecords tree_from_records(const RecordTable& table, std::size_t surfels,
                              const std::string& file) {
  TreeRecords out = TreeReader(table, file).read();
  if (const std::string problem = tree_problem(out.tree, surfels); !problem.empty()) {
    throw_input(file, "its levels of detail are broken: " + problem + "; run surfel-lod again");
  }
  return out;
}

ClusterTree recentered_tree(TreeRecords records, const Vec3d& origin) {
  for (std::size_t i = 0; i < records.tree.size(); ++i) {
    TreeCluster& cluster = records.tree[i];
    cluster.bounds.center = (records.center[i] - origin).cast<float>();
    cluster.reach_min = (records.reach[i].min - origin).cast<float>();
    cluster.reach_max = (records.reach[i].max - origin).cast<float>();
  }
  return std::move(records.tree);
}

}  // namespace surfel
