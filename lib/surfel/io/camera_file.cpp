#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/toml_reader.h>
#include <surfel/scene/framing.h>

namespace surfel {

std::vector<CameraOptions> read_cameras(const std::string& path, const CameraOptions& defaults) {
  return read_cameras(open_toml(path), defaults);
}

std::vector<CameraOptions> read_cameras(const InputFile& file, const CameraOptions& defaults) {
  const TomlReader toml(file);
  const auto read_one = [&](const TomlTable& table) {
    CameraOptions options = defaults;
    table.read("eye", options.eye);
    table.read("from", options.from);
    table.read("target", options.target);
    table.read("up", options.up);
    table.read("fov", options.fov);
    table.read("ortho", options.ortho);
    table.read("size", options.width, options.height);
    table.read("near", options.near);
    table.read("zoom", options.zoom);
    table.read("frame-all", options.frame_all);
    table.read("name", options.name);
    table.read("time", options.time);
    table.reject_unread();
    for (std::string& problem : options.problems()) {
      std::erase(problem, '`');  // The fields are keys of the file, not options of a tool.
      throw_input(file.name(), problem);
    }
    return options;
  };
  std::vector<CameraOptions> cameras;
  const std::vector<TomlTable> tables = toml.tables("camera");
  for (const TomlTable& table : tables) cameras.push_back(read_one(table));
  if (tables.empty()) {
    cameras.push_back(read_one(toml.root()));
  } else {
    toml.root().reject_unread();
  }
  return cameras;
}

}  // namespace surfel
