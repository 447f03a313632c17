#include "tools/render/surfels.h"

#include <string>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/intake/intake.h>

#include "tools/render/views.h"
#include "tools/support/surfels.h"

namespace surfel::render_tool {
namespace {

/// The surfels of the files, made where they are no surfels yet.
std::unique_ptr<LoadedCloud> load_files(tool::Tool& tool, const Settings& s,
                                        const std::vector<CameraOptions>& views,
                                        const CloudLoadOptions& options) {
  const std::string& first = s.inputs.front();
  std::vector<std::string> commands;
  std::string file = first;
  std::unique_ptr<LoadedCloud> loaded;
  if (s.inputs.size() == 1 && s.keep.empty() && (first == "-" || holds_surfels(first))) {
    loaded = std::make_unique<LoadedCloud>(first, options);
  } else {
    Intake intake(s.inputs);
    Intake::Made made = intake.surfels(half_a_pixel(views, intake.bounds()));
    for (const std::string& line : made.done) tool.note(line);
    commands = std::move(made.commands);
    file = made.file;
    loaded = std::make_unique<LoadedCloud>(made.cloud, tool::shown_name(file), options);
    if (!s.keep.empty()) tool::write_result(tool, made.cloud, s.keep);
  }
  if (s.print_commands) {
    commands.push_back("surfel-render " + shell_file(file) +
                       tool.options_given({"keep", "print-commands"}));
    tool::print(fmt::format("{}\n", fmt::join(commands, "\n")));
  }
  return loaded;
}

}  // namespace

std::unique_ptr<LoadedCloud> load_surfels(tool::Tool& tool, const Settings& s,
                                          const std::vector<CameraOptions>& views) {
  const std::string name = tool::shown_name(s.inputs.front());
  CloudLoadOptions options{
      .columns = s.render.compositing().columns(),
      .memory = s.memory,
      .may_stream = s.method == Method::kABuffer && !s.reference && s.filter != Filter::kEwaSource,
      .batch = s.render.batch,
      .sample = needs_guess(s, views)};
  options.columns.levels = wants_levels(s);
  auto loaded = load_files(tool, s, views, options);
  if (!loaded->has_levels() && (s.lod == Lod::kOn || s.render.lod_error || s.progressive > 1)) {
    throw_input(name, "has no levels of detail; run surfel-lod on it");
  }
  if (loaded->basis_cutoff() && *loaded->basis_cutoff() != s.render.cutoff) {
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
