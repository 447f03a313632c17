#include <algorithm>
#include <bit>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/io/cloud_comments.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/cloud_writer.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/las_writer.h>
#include <surfel/io/pcd.h>
#include <surfel/io/ply.h>
#include <surfel/io/text_records.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/tree_records.h>
#include <surfel/io/xyz.h>

namespace surfel {
namespace {

/// Records that one thread makes at a time: they fit into its cache.
constexpr std::size_t kWriteBlock = 4096;

/// Each thread writes what it has made: one makes while another writes.
void write_binary(const CloudRecords& records, std::size_t count, OutputFile& file) {
  const std::size_t stride = records.stride();
  const std::uint64_t offset = file.reserve(std::uint64_t{count} * stride);
  PerWorker<Array<std::byte>> buffers;
  ProgressStage stage("writing", count, "surfels");
  parallel_for(count, kWriteBlock, [&](std::size_t begin, std::size_t end, int worker) {
    Array<std::byte>& buffer = buffers[worker];
    buffer.resize(kWriteBlock * stride);
    records.encode(begin, end, buffer.data());
    file.write_at(offset + begin * stride, buffer.data(), (end - begin) * stride);
    stage.add(end - begin);
  });
}

/// Writes some blocks of surfels at a time: threads make their text, then it is written in order.
/// \param text_of  text_of(begin, end) is the text of the surfels [begin, end).
template <class TextOf>
void write_text(std::size_t count, const TextOf& text_of, OutputFile& file) {
  constexpr std::size_t kChunk = 64 * kWriteBlock;  // Blocks for all threads, in little memory.
  std::vector<std::string> texts(kChunk / kWriteBlock);
  ProgressStage stage("writing", count, "surfels");
  for (std::size_t first = 0; first < count; first += kChunk) {
    const std::size_t chunk = std::min(kChunk, count - first);
    parallel_for(chunk, kWriteBlock, [&](std::size_t begin, std::size_t end, int) {
      texts[begin / kWriteBlock] = text_of(first + begin, first + end);
    });
    for (std::size_t k = 0; k * kWriteBlock < chunk; ++k) file.write(texts[k]);
    stage.add(chunk);
  }
}

void write_text(const CloudRecords& records, std::size_t count, char separator, OutputFile& file) {
  const auto text_of = [&](std::size_t begin, std::size_t end) {
    Array<std::byte> bytes((end - begin) * records.stride());
    records.encode(begin, end, bytes.data());
    std::string text;
    for (std::size_t i = 0; i < end - begin; ++i) {
      append_record(bytes.data() + i * records.stride(), records.columns(), separator, text);
    }
    return text;
  };
  write_text(count, text_of, file);
}

void write_tree(const SurfelCloud& cloud, bool ascii, OutputFile& file) {
  const std::vector<RecordColumn> columns = tree_columns();
  const Array<std::byte> bytes = tree_to_records(cloud.tree, cloud.origin);
  if (!ascii) return file.write(bytes.data(), bytes.size());
  const std::size_t stride = bytes.size() / cloud.tree.size();
  std::string text;
  for (std::size_t i = 0; i < cloud.tree.size(); ++i) {
    append_record(bytes.data() + i * stride, columns, ' ', text);
  }
  file.write(text);
}

/// How a file holds surfels, as its name says.
enum class CloudFormat { kPly, kPcd, kLas, kText, kObj };

CloudFormat format_of(const std::string& path) {
  refuse_copc_name(path);
  const std::string extension = lower_extension(path);
  if (extension == ".pcd") return CloudFormat::kPcd;
  if (is_las_name(path)) return CloudFormat::kLas;
  if (extension == ".obj") return CloudFormat::kObj;
  return is_xyz_name(path) ? CloudFormat::kText : CloudFormat::kPly;
}

}  // namespace

struct CloudWriter::Impl {
  std::string path;
  std::size_t count;
  CloudWriteOptions options;
  CloudFormat format;
  std::optional<CloudSurvey> survey;
  std::optional<LasWriter> las;
  std::optional<OutputFile> file;
  std::vector<RecordColumn> columns;
  std::size_t written = 0;

  Impl(std::string to, std::size_t n, std::optional<CloudSurvey> all, const CloudWriteOptions& o)
      : path(std::move(to)), count(n), options(o), format(format_of(path)), survey(std::move(all)) {
    if (format != CloudFormat::kLas) {
      file.emplace(path, o.no_clobber);
    } else if (survey) {
      las.emplace(path, *survey, o.no_clobber);
    } else {
      throw_usage(fmt::format(
          "{}: LAS files are not written before all points are known; give a .ply", path));
    }
  }

  bool text() const {
    return format == CloudFormat::kText || (format == CloudFormat::kPly && options.ascii);
  }
  char separator() const {
    return format == CloudFormat::kText && lower_extension(path) == ".csv" ? ',' : ' ';
  }
  std::string header(const SurfelCloud& first) const {
    if (format == CloudFormat::kText) {
      // Without this word numbers up to 1 are read as sRGB.
      const bool linear =
          !first.color.empty() && first.color_encoding == ColorEncoding::kFloatLinear;
      if (linear) return "# colors are linear light\n" + column_line(columns, separator());
      const bool bare = lower_extension(path) == ".xyz" && are_known_columns(columns);
      return bare ? std::string() : column_line(columns, separator());
    }
    if (format == CloudFormat::kObj) return {};
    if (format == CloudFormat::kPcd) {
      return pcd_header(columns, count, first.viewpoint, file_comments(first, true));
    }
    return cloud_ply_header(first, columns, count, first.tree.size(), options.ascii);
  }
};

CloudWriter::CloudWriter(std::string path, std::size_t count, const CloudWriteOptions& options)
    : impl_(std::make_unique<Impl>(std::move(path), count, std::nullopt, options)) {}
CloudWriter::CloudWriter(std::string path, CloudSurvey survey, const CloudWriteOptions& options)
    : impl_(std::make_unique<Impl>(std::move(path), survey.count, std::move(survey), options)) {}
CloudWriter::~CloudWriter() = default;

void CloudWriter::append(const SurfelCloud& piece) {
  static_assert(std::endian::native == std::endian::little, "records are written as they are");
  Impl& w = *impl_;
  piece.check_columns(w.path);
  const bool levels = !piece.tree.empty();
  if (levels && w.format != CloudFormat::kPly) {
    throw_usage(fmt::format("{}: levels of detail are written to PLY only; give a .ply", w.path));
  }
  if (levels && piece.size() != w.count) {
    throw_input(w.path, "a cloud with levels of detail cannot be written in pieces");
  }
  if (w.las) return w.las->append(piece, write_comments(piece, false));
  const CloudRecords records(piece,
                             {.pcl_names = w.format == CloudFormat::kPcd, .for_text = w.text()});
  if (w.columns.empty()) {
    w.columns = records.columns();
    w.file->write(w.header(piece));
  }
  if (!same_columns(w.columns, records.columns()))
    throw_input(w.path, "pieces of the cloud differ in their columns");
  if (w.format == CloudFormat::kObj) {
    write_text(
        piece.size(),
        [&](std::size_t begin, std::size_t end) { return obj_points(piece, begin, end); }, *w.file);
  } else if (w.text()) {
    write_text(records, piece.size(), w.separator(), *w.file);
  } else {
    write_binary(records, piece.size(), *w.file);
  }
  if (levels) write_tree(piece, w.options.ascii, *w.file);
  w.written += piece.size();
}

std::vector<std::string> CloudWriter::commit() {
  if (impl_->las) return impl_->las->commit();
  if (impl_->written != impl_->count) {
    throw_input(impl_->path, fmt::format("{} surfels were promised and {} written", impl_->count,
                                         impl_->written));
  }
  impl_->file->commit();
  return impl_->format == CloudFormat::kText ? renamed_in_text(impl_->columns)
                                             : std::vector<std::string>();
}

std::vector<std::string> columns_left_out(const SurfelCloud& cloud, const std::string& path) {
  return format_of(path) == CloudFormat::kObj ? columns_without_place_in_obj(cloud)
                                              : std::vector<std::string>();
}

std::vector<std::string> write_cloud(const SurfelCloud& cloud, const std::string& path,
                                     const CloudWriteOptions& options) {
  cloud.check_columns(path);
  CloudSurvey survey(path);
  survey.add(cloud);
  CloudWriter writer(path, std::move(survey), options);
  writer.append(cloud);
  return writer.commit();
}

}  // namespace surfel
