#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/scene.h>

namespace surfel {

/// Reads TOML: `ambient = [r, g, b]`, `refraction` ("single" | "multi"), tables [[light]] (type =
/// "directional" | "headlight" | "point", direction or position, color), [[material]] (name,
/// ambient, diffuse, specular, shininess, opacity, reflectivity, ior, dispersion, roughness,
/// absorption), [sky] (up, color, ground) and [environment] (image, which named_path() finds;
/// intensity, rotation, visible). A material with an ior but no reflectivity gets the reflectivity
/// ((ior - 1) / (ior + 1))^2. A file without lights and sky, or without materials, leaves the
/// default lights or materials of Scene; a sky alone is all the light there is beside `ambient`.
/// The image of an environment is not read here but by load_environment()
/// (render/environment_map.h). Throws Error naming file and line; an unknown key is an error.
SURFEL_API Scene read_scene(const std::string& path);
/// Reads a scene from a file that is open, or in memory.
SURFEL_API Scene read_scene(const InputFile& file);

}  // namespace surfel
