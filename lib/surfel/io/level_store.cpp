#include <algorithm>
#include <cerrno>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/io/json_reader.h>
#include <surfel/io/level_store.h>
#include <surfel/io/tree_records.h>
#include <sys/stat.h>

namespace surfel {
namespace {

/// Version of the layout, which the index tells.
constexpr int kLayout = 1;

std::uint64_t sum(const std::vector<std::uint32_t>& counts) {
  return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
}

std::string part_text(const LevelStorePart& part) {
  return fmt::format(R"("file": "{}", "checksum": "{}", "surfels": [{}], "clusters": [{}])",
                     part.file, checksum_text(part.checksum), fmt::join(part.surfels, ", "),
                     fmt::join(part.clusters, ", "));
}

/// A member that must be there.
JsonValue needed(const JsonValue& object, const char* key) {
  const std::optional<JsonValue> found = object.find(key);
  if (!found) object.fail(fmt::format("has no {}", key));
  return *found;
}

std::uint32_t read_count(const JsonValue& value) {
  const double count = value.number();
  if (!representable<std::uint32_t>(count) || count < 1) value.fail("is no number of surfels");
  return static_cast<std::uint32_t>(count);
}

std::vector<std::uint32_t> read_counts(const JsonValue& array) {
  if (!array.is_array() || array.size() == 0) array.fail("is no list of the levels' sizes");
  std::vector<std::uint32_t> counts;
  for (std::size_t i = 0; i < array.size(); ++i) counts.push_back(read_count(array.at(i)));
  return counts;
}

/// Reads a file's entry into a part.
void read_part(const JsonValue& entry, LevelStorePart& part) {
  const std::optional<std::string> file = entry.text("file");
  if (!file || file->empty() || file->front() == '.' || file->find('/') != std::string::npos) {
    entry.fail("does not name a file of the folder");
  }
  part.file = *file;
  const std::string checksum = entry.text("checksum").value_or("");
  const bool digits = checksum.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (checksum.size() != 8 || !digits) entry.fail("has no checksum of eight hexadecimal digits");
  part.checksum = static_cast<std::uint32_t>(std::stoul(checksum, nullptr, 16));
  part.surfels = read_counts(needed(entry, "surfels"));
  part.clusters = read_counts(needed(entry, "clusters"));
  if (part.surfels.size() != part.clusters.size()) entry.fail("has unlike numbers of levels");
}

/// Whether the counts of the top and of the blocks fit each other.
bool fits(const LevelStoreIndex& index) {
  if (index.blocks.empty() || index.top.clusters.front() != index.blocks.size()) return false;
  const std::size_t levels = index.block_levels();
  std::uint64_t roots = 0;
  for (const LevelStoreBlock& block : index.blocks) {
    if (block.surfels.size() != levels || block.clusters.back() != 1) return false;
    roots += block.surfels.back();
  }
  return index.top.surfels.front() == roots;
}

[[noreturn]] void throw_other(const std::string& path) {
  throw_input(path,
              "is not the file that the store's index names, but one of another store or of an "
              "older version; put back the store's own files, or make it anew with surfel-lod");
}

}  // namespace

std::uint64_t LevelStorePart::all_surfels() const { return sum(surfels); }
std::uint64_t LevelStorePart::all_clusters() const { return sum(clusters); }

std::string path_in(const std::string& folder, const std::string& file) {
  return folder.ends_with('/') ? folder + file : folder + "/" + file;
}

std::string checksum_text(std::uint32_t checksum) { return fmt::format("{:08x}", checksum); }

bool is_level_store(const std::string& folder) {
  struct stat status {};
  return stat(path_in(folder, kLevelStoreIndex).c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

LevelStoreIndex read_level_store(const std::string& folder) {
  const InputFile file(path_in(folder, kLevelStoreIndex));
  const JsonValue json = read_json(file);
  if (json.number("surfel_store") != kLayout) {
    json.fail(fmt::format("is no index of a store of levels of detail of layout {}", kLayout));
  }
  LevelStoreIndex index;
  index.reduction = json.count("reduction", 16).value_or(0);
  index.normal_angle = needed(json, "normal_angle").number();
  index.sheet_weight = needed(json, "sheet_weight").number();
  index.most_surfels = read_count(needed(json, "most_surfels"));
  read_part(needed(json, "top"), index.top);
  const JsonValue blocks = needed(json, "blocks");
  for (std::size_t i = 0; blocks.is_array() && i < blocks.size(); ++i) {
    const JsonValue entry = blocks.at(i);
    LevelStoreBlock& block = index.blocks.emplace_back();
    read_part(entry, block);
    const std::vector<double> cell = needed(entry, "cell").numbers(4);
    if (!representable<int>(cell[0])) entry.fail("has a cell without a side");
    block.cell = {static_cast<int>(cell[0]), {cell[1], cell[2], cell[3]}};
  }
  if (!fits(index)) json.fail("does not name all files of one store");
  return index;
}

std::string level_store_text(const LevelStoreIndex& index) {
  std::string text = fmt::format(
      "{{\n\"surfel_store\": {},\n\"reduction\": {},\n\"normal_angle\": {},\n\"sheet_weight\": "
      "{},\n\"most_surfels\": {},\n\"top\": {{{}}},\n\"blocks\": [\n",
      kLayout, index.reduction, index.normal_angle, index.sheet_weight, index.most_surfels,
      part_text(index.top));
  for (const LevelStoreBlock& block : index.blocks) {
    text += fmt::format("{{\"cell\": [{}, {}], {}}}{}\n", block.cell.side,
                        fmt::join(block.cell.center, ", "), part_text(block),
                        &block == &index.blocks.back() ? "" : ",");
  }
  return text + "]\n}\n";
}

PlyFile open_part(const std::string& folder, const LevelStorePart& part) {
  const std::string path = path_in(folder, part.file);
  struct stat status {};
  if (stat(path.c_str(), &status) != 0 && errno == ENOENT) {
    throw_io(path,
             "is missing, and the store's index names it; if surfels were being added to the "
             "store, run again, else put the file back, or make the store anew with surfel-lod");
  }
  PlyFile file{InputFile(path)};
  const std::string line = fmt::format("{} {}", kLevelStoreChecksum, checksum_text(part.checksum));
  const std::vector<std::string>& info = file.header().obj_info;
  const PlyElement* const vertex = file.header().find("vertex");
  const PlyElement* const clusters = file.header().find(kTreeElement);
  if (std::find(info.begin(), info.end(), line) == info.end() || !vertex || !clusters ||
      vertex->count != part.all_surfels() || clusters->count != part.all_clusters()) {
    throw_other(path);
  }
  // Throws where the file is too short for them.
  file.scalars("vertex");
  file.scalars(kTreeElement);
  return file;
}

void check_part(PlyFile& file, const LevelStorePart& part) {
  const std::size_t begin = file.scalars("vertex").offset;
  const RecordTable& clusters = file.scalars(kTreeElement);
  const std::size_t size = clusters.offset + clusters.count * clusters.stride - begin;
  Array<std::byte> bytes;
  const std::byte* const from = file.file().read_at(begin, size, bytes);
  if (crc32c({from, size}) != part.checksum) {
    throw_input(file.name(),
                "is damaged: its checksum is another one than the store's index names; put the "
                "file back, or make the store anew with surfel-lod");
  }
}

}  // namespace surfel
