#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/gaussian/gaussian_options.h>
#include <surfel/io/picture_part.h>
#include <surfel/measure/view_guess.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/camera_path.h>
#include <surfel/scene/framing.h>
#include <surfel/sp06/methods.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/texture/texture_source.h>
#include <surfel/truth/reference.h>

#include "tools/support/normal_maps.h"
#include "tools/support/surfels.h"

namespace surfel::render_tool {

enum class Shading { kAuto, kPhong, kNone };
enum class ReliefChoice { kAuto, kNone, kEyeDome, kOcclusion };
enum class Cull { kNone, kBack };
enum class Refractions { kScene, kSingle, kMulti };
enum class Projection { kPinhole, kEquirectangular };
enum class Lod { kAuto, kOn, kOff };
enum class LegendChoice { kAuto, kOn, kOff };
/// A colour map, or a colour for each whole number.
enum class MapChoice { kAuto, kViridis, kTurbo, kTerrain, kGrey, kClasses };
enum class Filter { kEwa, kEwaSource, kCircular, kNone };

/// What the command line asks of surfel-render.
struct Settings {
  std::vector<std::string> inputs;
  std::string output;
  std::string keep;
  bool print_commands = false;
  std::string camera_file;
  std::string views_file;  ///< Folder or JSON of known views; one of TOML is the camera file.
  bool original_world = false;
  bool resize = false;  ///< The size was given, so that known views are scaled to it.
  std::optional<std::array<std::size_t, 2>> frames;  ///< First and last picture; unset: all.
  bool skip_existing = false;
  std::string made_by;  ///< The command and the content of what it reads, where pictures say so.
  std::optional<PartNumber> tiles;  ///< The part of each picture to be made; unset: all of it.
  std::string scene_file;
  Refractions refraction = Refractions::kScene;
  CameraOptions camera;
  ViewChoice view;
  RenderOptions render;
  Method method = Method::kABuffer;
  MethodOptions method_options;
  Projection projection = Projection::kPinhole;
  int turntable = 0;
  bool path = false;      ///< The views are key frames of a path.
  int path_pictures = 0;  ///< Of a path; 0 = by its time.
  PathEase ease = PathEase::kNone;
  double fps = 30;            ///< Pictures a second, of films and of paths by their time.
  std::optional<double> map;  ///< Side of a map's pixels, scene units.
  std::optional<int> epsg;    ///< The map's coordinate system.
  bool contact_sheet = false;
  bool explain = false;
  std::vector<std::array<int, 2>> explained_pixels;  ///< Column and row of each.
  std::optional<std::array<float, 4>> background;    ///< Unset: by the picture's format.
  std::array<float, 4> sheet_background{};  ///< Of a contact sheet; its alpha has no effect.
  Shading shading = Shading::kAuto;
  ReliefChoice relief = ReliefChoice::kAuto;
  std::string color_by = "auto";  ///< Attribute, or auto or none.
  MapChoice color_map = MapChoice::kAuto;
  std::optional<std::array<double, 2>> color_range;  ///< Unset: without stray values.
  LegendChoice legend = LegendChoice::kAuto;
  Cull cull = Cull::kNone;
  Filter filter = Filter::kEwa;
  Lod lod = Lod::kAuto;
  int progressive = 1;
  bool reference = false;
  ReferenceOptions rays;
  std::optional<std::uint64_t> memory;
  std::string mesh;
  TextureSourceOptions texture;
  tool::NormalMapSettings normals;
  int bounces = 0;
  tool::PartSettings part;
  std::optional<GaussianProfile> profile;  ///< Of Gaussians; unset: as their file says.
  GaussianOptions gaussians;               ///< Without what follows from the other settings.
};

/// The profiles of Gaussians by their names.
const std::vector<std::pair<std::string, GaussianProfile>>& gaussian_profiles();

/// Declares the options of surfel-render, bound to the settings.
void declare_options(tool::CommandLine& app, Settings& s);

/// Fills in what follows from several options. Throws Error(kUsage) where they do not go together,
/// or where one has no effect beside the others.
void settle(const tool::CommandLine& app, Settings& s);

/// Do the pictures become a film?
bool wants_film(const Settings& s);

/// Does a legend belong in the pictures, where there is something to say in it?
bool wants_legend(const Settings& s);

/// The method blends layers, so that it knows no depths.
bool blends_layers(const Settings& s);

/// The levels of detail are wanted, if the file has them.
bool wants_levels(const Settings& s);

}  // namespace surfel::render_tool
