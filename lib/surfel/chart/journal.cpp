#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/whole_file.h>
#include <surfel/chart/journal.h>

namespace surfel {
namespace {

using Json = nlohmann::json;

/// As one line; bytes that are not UTF-8 are replaced, for a key as they are looked up.
std::string line_of(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

bool is_pair_of_texts(const Json& entry) {
  return entry.is_array() && entry.size() == 2 && entry[0].is_string() && entry[1].is_string();
}

}  // namespace

Journal::Journal(std::string path, const std::string& run) : path_(std::move(path)) {
  const std::string text = whole_file(path_);
  const std::string header = line_of(run);
  std::string kept = header;
  if (text.starts_with(header)) {
    for (std::size_t at = header.size(), end = 0; (end = text.find('\n', at)) != std::string::npos;
         at = end + 1) {
      const Json entry = Json::parse(text.begin() + static_cast<std::ptrdiff_t>(at),
                                     text.begin() + static_cast<std::ptrdiff_t>(end), nullptr,
                                     /*allow_exceptions=*/false);
      if (!is_pair_of_texts(entry)) break;
      entries_[entry[0].get<std::string>()] = entry[1].get<std::string>();
      kept.append(text, at, end + 1 - at);
    }
  }
  if (kept == text) return;
  OutputFile file(path_);
  file.write(kept);
  file.commit();
}

const std::string* Journal::find(const std::string& key) const {
  const auto entry = entries_.find(key);
  return entry == entries_.end() ? nullptr : &entry->second;
}

void Journal::add(const std::string& key, const std::string& value) {
  std::ofstream file(path_, std::ios::binary | std::ios::app);
  file << line_of(Json{key, value}) << std::flush;
  if (!file) throw_io(path_, std::string("cannot be written: ") + std::strerror(errno));
  entries_[key] = value;
}

}  // namespace surfel
