#include "tools/support/block_writer.h"

#include <utility>

#include <surfel/base/error.h>

#include "tools/support/resume.h"
#include "tools/support/surfels.h"

namespace surfel::tool {

BlockWriter::BlockWriter(const Tool& tool, std::string path, BlockWriterOptions options)
    : tool_(tool), path_(std::move(path)), options_(std::move(options)) {
  const std::string extension = lower_extension(path_);
  if (extension.empty() || extension == ".ply") {
    rows_.emplace(path_, RowFileOptions{tool.common().no_clobber, options_.job, options_.peers});
  } else if (!options_.job.empty() || options_.peers) {
    throw_usage(path_ + ": " + (options_.peers ? "several processes write" : "--resume writes") +
                " PLY alone; give a .ply");
  }
}

void BlockWriter::settle(SurfelCloud& surfels) const {
  if (options_.survey) options_.survey->settle(surfels);
  surfels.provenance.push_back(tool_.provenance());
}

void BlockWriter::begin(const SurfelCloud& like, std::size_t count) {
  SurfelCloud described = like;
  settle(described);
  tell_lost_columns(tool_, described, path_);
  count_ = count;
  if (rows_) {
    rows_->begin(described, count);
    tell_resumed(tool_, path_, rows_->rows_kept(), count);
    return;
  }
  text_.reset();
  text_.emplace(path_, count, CloudWriteOptions{.no_clobber = tool_.common().no_clobber});
}

void BlockWriter::put(SurfelCloud surfels, std::size_t at) {
  settle(surfels);
  if (rows_) return rows_->put(surfels, 0, surfels.size(), at);
  text_->append(surfels);
}

void BlockWriter::commit() {
  if (rows_) {
    rows_->commit();
  } else {
    tell_changed_columns(tool_, path_, text_->commit());
  }
}

}  // namespace surfel::tool
