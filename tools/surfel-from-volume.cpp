// surfel-from-volume: a CT or MR volume to Gaussians in space.

#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/transfer_file.h>
#include <surfel/io/volume_io.h>
#include <surfel/volume/gaussians_of_volume.h>

#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace {

using surfel::Vec3d;

struct Settings {
  std::vector<std::string> inputs;
  std::string output;
  std::string transfer;
  std::optional<Vec3d> spacing;
  surfel::GaussiansOfVolumeOptions gaussians;
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  app.add_option("volume", s.inputs,
                 "Volume (NRRD, NHDR, MHA, MHD), or the images of a stack, one for each z, in the "
                 "order of their names")
      ->required();
  app.add_option("-o,--output", s.output, "Gaussians to write (PLY; - = standard output)")
      ->required();
  app.group("What it looks like");
  app.add_option(
      "--transfer", s.transfer,
      fmt::format("Colours and densities by value: {}, or a TOML file; default: ct where "
                  "values are Hounsfield units (below -500), else mr",
                  fmt::join(surfel::transfer_function_names(), ", ")));
  app.add_option("--density", s.gaussians.density, "Multiplies densities, > 0");
  app.add_option("--shading", s.gaussians.shading,
                 "How much colours depend on the angle between the line of sight and the gradient, "
                 "0..1");
  surfel::tool::add_vector(
      app, "--spacing", s.spacing,
      "Distances of voxels along the axes, scene units, 1e-15..1e15; default: the "
      "file's, 1,1,1 for images");
  app.group("How many");
  app.add_option("--max-error", s.gaussians.max_error,
                 "Voxels become one Gaussian where their opacities and colours differ by no more, "
                 "0..1; 0: only where they are the same");
  app.add_option("--least-depth", s.gaussians.least_depth,
                 "Voxels of less optical depth are left out, >= 0");
  app.add_option(
      "--deviation", s.gaussians.deviation,
      "Standard deviation of the Gaussians across the gradient, edges of a voxel, 0.4..2");
}

surfel::Volume read(const Settings& s) {
  const bool stack = s.inputs.size() > 1 || !surfel::is_volume_name(s.inputs.front());
  surfel::Volume volume = stack ? surfel::read_image_stack(s.inputs, Vec3d(1, 1, 1))
                                : surfel::read_volume(s.inputs.front());
  if (s.spacing) {
    for (int k = 0; k < 3; ++k) {
      Vec3d& step = volume.step[static_cast<std::size_t>(k)];
      step = step.normalized() * (*s.spacing)[k];
    }
  }
  return volume;
}

/// The transfer function that a name, a file or the values ask for, and what it is called.
std::pair<surfel::TransferFunction, std::string> choose_transfer(const Settings& s,
                                                                 const surfel::Volume& volume) {
  const std::string name =
      s.transfer.empty() ? surfel::likely_transfer_function(volume) : s.transfer;
  const bool file = std::filesystem::path(name).extension() == ".toml";
  const surfel::TransferFunction function =
      file ? surfel::read_transfer_function(name) : surfel::transfer_function(name);
  return {surfel::absolute(function, volume), name};
}

std::vector<std::string> problems(const Settings& s) {
  std::vector<std::string> out = s.gaussians.problems();
  if (s.spacing && !(s.spacing->minCoeff() >= 1e-15 && s.spacing->maxCoeff() <= 1e15)) {
    out.emplace_back("`spacing` must be in 1e-15..1e15");
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-from-volume",
                          "Turns a CT or MR volume into Gaussians in space, which surfel-render "
                          "draws as a medium that emits and absorbs.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--transfer", "--density", "--shading", "--max-error"},
                {"surfel-from-volume head.nrrd -o head.ply",
                 "surfel-from-volume head.mha --transfer ct-bone -o bones.ply",
                 "surfel-from-volume slice-*.png --spacing 0.5,0.5,1.5 -o stack.ply"});
  tool.files().reads({"volume"});
  tool.files().writes("--output", surfel::tool::Writes::kDensities);
  tool.reads_images();
  tool.reads_named_files();
  return tool.run(argc, argv, [&] {
    surfel::tool::require_valid(problems(s));
    const surfel::Volume volume = read(s);
    const std::string& name = s.inputs.front();
    const auto [function, function_name] = choose_transfer(s, volume);
    surfel::GaussiansOfVolumeReport done;
    const surfel::GaussianCloud cloud =
        surfel::gaussians_of_volume(volume, function, name, s.gaussians, &done);
    if (volume.not_finite > 0) {
      tool.note(fmt::format("{}: {} voxels are not finite, and count as the least value", name,
                            volume.not_finite));
    }
    if (s.transfer.empty()) {
      tool.note(fmt::format("{}: --transfer {}, by its values", name, function_name));
    }
    surfel::write_gaussians(
        cloud, s.output,
        {.no_clobber = tool.common().no_clobber, .provenance = {tool.provenance()}});
    surfel::tool::Json& report = tool.report();
    report["size"] = volume.size;
    report["voxels"] = done.voxels;
    report["empty"] = done.empty;
    report["merged"] = done.merged;
    report["gaussians"] = cloud.size();
    tool.wrote(
        s.output,
        fmt::format("{} Gaussians of {} x {} x {} voxels, {} of which can hardly be seen and "
                    "{} share one",
                    cloud.size(), volume.size[0], volume.size[1], volume.size[2], done.empty,
                    done.merged));
  });
}
