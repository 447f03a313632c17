#include "tools/support/files.h"

#include <algorithm>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/image_io.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tools/support/surfels.h"

namespace surfel::tool {
namespace {

namespace fs = std::filesystem;

/// The extensions that files with such contents have, and what the contents are called; an empty
/// extension stands for names without one.
struct Formats {
  const char* contents;
  std::vector<std::string> extensions;
};

Formats formats_of(Writes what) {
  switch (what) {
    case Writes::kSurfels:
      return {"surfels",
              {".ply", ".pcd", ".las", ".laz", ".xyz", ".txt", ".asc", ".csv", ".obj", ""}};
    case Writes::kSurfelsOrGaussians: {
      Formats formats = formats_of(Writes::kSurfels);
      formats.contents = "surfels and Gaussians";
      formats.extensions.insert(formats.extensions.end() - 1, {".splat", ".usda"});
      return formats;
    }
    case Writes::kDensities:
      return {"Gaussians of volumes", {".ply", ""}};
    case Writes::kLevels:
      return {"surfels with levels of detail", {".ply", ""}};
    case Writes::kMesh:
      return {"meshes", {".obj", ".ply"}};
    case Writes::kSky:
      return {"skies, which are brighter than white,", {".exr", ".hdr"}};
    case Writes::kReport:
      return {"reports", {".json", ""}};
    case Writes::kPage:
      return {"pages", {".html", ".htm"}};
    case Writes::kPicture:
    case Writes::kFilm:
    case Writes::kAny:
      break;
  }
  return {};
}

/// Finds the device and the number of a file; "-" is the standard stream.
bool find_status(const std::string& path, int stream, struct stat& status) {
  return (path == "-" ? fstat(stream, &status) : stat(path.c_str(), &status)) == 0;
}

/// Both are there and are one file that can be lost, as pipes and devices cannot.
/// \param stream_a  the descriptor that "-" stands for
bool same_file(const std::string& a, int stream_a, const std::string& b, int stream_b) {
  struct stat first {};
  struct stat second {};
  // Most outputs are not there, and the pictures of a film are many.
  return find_status(b, stream_b, second) && find_status(a, stream_a, first) &&
         S_ISREG(first.st_mode) && first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

/// Is an input the file that an output goes to?
bool same_file(const std::string& input, const std::string& output) {
  return same_file(input, STDIN_FILENO, output, STDOUT_FILENO);
}

/// Are two outputs one file? Neither need be there.
bool same_target(const std::string& a, const std::string& b) {
  if (same_file(a, STDOUT_FILENO, b, STDOUT_FILENO)) return true;
  std::error_code error;
  if (fs::exists(a, error) || fs::exists(b, error)) return false;
  const auto place = [&](const std::string& path) {
    return fs::weakly_canonical(fs::absolute(path, error), error);
  };
  const fs::path place_a = place(a);
  return !place_a.empty() && place_a == place(b);
}

}  // namespace

std::string lower_extension(const std::string& path) {
  return lower_case(fs::path(path).extension().string());
}

void require_format(const std::string& path, Writes what) {
  if (what == Writes::kAny) return;
  if (path.ends_with('/')) {
    throw_usage(fmt::format("{}: is the name of a folder; name a file", path));
  }
  if (path == "-" && what != Writes::kSky) return;
  const std::string as = lower_extension(path);
  if (what == Writes::kFilm && (as == ".mp4" || as == ".webm" || as == ".gif")) return;
  if (what == Writes::kPicture || what == Writes::kFilm) {
    image_format_has_alpha(path);
    return;
  }
  const auto [contents, extensions] = formats_of(what);
  const std::string extension = lower_extension(path);
  if (std::count(extensions.begin(), extensions.end(), extension) > 0) {
    return refuse_copc_name(path);
  }
  std::vector<std::string> choices = extensions;
  std::erase(choices, "");
  throw_usage(fmt::format(
      "{}: {} are not written {}; use {}", path, contents,
      extension.empty() ? "to a name without extension" : fmt::format("as '{}'", extension),
      fmt::join(choices, " or ")));
}

void RunFiles::reads(const std::vector<std::string>& options) {
  input_options_.insert(input_options_.end(), options.begin(), options.end());
}

void RunFiles::writes(const std::string& option, Writes what) {
  output_options_.push_back({option, what});
}

std::vector<RunFiles::File> RunFiles::values(const std::string& option) const {
  const Option* found = app_.get_option(option);
  if (found->count() == 0) return {};
  const std::vector<Option*> order = app_.parse_order();
  const auto place = std::find(order.begin(), order.end(), found) - order.begin();
  std::vector<File> files;
  for (const std::string& path : found->results()) {
    if (path.empty()) throw_usage(fmt::format("{} is empty; name a file or leave it out", option));
    files.push_back({option, path, static_cast<std::size_t>(place)});
  }
  return files;
}

void RunFiles::check() {
  for (const std::string& option : input_options_) {
    for (const File& file : values(option)) add_input(file);
  }
  for (const auto& [option, what] : output_options_) {
    for (const File& file : values(option)) {
      add_output(file);
      require_format(file.path, what);
    }
  }
}

std::vector<std::string> RunFiles::inputs() const {
  std::vector<std::string> names;
  for (const File& file : inputs_) names.push_back(shown_name(file.path));
  return names;
}

void RunFiles::read_also(const std::string& what, const std::string& path) {
  add_input({what, path, app_.parse_order().size()});
}

void RunFiles::write_also(const std::string& option, const std::string& path) {
  add_output({option, path, app_.parse_order().size()});
}

void RunFiles::add_input(const File& file) {
  for (const auto& [option, outputs] : outputs_) {
    for (const File& output : outputs) {
      if (same_file(file.path, output.path)) refuse(file, output, option + " another name");
    }
  }
  inputs_.push_back(file);
}

void RunFiles::add_output(const File& file) {
  for (const File& input : inputs_) {
    if (same_file(input.path, file.path)) refuse(input, file, file.name + " another name");
  }
  for (const auto& [option, outputs] : outputs_) {
    // One option's files have names that differ; comparing thousands of them with each other would
    // take minutes.
    if (option == file.name) continue;
    for (const File& output : outputs) {
      if (same_target(output.path, file.path)) refuse(output, file, "each a name of its own");
    }
  }
  outputs_[file.name].push_back(file);
}

void RunFiles::refuse(const File& a, const File& b, const std::string& advice) {
  const bool in_order = a.place <= b.place;
  const File& first = in_order ? a : b;
  const File& second = in_order ? b : a;
  throw_usage(fmt::format("{} {} and {} {} are one file, which would be lost; give {}", first.name,
                          first.path, second.name, second.path, advice));
}

}  // namespace surfel::tool
