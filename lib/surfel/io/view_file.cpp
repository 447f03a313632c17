#include <filesystem>

#include <surfel/base/error.h>
#include <surfel/io/colmap.h>
#include <surfel/io/json_reader.h>
#include <surfel/io/pose_json.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/transforms_json.h>
#include <surfel/io/view_file.h>

namespace surfel {
namespace {

void refuse_original_world(const std::string& file) {
  throw_input(file, "has no applied_transform to be undone");
}

}  // namespace

std::vector<View> read_views(const std::string& path, const ViewFileOptions& options) {
  std::error_code none;
  if (std::filesystem::is_directory(path, none)) {
    const std::string transforms = (std::filesystem::path(path) / "transforms.json").string();
    if (!holds_colmap(path) && std::filesystem::exists(transforms, none)) {
      return read_views(transforms, options);
    }
    if (options.original_world) refuse_original_world(path);
    return read_colmap(path);
  }
  if (path == "-" || lower_extension(path) != ".json") {
    if (path != "-") InputFile{path};  // What is not there is told as that.
    throw_input(path,
                "is no file of views; name a folder that COLMAP wrote, a transforms.json, a JSON "
                "file of intrinsics and poses, or a TOML file of cameras");
  }
  return read_views(InputFile(path), options);
}

std::vector<View> read_views(const InputFile& file, const ViewFileOptions& options) {
  const JsonValue json = read_json(file);
  if (json.is_object() && json.find("frames")) return read_transforms(json, options);
  if (options.original_world) refuse_original_world(file.name());
  return read_poses(json);
}

}  // namespace surfel
