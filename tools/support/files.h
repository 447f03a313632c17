#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/support/command_line.h"

namespace surfel::tool {

/// What a tool writes to a file; it decides on the extensions that the file's name may have.
enum class Writes {
  kSurfels,             ///< .ply, .pcd, .las, .laz; a name without extension is PLY.
  kSurfelsOrGaussians,  ///< The same, or .splat, .usda.
  kDensities,           ///< Gaussians that are densities: .ply; a name without extension is PLY.
  kLevels,              ///< Surfels with levels of detail: .ply; a name without extension is PLY.
  kMesh,                ///< .obj, .ply.
  kPicture,             ///< What write_image() writes.
  kFilm,                ///< The same, or .mp4, .webm, .gif.
  kSky,                 ///< Pictures of unbounded values: .exr, .hdr.
  kReport,              ///< .json, or no extension.
  kPage,                ///< .html, .htm.
  kAny                  ///< A folder, or what is known only later: any name.
};

/// The extension of a file's name with its dot, in lower case.
std::string lower_extension(const std::string& path);

/// Throws Error(kUsage) naming the extensions that there are, where files of this name are not
/// written as `what`. Standard output ("-") takes all but skies, as pictures go there as PNG.
void require_format(const std::string& path, Writes what);

/// The files that the options of a tool name. A run that would write over what it reads, or twice
/// to one file, is refused before any work: the input would be lost, even where the run fails.
class RunFiles {
 public:
  explicit RunFiles(const CommandLine& app) : app_(app) {}

  /// Declares options and positional arguments whose values are files to read. Values that are no
  /// files, such as names of procedural textures, do no harm.
  void reads(const std::vector<std::string>& options);
  /// Declares an option whose value is a file to write.
  void writes(const std::string& option, Writes what);

  /// Takes the files that the options name, once they are parsed. Throws Error(kUsage) for an empty
  /// name, a name of a folder, a format that is not written, for two outputs that are one file, and
  /// for an output that is an input: the same file by device and number, links followed, also where
  /// it is standard input or output ("-"). Pipes and devices may stand for both.
  void check();
  /// The same for a file that is read, or written for an option, without being an option's value:
  /// `what` names it in messages.
  void read_also(const std::string& what, const std::string& path);
  void write_also(const std::string& option, const std::string& path);
  /// Files that the run reads, as far as they are known, under the names that messages give them.
  std::vector<std::string> inputs() const;

 private:
  struct File {
    std::string name;  ///< Of the option, or what it is.
    std::string path;
    std::size_t place;  ///< In the order that the user typed.
  };
  struct Output {
    std::string option;
    Writes what;
  };
  std::vector<File> values(const std::string& option) const;
  void add_input(const File& file);
  void add_output(const File& file);
  /// Names both in the order that the user typed them.
  [[noreturn]] static void refuse(const File& a, const File& b, const std::string& advice);

  const CommandLine& app_;
  std::vector<std::string> input_options_;
  std::vector<Output> output_options_;
  std::vector<File> inputs_;
  std::map<std::string, std::vector<File>> outputs_;  ///< By the option's name.
};

}  // namespace surfel::tool
