#include "tools/render/surfels.h"

#include <string>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/intake/intake.h>

#include "tools/render/coloring.h"
#include "tools/support/options.h"
#include "tools/support/surfels.h"

namespace surfel::render_tool {
namespace {

/// The options that say what meshes are textured by.
std::vector<std::string> texture_options() {
  std::vector<std::string> options = tool::normal_map_options();
  options.insert(options.begin(), {"--image", "--wrap"});
  return options;
}

/// What the files' meshes are textured by; with --mesh the options are that mesh's.
/// \param nearest  see IntakeOptions
IntakeOptions intake_options(const Settings& s, double nearest) {
  if (!s.mesh.empty()) return {};
  return {.image = s.texture.image,
          .wrap = s.texture.wrap,
          .relief = s.normals.maps,
          .no_relief = s.normals.left_out,
          .lowpass = s.render.lowpass,
          .cutoff = s.render.cutoff,
          .nearest = nearest};
}

/// Makes surfels of files of any kind.
Intake::Made take_in(tool::Tool& tool, const Settings& s, const std::vector<AskedView>& views) {
  Intake intake(s.inputs, s.part.options());
  if (s.mesh.empty() && !intake.has_meshes()) {
    tool::require_valid(
        tool::without_effect(tool.app(), texture_options(), "on files that are no meshes"));
  }
  for (const std::string& image : intake.images()) {
    tool.files().read_also("the mesh's image", image);
  }
  const Bounds bounds = intake.bounds();
  Intake::Made made =
      intake.surfels(half_a_pixel(views, bounds), intake_options(s, nearest_share(views, bounds)));
  if (s.mesh.empty() && !made.textured) {
    tool::require_valid(
        tool::without_effect(tool.app(), {"--wrap"}, "on meshes that have no image"));
  }
  return made;
}

/// The surfels of the files, made where they are no surfels yet.
std::unique_ptr<LoadedCloud> load_files(tool::Tool& tool, const Settings& s,
                                        const std::vector<AskedView>& views,
                                        CloudLoadOptions& options, Coloring& coloring) {
  const std::string& first = s.inputs.front();
  std::vector<std::string> commands;
  std::string file = first;
  std::unique_ptr<LoadedCloud> loaded;
  options.wrap = [&](const CloudFacts& facts) { return coloring.wrap(tool, s, facts); };
  if (s.inputs.size() == 1 && s.keep.empty() && s.part.whole() &&
      (first == "-" || holds_surfels(first))) {
    if (s.mesh.empty()) {
      tool::require_valid(tool::without_effect(tool.app(), texture_options(), "on surfels"));
    }
    loaded = std::make_unique<LoadedCloud>(first, options);
  } else {
    Intake::Made made = take_in(tool, s, views);
    for (const std::string& line : made.done) tool.note(line);
    for (const std::string& line : made.warnings) tool.note(line);
    commands = std::move(made.commands);
    file = made.file;
    coloring.filled = std::move(made.filled);
    loaded = std::make_unique<LoadedCloud>(made.cloud, tool::shown_name(file), options);
    if (!s.keep.empty()) {
      tool::write_result(tool, made.cloud, s.keep);
      tool.wrote(s.keep, fmt::format("{} surfels", made.cloud.size()));
    }
  }
  if (s.print_commands) {
    std::vector<std::string> done{"keep", "print-commands"};
    if (!commands.empty()) done.insert(done.end(), {"columns", "level", "bounds", "every"});
    if (s.mesh.empty()) {
      for (const std::string& option : texture_options()) done.push_back(option.substr(2));
    }
    commands.push_back("surfel-render " + shell_file(file) + tool.options_given(done));
    tool::print(fmt::format("{}\n", fmt::join(commands, "\n")));
  }
  return loaded;
}

}  // namespace

std::unique_ptr<LoadedCloud> load_surfels(tool::Tool& tool, const Settings& s,
                                          const std::vector<AskedView>& views,
                                          std::optional<Legend>& legend) {
  const std::string name = tool::shown_name(s.inputs.front());
  CloudLoadOptions options{
      .columns = s.render.compositing().columns(),
      .memory = s.memory,
      .may_stream = s.method == Method::kABuffer && !s.reference && s.filter != Filter::kEwaSource,
      .batch = s.render.batch,
      .sample = needs_guess(s, views)};
  options.columns.levels = wants_levels(s);
  options.columns.places = !s.explained_pixels.empty();
  Coloring coloring;
  coloring.file = name;
  // A map's camera looks down, and what is up in its picture is north.
  coloring.up = s.map ? Vec3d(0, 0, 1) : views.front().options.up;
  auto loaded = load_files(tool, s, views, options, coloring);
  legend = std::move(coloring.legend);
  if (!loaded->has_levels() && (s.lod == Lod::kOn || s.render.lod_error || s.progressive > 1)) {
    throw_input(name, "has no levels of detail; run surfel-lod on it");
  }
  if (!coloring.colored && loaded->basis_cutoff() && *loaded->basis_cutoff() != s.render.cutoff) {
    tool.note(fmt::format("{}: the coefficients were fitted for --cutoff {:g}, not {:g}", name,
                          *loaded->basis_cutoff(), s.render.cutoff));
  }
  tool::tell_left_out(tool, name, loaded->surfels().dropped());
  if (!loaded->store().resident() && loaded->surfels().tree().empty()) {
    tool.note(fmt::format("{}: more than fits into --memory; read piece by piece for each picture",
                          name));
  }
  return loaded;
}

}  // namespace surfel::render_tool
