// surfel-view: pages to look at surfels in a browser.

#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/shell_quote.h>
#include <surfel/base/version.h>
#include <surfel/intake/intake.h>
#include <surfel/io/file_kind.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/framing.h>
#include <surfel/view/view_cloud.h>
#include <surfel/view/view_page.h>
#include <surfel/view/view_service.h>

#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"
#include "tools/view/server.h"

namespace {

struct Settings {
  std::vector<std::string> inputs;
  std::string output;
  bool serve = false;
  surfel::CameraOptions camera;
  surfel::ViewCloudOptions cloud;
  bool attribute_named = false;  ///< --color-by was given.
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  app.add_option("surfels", s.inputs,
                 "Surfels with normals (PLY, PCD, LAS, LAZ); two are compared "
                 "by a slider")
      ->required()
      ->expected(1, 2);
  surfel::tool::Option* const output =
      app.add_option("-o,--output", s.output, "Page to write (HTML; - = standard output)");
  app.add_flag("--serve", s.serve,
               "Serve the page on this machine alone and print its address, until Ctrl+C; of files "
               "with levels of detail it loads what a view needs")
      ->excludes(output);
  app.group("First view");
  surfel::tool::add_vector(app, "--eye", s.camera.eye, "Place of the eye: X,Y,Z");
  surfel::tool::add_vector(app, "--from", s.camera.from,
                           "Direction from the target to the eye: X,Y,Z");
  surfel::tool::add_vector(app, "--target", s.camera.target,
                           "Point that is looked at and turned about: X,Y,Z");
  surfel::tool::add_text(
      app, "--up", "DIRECTION", "", "What is up: x, y, z, -z or X,Y,Z",
      [&s](const std::string& text) { s.camera.up = surfel::tool::parse_direction("--up", text); });
  app.add_option("--fov", s.camera.fov, "Vertical field of view, degrees, in (0, 180)");
  app.add_option("--ortho", s.camera.ortho,
                 "Orthographic projection of this visible height, scene units, > 0");
  app.group("Options");
  app.add_option("--color-by", s.cloud.attribute,
                 "Column that the page can show instead of colours, where the files have it");
  surfel::tool::add_memory(app, s.cloud.memory,
                           "Memory for surfels; files with levels of detail may be larger");
}

/// Throws Error(kInput) for what is not surfels, with the command that makes some of it.
void require_surfels(const std::string& path) {
  if (path == "-") return;
  const surfel::FileKind kind = surfel::file_kind(path);
  if (kind == surfel::FileKind::kGaussians) surfel::refuse_gaussians(path);
  if (kind == surfel::FileKind::kVolume) surfel::refuse_volume(path);
  const auto made_by = [&](const char* maker, const std::string& more) {
    return fmt::format("{} {}{} -o surfels.ply", maker, surfel::shell_file(path), more);
  };
  if (kind == surfel::FileKind::kMesh) {
    surfel::throw_input(path, "is a mesh; " + made_by("surfel-from-mesh", " --count 300000") +
                                  " makes surfels of it");
  }
  // Files of these formats may hold surfels as well, which only reading tells.
  const std::string extension = surfel::tool::lower_extension(path);
  const bool unsure =
      extension == ".pcd" || extension == ".las" || extension == ".laz" || extension == ".pts";
  if (!unsure && !surfel::holds_surfels(path)) {
    surfel::throw_input(path, "holds raw points; " + made_by("surfel-estimate", "") +
                                  " gives them normals and sizes");
  }
}

/// Throws Error(kInput) where an attribute is asked for by name that a file does not have.
void require_attribute(const Settings& s, const surfel::ViewCloud& cloud) {
  if (!s.attribute_named || !cloud.attribute().empty()) return;
  surfel::throw_input(cloud.path(), fmt::format("has no numbers named {}; surfel-info tells what "
                                                "surfels can be coloured by",
                                                s.cloud.attribute));
}

/// The first view: as surfel-render makes it.
surfel::ViewPageOptions first_view(surfel::tool::Tool& tool, Settings& s,
                                   const surfel::LoadedCloud& loaded) {
  const surfel::ViewChoice choice;
  if (choice.needs_guess(s.camera)) {
    const surfel::ViewHints hints{.up = s.camera.up ? s.camera.up : loaded.up(),
                                  .viewpoint = loaded.viewpoint()};
    const surfel::ViewGuess guess = surfel::guess_view(loaded.sample(), hints);
    const std::string done = surfel::aim_camera(s.camera, choice, guess);
    tool.note(done);
    tool.report()["view"] = done;
  }
  const surfel::SceneExtent extent = loaded.surfels().extent();
  const surfel::Camera camera = surfel::make_camera(s.camera, extent);
  return {.eye = camera.eye,
          .target = surfel::view_target(s.camera, extent),
          .up = s.camera.up_or_y(),
          .fov = s.camera.fov,
          .ortho = s.camera.ortho,
          .generator = fmt::format("surfel-view {}", surfel::version())};
}

void write_page(surfel::tool::Tool& tool, const Settings& s,
                const std::vector<const surfel::ViewCloud*>& clouds,
                const surfel::ViewPageOptions& options) {
  surfel::OutputFile file(s.output, tool.common().no_clobber);
  surfel::write_view_page(clouds, options,
                          [&](std::string_view text) { file.write(text.data(), text.size()); });
  file.commit();
  std::size_t surfels = 0;
  for (const surfel::ViewCloud* cloud : clouds) surfels += cloud->loaded().surfels().size();
  tool.wrote(s.output, fmt::format("a page of {} surfels", surfels));
}

void serve(surfel::tool::Tool& tool, const std::vector<const surfel::ViewCloud*>& clouds,
           const surfel::ViewPageOptions& options) {
  const std::string token = surfel::random_token();
  const surfel::ViewService service(clouds, options, token);
  surfel::view_tool::serve(service, [&](int port) {
    surfel::tool::print(fmt::format("http://127.0.0.1:{}/{}/\n", port, token));
    tool.note("served on this machine alone, until Ctrl+C");
  });
  // To be stopped is how a server ends.
  surfel::withdraw_interrupt();
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-view",
                          "Makes a page that shows surfels in a browser, by EWA splatting.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--serve", "--from", "--up", "--fov", "--color-by"},
                {"surfel-view lion.ply -o lion.html", "surfel-view lion-lod.ply --serve",
                 "surfel-view before.ply after.ply -o slider.html --from 1,0.5,2"});
  tool.files().reads({"surfels"});
  tool.files().writes("--output", surfel::tool::Writes::kPage);
  return tool.run(argc, argv, [&] {
    if (s.output.empty() && !s.serve) {
      surfel::throw_usage(
          "there is no --output; give -o page.html for a page, or --serve to look at once");
    }
    surfel::tool::require_valid(s.camera.problems());
    s.attribute_named = tool.app().get_option("--color-by")->count() > 0;
    std::vector<std::unique_ptr<surfel::ViewCloud>> loaded;
    std::vector<const surfel::ViewCloud*> clouds;
    for (const std::string& input : s.inputs) {
      require_surfels(input);
      loaded.push_back(std::make_unique<surfel::ViewCloud>(input, s.cloud));
      clouds.push_back(loaded.back().get());
      require_attribute(s, *clouds.back());
      const surfel::RenderCloud& surfels = clouds.back()->loaded().surfels();
      surfel::tool::tell_left_out(tool, surfel::tool::shown_name(input), surfels.dropped());
      const std::string hidden = clouds.back()->not_shown();
      if (!hidden.empty()) tool.note(fmt::format("{}: {}", input, hidden));
      tool.report()["surfels"].push_back(surfels.size());
    }
    const surfel::ViewPageOptions options = first_view(tool, s, clouds.front()->loaded());
    if (s.serve) {
      serve(tool, clouds, options);
    } else {
      write_page(tool, s, clouds, options);
    }
  });
}
