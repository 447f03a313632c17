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

[[noreturn]] void throw_broken(const std::string& file, const std::string& problem) {
  throw_input(file, "its levels of detail are broken: " + problem + "; run surfel-lod again");
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

  /// Clusters [first, last).
  TreeRecords read(std::size_t first, std::size_t last) const {
    TreeRecords out;
    const std::size_t count = last - first;
    out.tree.resize(count);
    out.center.resize(count);
    out.reach.resize(count);
    constexpr std::size_t kGrain = 256;  // Records and rows stay in the second-level cache.
    parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int) {
      Array<std::byte> scratch;
      const std::byte* records = table_.read(first + begin, first + end, scratch);
      std::vector<Row> rows(end - begin);
      for (std::size_t k = 0; k < kColumnCount; ++k) {
        decode_column(table_, *columns_[k], records, k, rows);
      }
      for (std::size_t i = begin; i < end; ++i) take(rows[i - begin], first + i, i, out);
    });
    return out;
  }

  /// The levels of the tree over so many surfels, found by the last cluster of each. Throws
  /// Error(kInput) if they do not make up a tree.
  std::vector<TreeLevel> levels(std::size_t surfels) const {
    std::vector<TreeLevel> found{{0, 1, 0, 0}};
    while (true) {
      TreeLevel& level = found.back();
      const TreeCluster last = read(level.end - 1, level.end).tree.front();
      level.end_surfel = last.end;
      if (last.end < level.first_surfel || last.end > surfels) {
        throw_broken(file_, fmt::format("the clusters hold {} surfels of {}", last.end, surfels));
      }
      if (last.child_count == 0) break;
      const TreeLevel next{level.end, std::size_t{last.first_child} + last.child_count,
                           level.end_surfel, 0};
      if (next.end <= next.begin || next.end > table_.count) {
        throw_broken(file_, fmt::format("cluster {} has the {} children from {} on; of {} "
                                        "clusters, {} is next",
                                        level.end - 1, last.child_count, last.first_child,
                                        table_.count, level.end));
      }
      found.push_back(next);
    }
    if (found.back().end != table_.count) {
      throw_broken(file_, fmt::format("{} of {} clusters are nobody's children",
                                      table_.count - found.back().end, table_.count));
    }
    if (found.back().end_surfel != surfels) {
      throw_broken(file_, fmt::format("the clusters hold {} surfels of {}", found.back().end_surfel,
                                      surfels));
    }
    return found;
  }

 private:
  /// Makes element i of `out` of the values of cluster `number`.
  void take(const Row& row, std::size_t number, std::size_t i, TreeRecords& out) const {
    const auto count = [&](std::size_t k) {
      return whole(row[k], kColumns[k].name, number, file_);
    };
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
                                     kTreeElement, number, level));
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

TreeRecords clusters_from_records(const RecordTable& table, const std::string& file) {
  return TreeReader(table, file).read(0, table.count);
}

TreeRecords tree_from_records(const RecordTable& table, std::size_t surfels,
                              const std::string& file) {
  TreeRecords out = clusters_from_records(table, file);
  if (const std::string problem = tree_problem(out.tree, surfels); !problem.empty()) {
    throw_broken(file, problem);
  }
  return out;
}

TreePartRecords tree_part_from_records(const RecordTable& table, std::size_t surfels,
                                       const std::string& file, int process, int processes) {
  const TreeReader reader(table, file);
  TreePartRecords out;
  TreePart& part = out.part;
  part.levels = reader.levels(surfels);
  std::vector<std::size_t> counts;
  for (const TreeLevel& level : part.levels) counts.push_back(level.end - level.begin);
  const std::size_t dealt = dealt_level(counts, processes);
  const auto level_of = [&](std::size_t place) {
    return static_cast<std::uint8_t>(part.levels.size() - 1 - place);
  };
  // Runs of clusters come one after another; what one begins with is known where it follows
  // another, or begins a level.
  struct Known {
    std::size_t cluster, surfel, child;
  };
  const auto begin_of = [&](std::size_t place) {
    const TreeLevel& level = part.levels[place];
    return Known{level.begin, level.first_surfel, level.end};
  };
  const auto check = [&](std::span<const TreeCluster> run, std::size_t first, std::size_t place,
                         Known& known) {
    std::string problem = run_problem(run, first, level_of(place), table.count, surfels);
    const bool follows = first == known.cluster;
    if (problem.empty() && follows && run.front().begin != known.surfel) {
      problem = fmt::format("cluster {} holds the surfels from {} on; {} is next", first,
                            run.front().begin, known.surfel);
    }
    const bool leaf = run.front().child_count == 0;
    if (problem.empty() && follows && !leaf && run.front().first_child != known.child) {
      problem = fmt::format("cluster {} has the children from {} on; {} is next", first,
                            run.front().first_child, known.child);
    }
    if (!problem.empty()) throw_broken(file, problem);
    const TreeCluster& last = run.back();
    known = {first + run.size(), last.end, std::size_t{last.first_child} + last.child_count};
  };

  // All processes read the top, and keep what is above a subtree of their own.
  const TreeLevel& roots = part.levels[dealt];
  const TreeRecords top = reader.read(0, roots.end);
  for (std::size_t place = 0; place <= dealt; ++place) {
    const TreeLevel& level = part.levels[place];
    Known known = begin_of(place);
    check(std::span(top.tree).subspan(level.begin, level.end - level.begin), level.begin, place,
          known);
  }
  std::vector<bool> kept(roots.end);
  std::vector<bool> drawn(roots.end);
  for (std::size_t i = roots.end; i-- > 0;) {
    if (i >= roots.begin) {
      kept[i] = drawn[i] = dealt_to(i - roots.begin, processes) == process;
      continue;
    }
    const TreeCluster& c = top.tree[i];
    drawn[i] = drawn[c.first_child];
    for (std::size_t k = 0; k < c.child_count; ++k) kept[i] = kept[i] || kept[c.first_child + k];
  }
  kept[0] = true;
  std::uint32_t next_child = 1;
  const auto keep = [&](const TreeRecords& from, std::size_t i, std::size_t number, bool draws,
                        std::uint32_t children) {
    TreeCluster& c = out.records.tree.emplace_back(from.tree[i]);
    c.child_count = children;
    c.first_child = children > 0 ? next_child : 0;
    next_child += children;
    out.records.center.push_back(from.center[i]);
    out.records.reach.push_back(from.reach[i]);
    part.number.push_back(static_cast<std::uint32_t>(number));
    part.drawn.push_back(draws);
  };
  struct Run {
    std::size_t begin, end;
  };
  std::vector<Run> runs;
  for (std::size_t i = 0; i < roots.end; ++i) {
    if (!kept[i]) continue;
    const TreeCluster& c = top.tree[i];
    std::uint32_t children = 0;
    if (i >= roots.begin && drawn[i]) {
      children = c.child_count;
      if (children > 0) runs.push_back({c.first_child, std::size_t{c.first_child} + children});
    } else if (i < roots.begin) {
      for (std::size_t k = 0; k < c.child_count; ++k) children += kept[c.first_child + k] ? 1 : 0;
    }
    keep(top, i, i, drawn[i], children);
  }

  // Below, the descendants of a subtree's root follow one another in each level.
  for (std::size_t place = dealt + 1; place < part.levels.size(); ++place) {
    std::vector<TreeRecords> read(runs.size());
    parallel_for(runs.size(), 1, [&](std::size_t r, std::size_t, int) {
      read[r] = reader.read(runs[r].begin, runs[r].end);
    });
    std::vector<Run> below;
    Known known = begin_of(place);
    for (std::size_t r = 0; r < runs.size(); ++r) {
      const ClusterTree& run = read[r].tree;
      check(run, runs[r].begin, place, known);
      for (std::size_t i = 0; i < run.size(); ++i) {
        keep(read[r], i, runs[r].begin + i, true, run[i].child_count);
      }
      if (place + 1 == part.levels.size()) continue;
      below.push_back(
          {run.front().first_child, std::size_t{run.back().first_child} + run.back().child_count});
    }
    runs = std::move(below);
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
