#include "tools/support/level_store.h"

#include <fmt/format.h>
#include <surfel/io/level_store.h>

#include "tools/support/options.h"

namespace surfel::tool {

bool names_store(const std::string& path) { return path.ends_with('/') || is_level_store(path); }

std::string tell_store(Tool& tool, const std::string& path, const LevelStoreReport& written) {
  Json& json = tool.report();
  json["dropped"] = written.dropped.total();
  json["added"] = written.added;
  json["levels"] = written.levels;
  json["clusters"] = written.clusters;
  json["blocks"] = written.blocks;
  json["blocks_written"] = written.blocks_written;
  json["bytes_written"] = written.bytes_written;
  json["bytes_sorted"] = written.bytes_sorted;
  add_stages(json, written.stages);
  if (written.blocks_written < written.blocks) {
    tool.note(fmt::format("{}: {} of {} blocks stay as they are", path,
                          written.blocks - written.blocks_written, written.blocks));
  }
  return fmt::format("{} surfels in {} blocks, in {} levels down to {}", written.levels.front(),
                     written.blocks, written.levels.size(), written.levels.back());
}

}  // namespace surfel::tool
