#include <algorithm>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <span>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/version.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/input_file.h>
#include <surfel/io/pcd.h>
#include <surfel/io/ply.h>
#include <surfel/io/text_numbers.h>
#include <surfel/io/tree_records.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

constexpr std::string_view kVersionComment = "surfel ";
constexpr std::string_view kBasisComment = "surfel_basis ";
constexpr std::string_view kProvenanceComment = "surfel_provenance ";
constexpr std::string_view kViewpointComment = "surfel_viewpoint ";

/// Blank-separated numbers, exactly as many as `values` has; false if they are not there.
bool parse_numbers(std::string_view text, std::span<double> values) {
  TextNumbers words({}, std::as_bytes(std::span(text)), 0);
  for (double& value : values) {
    const auto word = words.next();
    const auto number = word ? parse_number(*word) : std::nullopt;
    if (!number) return false;
    value = *number;
  }
  return !words.next();
}

/// Sorts the header's comments: what applies to the whole cloud, and the others.
void read_comments(const std::vector<std::string>& comments, const std::string& file,
                   SurfelCloud& cloud) {
  for (const std::string& comment : comments) {
    const std::string_view text = comment;
    if (text.starts_with(kProvenanceComment)) {
      cloud.provenance.emplace_back(text.substr(kProvenanceComment.size()));
    } else if (text.starts_with(kBasisComment)) {
      double cutoff = 0;
      if (!parse_numbers(text.substr(kBasisComment.size()), {&cutoff, 1}) || !(cutoff > 0)) {
        throw_input(file, "the header comment " + quoted_excerpt(text) + " has no cutoff > 0");
      }
      cloud.basis_cutoff = cutoff;
    } else if (text.starts_with(kViewpointComment)) {
      double view[7];
      if (!parse_numbers(text.substr(kViewpointComment.size()), view)) {
        throw_input(file, "the header comment " + quoted_excerpt(text) + " has not seven numbers");
      }
      cloud.viewpoint = Viewpoint{Vec3d(view), Eigen::Vector4d(view + 3)};
    } else if (!text.starts_with(kVersionComment)) {
      cloud.comments.push_back(comment);
    }
  }
}

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  return text;
}

/// The reverse of read_comments(). PCD has a header line of its own for the viewpoint.
std::vector<std::string> write_comments(const SurfelCloud& cloud, bool with_viewpoint) {
  std::vector<std::string> lines{std::string(kVersionComment) + version()};
  if (cloud.basis_cutoff) lines.push_back(fmt::format("{}{}", kBasisComment, *cloud.basis_cutoff));
  if (with_viewpoint && cloud.viewpoint) {
    const Vec3d& t = cloud.viewpoint->position;
    const Eigen::Vector4d& q = cloud.viewpoint->orientation;
    lines.push_back(fmt::format("{}{} {} {} {} {} {} {}", kViewpointComment, t[0], t[1], t[2], q[0],
                                q[1], q[2], q[3]));
  }
  for (const std::string& line : cloud.provenance) {
    lines.push_back(std::string(kProvenanceComment) + one_line(line));
  }
  for (const std::string& line : cloud.comments) lines.push_back(one_line(line));
  return lines;
}

SurfelCloud read_ply(InputFile input, const CloudReadOptions& options) {
  PlyFile ply(std::move(input));
  const PlyElement* vertex = ply.header().find("vertex");
  if (!vertex) throw_input(ply.name(), "holds no points: it has no element 'vertex'");
  const PlyProperty* x = vertex->find("x");
  const bool double_positions = x && x->type == ScalarType::kFloat64;
  RecordTable records = ply.scalars("vertex", {"x", "y", "z"});
  std::optional<TreeRecords> levels;
  std::size_t coarser = 0;
  if (ply.header().find(kTreeElement)) {
    levels = tree_from_records(ply.scalars(kTreeElement), records.count, ply.name());
    if (!options.levels) coarser = levels->tree[first_leaf(levels->tree)].begin;
  }
  // The finest level is the last.
  records.data += coarser * records.stride;
  records.count -= coarser;
  SurfelCloud cloud = cloud_from_records(records, ply.name(), double_positions);
  if (levels && options.levels) {
    cloud.tree = recentered_tree(std::move(*levels), cloud.origin);
  } else if (levels) {
    cloud.level = {};
    cloud.coarser_skipped = coarser;
  }
  read_comments(ply.header().comments, ply.name(), cloud);
  return cloud;
}

SurfelCloud read_pcd(InputFile input) {
  const std::string name = input.name();
  const PcdFile pcd(std::move(input));
  SurfelCloud cloud = cloud_from_records(pcd.records(), name, pcd.double_positions());
  cloud.viewpoint = pcd.viewpoint();
  read_comments(pcd.comments(), name, cloud);
  return cloud;
}

bool has_extension(const std::string& path, std::string_view extension) {
  if (path.size() < extension.size()) return false;
  return std::equal(extension.begin(), extension.end(),
                    path.end() - static_cast<std::ptrdiff_t>(extension.size()), [](char a, char b) {
                      return a == std::tolower(static_cast<unsigned char>(b));
                    });
}

std::string ply_element(const char* name, const std::vector<RecordColumn>& columns,
                        std::size_t count) {
  std::string lines = fmt::format("element {} {}\n", name, count);
  for (const RecordColumn& column : columns) {
    lines += fmt::format("property {} {}\n", scalar_name(column.type), column.name);
  }
  return lines;
}

std::string ply_header(const std::vector<RecordColumn>& columns, const SurfelCloud& cloud,
                       bool ascii, const std::vector<std::string>& comments) {
  std::string header = "ply\n";
  header += ascii ? "format ascii 1.0\n" : "format binary_little_endian 1.0\n";
  for (const std::string& comment : comments) header += "comment " + comment + "\n";
  header += ply_element("vertex", columns, cloud.size());
  if (!cloud.tree.empty()) header += ply_element(kTreeElement, tree_columns(), cloud.tree.size());
  return header + "end_header\n";
}

/// A record as a line of text; every value reads back as it was.
void append_text(const std::byte* record, const std::vector<RecordColumn>& columns,
                 std::string& text) {
  char buffer[64];
  for (std::size_t k = 0; k < columns.size(); ++k) {
    visit_type(columns[k].type, [&]<class T>(T) {
      const auto value = load_scalar<T, false>(record + columns[k].offset);
      const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
      text.append(buffer, end);
    });
    text += k + 1 == columns.size() ? '\n' : ' ';
  }
}

/// Writes all records, some at a time: as they are, or as text.
void write_records(const CloudRecords& records, std::size_t count, bool ascii, OutputFile& file) {
  constexpr std::size_t kGrain = 4096;
  constexpr std::size_t kChunk = 64 * kGrain;
  const std::size_t stride = records.stride();
  Array<std::byte> bytes(std::min(count, kChunk) * stride);
  std::vector<std::string> texts(ascii ? kChunk / kGrain : 0);
  for (std::size_t first = 0; first < count; first += kChunk) {
    const std::size_t chunk = std::min(kChunk, count - first);
    parallel_for(chunk, kGrain, [&](std::size_t begin, std::size_t end, int) {
      records.encode(first + begin, first + end, bytes.data() + begin * stride);
      if (!ascii) return;
      std::string& text = texts[begin / kGrain];
      text.clear();
      for (std::size_t i = begin; i < end; ++i) {
        append_text(bytes.data() + i * stride, records.columns(), text);
      }
    });
    if (!ascii) file.write(bytes.data(), chunk * stride);
    for (std::size_t k = 0; ascii && k * kGrain < chunk; ++k) file.write(texts[k]);
  }
}

void write_tree(const SurfelCloud& cloud, bool ascii, OutputFile& file) {
  const std::vector<RecordColumn> columns = tree_columns();
  const Array<std::byte> bytes = tree_to_records(cloud);
  if (!ascii) return file.write(bytes.data(), bytes.size());
  const std::size_t stride = bytes.size() / cloud.tree.size();
  std::string text;
  for (std::size_t i = 0; i < cloud.tree.size(); ++i) {
    append_text(bytes.data() + i * stride, columns, text);
  }
  file.write(text);
}

}  // namespace

SurfelCloud read_cloud(const std::string& path, const CloudReadOptions& options) {
  InputFile input(path);
  if (input.bytes().empty()) throw_input(input.name(), "is empty");
  if (PlyFile::matches(input.bytes())) return read_ply(std::move(input), options);
  if (PcdFile::matches(input.bytes())) return read_pcd(std::move(input));
  if (has_extension(path, ".ply"))
    throw_input(path, "is not a PLY file: it does not start with 'ply'");
  if (has_extension(path, ".pcd")) throw_input(path, "is not a PCD file: it has no PCD header");
  if (is_xyz_name(path)) return read_xyz(input);
  throw_input(
      input.name(),
      "format not supported; surfels and points are read from PLY, PCD and text (XYZ, PTS)");
}

void write_cloud(const SurfelCloud& cloud, const std::string& path,
                 const CloudWriteOptions& options) {
  static_assert(std::endian::native == std::endian::little, "records are written as they are");
  cloud.check_columns(path);
  const bool pcd = has_extension(path, ".pcd");
  if (pcd && !cloud.tree.empty()) {
    throw_usage(fmt::format("{}: levels of detail are written to PLY only; give a .ply", path));
  }
  const bool ascii = options.ascii && !pcd;
  const CloudRecords records(cloud, {.pcl_names = pcd, .for_text = ascii});
  const std::vector<std::string> comments = write_comments(cloud, !pcd);
  OutputFile file(path, options.no_clobber);
  file.write(pcd ? pcd_header(records.columns(), cloud.size(), cloud.viewpoint, comments)
                 : ply_header(records.columns(), cloud, ascii, comments));
  write_records(records, cloud.size(), ascii, file);
  if (!cloud.tree.empty()) write_tree(cloud, ascii, file);
  file.commit();
}

}  // namespace surfel
