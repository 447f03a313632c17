#include <algorithm>
#include <atomic>
#include <filesystem>
#include <optional>
#include <system_error>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/named_file.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

namespace fs = std::filesystem;

std::atomic<bool> g_outside_allowed{false};

/// Does a path lie below a folder, by the names of both?
bool is_below(const fs::path& path, const fs::path& folder) {
  const auto whole = [](const fs::path& p) { return fs::absolute("." / p).lexically_normal(); };
  // A folder without its last slash, which would be an empty name below it.
  const fs::path relative = whole(path).lexically_relative(whole(folder / "x").parent_path());
  return !relative.empty() && *relative.begin() != "..";
}

bool is_file(const fs::path& path) {
  std::error_code none;
  const fs::file_status status = fs::status(path, none);
  return path.has_filename() && fs::exists(status) && !fs::is_directory(status);
}

/// A file of this path or, if there is none, one whose name has letters of another case; the first
/// in order of the alphabet.
std::optional<fs::path> in_any_case(const fs::path& path) {
  if (is_file(path)) return path;
  std::optional<fs::path> found;
  if (!path.has_filename()) return found;
  const std::string wanted = lower_case(path.filename().string());
  std::error_code error;
  for (fs::directory_iterator file(path.has_parent_path() ? path.parent_path() : ".", error), end;
       !error && file != end; file.increment(error)) {
    const fs::path there = path.parent_path() / file->path().filename();
    if (lower_case(there.filename().string()) != wanted || !is_file(there)) continue;
    if (!found || there < *found) found = there;
  }
  return found;
}

}  // namespace

bool outside_allowed() noexcept { return g_outside_allowed; }
void allow_outside(bool allowed) noexcept { g_outside_allowed = allowed; }

std::string named_path(const std::string& naming, std::string_view name) {
  const fs::path folder = fs::path(naming).parent_path();
  const bool drive = name.size() > 1 && name[1] == ':';
  std::string slashes(name.substr(drive ? 2 : 0));
  std::replace(slashes.begin(), slashes.end(), '\\', '/');
  const fs::path turned(slashes);
  const fs::path written = folder / turned;
  const fs::path beside = folder / turned.filename();
  const bool inside = is_below(written, folder);
  std::vector<fs::path> candidates;
  if (inside || outside_allowed()) candidates = {folder / name, written};
  const bool foreign = drive || turned.is_absolute() || !inside;
  candidates.insert(foreign ? candidates.begin() : candidates.end(), beside);
  for (const fs::path& candidate : candidates) {
    if (is_file(candidate)) return candidate.lexically_normal().string();
  }
  for (const fs::path& candidate : candidates) {
    if (const auto found = in_any_case(candidate)) return found->lexically_normal().string();
  }
  return (inside ? folder / name : written).lexically_normal().string();
}

std::string named_problem(const std::string& naming, const std::string& path) {
  constexpr const char* kOutside =
      "lies outside of this file's folder and is read only with `allow_outside`";
  const fs::path folder = fs::path(naming).parent_path();
  if (!outside_allowed() && !is_below(path, folder)) return kOutside;
  std::error_code error;
  const fs::path real = fs::canonical(path, error);
  if (error || fs::is_directory(real, error)) return "is not there";
  if (!outside_allowed() && !is_below(real, fs::canonical(folder / ".", error))) return kOutside;
  return fs::is_regular_file(real, error) ? "" : "is no regular file";
}

InputFile open_named(const std::string& naming, const std::string& path) {
  const std::string problem = named_problem(naming, path);
  if (!problem.empty()) {
    throw_input(naming,
                fmt::format("names the file {}, which {}; put it beside this file", path, problem));
  }
  return InputFile(path, true);
}

}  // namespace surfel
