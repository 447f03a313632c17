// surfel-render: pictures of surfels by EWA splatting, and the truths to measure them against.

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/progress.h>
#include <surfel/base/timing.h>
#include <surfel/io/coordinate_file.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/image_queue.h>
#include <surfel/io/picture_part.h>
#include <surfel/ranks/ranks.h>
#include <surfel/render/contact_sheet.h>
#include <surfel/render/legend.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/map_place.h>
#include <surfel/scene/surface_sample.h>

#include "tools/render/coloring.h"
#include "tools/render/frame_report.h"
#include "tools/render/gaussians.h"
#include "tools/render/light.h"
#include "tools/render/made_by.h"
#include "tools/render/painters.h"
#include "tools/render/pixel_report.h"
#include "tools/render/settings.h"
#include "tools/render/surfels.h"
#include "tools/render/views.h"
#include "tools/support/movie.h"
#include "tools/support/run_ranks.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

using namespace surfel::render_tool;

namespace {

/// Most pictures that wait to be encoded: one while the next is drawn, and one to spare.
constexpr std::size_t kPicturesInFlight = 2;

/// The command line with "-o" before a picture that follows a file, where no output is named:
/// "surfel-render a.ply a.png".
std::vector<char*> with_output(int argc, char** argv) {
  static std::string option = "-o";
  std::vector<char*> words(argv, argv + argc);
  const auto starts = [](const char* word, const char* with) {
    return std::string_view(word).starts_with(with);
  };
  const bool named = std::any_of(words.begin(), words.end(), [&](const char* word) {
    return starts(word, "-o") || starts(word, "--output") || starts(word, "--config");
  });
  for (std::size_t i = 2; i < words.size() && !named; ++i) {
    // After an option the picture may be that option's value.
    if (!surfel::is_image_name(words[i]) || starts(words[i - 1], "-")) continue;
    words.insert(words.begin() + static_cast<std::ptrdiff_t>(i), option.data());
    break;
  }
  return words;
}

/// What is drawn: surfels, or a mesh in their stead, which the surfels then only frame, or
/// Gaussians.
struct Subject {
  std::unique_ptr<surfel::LoadedCloud> loaded;
  std::optional<MeshPainter> mesh;
  std::optional<GaussianPainter> gaussians;
  std::optional<surfel::Legend> legend;  ///< Of the surfels' colours, where they have one.

  surfel::SceneExtent extent() const {
    if (gaussians) return gaussians->extent();
    return loaded ? loaded->surfels().extent() : mesh->extent();
  }
};

/// Reads what is to be drawn, and reports what it is. Chooses the light of --mesh.
void load(surfel::tool::Tool& tool, Settings& s, const surfel::Scene& scene,
          const std::vector<AskedView>& asked, bool gaussians, Subject& subject) {
  const surfel::Timer timer;
  if (gaussians) {
    subject.gaussians.emplace(tool, s);
    tool.report()["load_ms"] = timer.milliseconds();
    return;
  }
  if (!s.inputs.empty()) subject.loaded = load_surfels(tool, s, asked, subject.legend);
  if (!s.mesh.empty()) subject.mesh.emplace(tool, s, scene);
  const surfel::LoadedCloud* loaded = subject.loaded.get();
  const surfel::RenderCloud* surfels = loaded ? &loaded->surfels() : nullptr;
  surfel::tool::Json& report = tool.report();
  report["load_ms"] = timer.milliseconds();
  report["surfels"] = surfels ? surfels->size() : 0;
  report["levels"] = surfels && !surfels->tree().empty() ? surfels->tree().front().level + 1 : 1;
  report["dropped"] = surfels ? surfels->dropped().total() : 0;
  report["copies_left_out"] = surfels ? surfels->copies() : 0;
  report["streamed"] = loaded && !loaded->store().resident();
  report["faces"] = subject.mesh ? subject.mesh->mesh().face.size() : 0;
}

/// The cameras to render from: what the user left open is guessed from what is drawn. The sky of
/// the scene is up in the (first) picture unless the scene says otherwise.
std::vector<surfel::View> find_views(surfel::tool::Tool& tool, const Settings& s,
                                     const Subject& subject, std::vector<AskedView> asked,
                                     surfel::Scene& scene) {
  if (subject.gaussians) {
    subject.gaussians->aim(tool, s, asked);
  } else if (const surfel::LoadedCloud* loaded = subject.loaded.get()) {
    aim(tool, s, loaded->sample(), {.up = loaded->up(), .viewpoint = loaded->viewpoint()}, asked);
  } else if (needs_guess(s, asked)) {
    const surfel::TriangleMesh& mesh = subject.mesh->mesh();
    aim(tool, s, surfel::sample_surface(mesh), {.up = mesh.up, .viewpoint = {}}, asked);
  }
  if (scene.sky && !scene.sky->up) {
    const AskedView& first = asked.front();
    scene.sky->up =
        first.known ? first.options.up.value_or(first.likely_up) : first.options.up_or_y();
  }
  const surfel::SceneExtent extent = subject.extent();
  tool.report()["stray_points"] = extent.stray;
  return complete_views(tool, s, asked, extent);
}

/// Leaves only a part of each picture to be drawn. Throws Error(kUsage) where there is none.
void choose_part(const surfel::PartNumber& part, std::vector<surfel::View>& views) {
  for (surfel::View& view : views) {
    if (view.lens) {
      surfel::throw_usage("--tiles is of cameras without distortion; see colmap image_undistorter");
    }
    const int height = view.camera.height;
    if (part.parts > surfel::PartNumber::most_parts(height)) {
      surfel::throw_usage(fmt::format("--tiles asks for {} parts, but {} rows have {} at most",
                                      part.parts, height, surfel::PartNumber::most_parts(height)));
    }
    view.camera.rows = part.rows(height);
  }
}

/// The coordinate system of a map: as asked for, or what the files say alike.
std::optional<surfel::CoordinateSystem> map_system(const Settings& s) {
  if (s.epsg) return surfel::coordinate_system_of_code(*s.epsg);
  std::optional<surfel::CoordinateSystem> known;
  for (const std::string& input : s.inputs) {
    const auto system = surfel::read_coordinate_system(input);
    if (system && known && *system != *known) return std::nullopt;
    if (system) known = system;
  }
  return known;
}

/// Where a map's pixels lie.
std::optional<surfel::MapPlace> map_of(const Settings& s, const surfel::Camera& camera) {
  if (!s.map) return std::nullopt;
  surfel::MapPlace place = surfel::map_place(camera);
  place.system = map_system(s);
  return place;
}

void write_world_file(const surfel::tool::Tool& tool, const Settings& s,
                      const surfel::Camera& camera) {
  surfel::OutputFile file(surfel::world_file_name(s.output), tool.common().no_clobber);
  file.write(surfel::world_file(surfel::map_place(camera)));
  file.commit();
}

/// The picture with what it is made of, in one.
surfel::Image explained(const Settings& s, const surfel::LoadedCloud& loaded,
                        const surfel::View& view, const surfel::Image& image) {
  if (view.lens) {
    surfel::throw_usage(
        "--contact-sheet is of cameras without distortion; see colmap "
        "image_undistorter");
  }
  const auto& color = s.sheet_background;
  return surfel::contact_sheet(image, surfel::surfels_per_pixel(loaded.store(), view.camera),
                               {color[0], color[1], color[2]});
}

/// What files of pictures say of how they were made.
std::vector<std::pair<std::string, std::string>> metadata(const Subject& subject) {
  std::vector<std::pair<std::string, std::string>> said{{"Software", "surfel-render"}};
  if (subject.gaussians) said.emplace_back("Profile", subject.gaussians->profile());
  return said;
}

/// Throws Error(kUsage) where several processes cannot share the work.
void check_ranks(surfel::tool::Tool& tool, const Settings& s) {
  surfel::tool::require_valid(surfel::tool::without_effect(
      tool.app(),
      {"--tiles", "--contact-sheet", "--keep", "--print-commands", "--explain", "--explain-pixel"},
      "by several processes"));
  if (s.projection == Projection::kEquirectangular) {
    surfel::throw_usage("panoramas are made by one process; start surfel-render without mpirun");
  }
}

/// Paints the rows of a view that this process is to paint; process 0 has the whole picture then.
surfel::Image paint_rows(const Settings& s, const Paint& paint, surfel::View view,
                         surfel::Scene& scene, surfel::Ranks& ranks, surfel::RowBalance& balance,
                         surfel::FrameStatistics& frame,
                         const std::function<void(double)>& progress) {
  if (view.lens) {
    surfel::throw_usage(
        "pictures through lenses are made by one process; start surfel-render without mpirun");
  }
  const std::vector<surfel::RowRange> rows = balance.rows(view.camera.height);
  view.camera.rows = rows[static_cast<std::size_t>(ranks.rank())];
  surfel::Image image;
  if (view.camera.rows.begin < view.camera.rows.end) {
    image = paint_view(s, paint, view, scene, frame, progress);
  }
  ranks.gather(image, rows);
  balance.learn(rows, ranks.all(frame.milliseconds));
  return image;
}

/// The pixels of a picture that are to be explained, explained.
std::vector<surfel::PixelExplanation> pixels_of(const Settings& s, Subject& subject,
                                                const surfel::Scene& scene,
                                                const surfel::Camera& camera) {
  if (subject.gaussians) return subject.gaussians->explain(s, camera);
  return subject.loaded ? explain_pixels(s, *subject.loaded, scene, camera)
                        : std::vector<surfel::PixelExplanation>();
}

/// Makes the pictures of all views, each in several steps where that is asked for, and writes them;
/// returns their files. \param ranks  the processes that do so together; null: this one alone.
std::vector<std::string> draw(surfel::tool::Tool& tool, const Settings& s, Subject& subject,
                              surfel::Scene& scene, const std::vector<Paint>& steps,
                              const std::vector<surfel::View>& views,
                              const std::vector<Shot>& shots, surfel::Ranks* ranks) {
  const std::size_t pictures = shots.size() * steps.size();
  const surfel::Legend* legend =
      subject.legend && wants_legend(s) && !s.contact_sheet ? &*subject.legend : nullptr;
  if (s.legend == LegendChoice::kOn) require_room(views);
  // The writer adds to the report, so what is said of frames is kept apart until it is done.
  std::vector<surfel::tool::Json> frames(pictures);
  std::uint64_t pixels = 0;
  for (const Shot& shot : shots) {
    const surfel::Camera& camera = views[shot.number].camera;
    const surfel::RowRange rows = camera.drawn_rows();
    pixels += static_cast<std::uint64_t>(camera.width) *
              static_cast<std::uint64_t>(rows.end - rows.begin);
  }
  surfel::ProgressStage stage("rendering", pixels * steps.size(), "pixels");
  std::vector<std::string> files;
  surfel::ImageQueue queue(pictures > 1 ? kPicturesInFlight : 0);
  surfel::RowBalance balance(ranks ? ranks->count() : 1);
  for (std::size_t i = 0; i < pictures; ++i) {
    const Shot& shot = shots[i / steps.size()];
    const surfel::View& view = views[shot.number];
    const std::size_t step = i % steps.size();
    surfel::FrameStatistics frame;
    const auto progress = [&](double share) {
      stage.set_share((static_cast<double>(i) + share) / static_cast<double>(pictures));
    };
    surfel::Image image =
        ranks ? paint_rows(s, steps[step], view, scene, *ranks, balance, frame, progress)
              : paint_view(s, steps[step], view, scene, frame, progress);
    if (ranks && ranks->rank() > 0) continue;
    if (legend) surfel::draw_legend(*legend, image);
    if (s.contact_sheet) image = explained(s, *subject.loaded, view, image);
    warn(tool, s, shot.number, frame);
    if (s.explain && i + 1 == steps.size()) explain(tool, s, *subject.loaded, view.camera, frame);
    frames[i] = to_json(frame);
    if (step + 1 == steps.size()) {
      for (const surfel::PixelExplanation& pixel : pixels_of(s, subject, scene, view.camera)) {
        const surfel::Legend* stands_for = subject.legend ? &*subject.legend : nullptr;
        frames[i]["pixels"].push_back(to_json(pixel, stands_for));
        // Before the picture, which must not stay where its report cannot be written.
        surfel::tool::print(to_text(pixel, shot.file, stands_for));
      }
    }
    // Only the first step must find no file: the others find its.
    if (step == 0) files.push_back(shot.file);
    surfel::ImageWriteOptions options{
        .no_clobber = tool.common().no_clobber && step == 0,
        .metadata = metadata(subject),
        .world_to_camera = surfel::world_to_camera_matrix(view.camera),
        .map = map_of(s, view.camera)};
    if (s.tiles) {
      options = surfel::part_options(*s.tiles, image.height, s.made_by, options);
      image = surfel::part_of(image, *s.tiles);
    } else if (says_made_by(s) && step + 1 == steps.size()) {
      options.metadata.emplace_back("ImageDescription", made_by_mark(s, shot.number));
    }
    queue.write(std::move(image), shot.file, std::move(options));
    progress(1);
  }
  queue.finish();
  for (std::size_t i = 0; i < queue.milliseconds().size(); ++i) {
    frames[i]["encode_ms"] = queue.milliseconds()[i];
  }
  tool.report()["frames"] = frames;
  return files;
}

/// Says what was written.
void tell(const surfel::tool::Tool& tool, const Settings& s, const surfel::Camera& camera,
          std::size_t pictures, const std::vector<std::string>& files) {
  const std::string part =
      s.tiles ? fmt::format("part {} of {} of ", s.tiles->number, s.tiles->parts) : "";
  const std::string size = fmt::format("{}{}x{} pixels", part, camera.width, camera.height);
  tool.wrote(files.size() == 1 ? files.front() : s.output,
             pictures == 1 ? size : fmt::format("{} pictures of {}", pictures, size), files);
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-render",
                          "Renders surfels by screen space EWA splatting (Zwicker et al. 2001).");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--size", "--from", "--eye", "--fov", "--zoom", "--turntable",
                 "--background", "--scene", "--shading", "--color-by", "--image"},
                {"surfel-render lion.obj -o lion.png",
                 "surfel-render lion.obj --image skin.png -o lion.jpg --from 1,0.5,2 --size "
                 "800x600 --background navy",
                 "surfel-render lion.ply -o lion_%04d.png --turntable 36 --size 512"});
  tool.reads_images();
  tool.reads_named_files();
  tool.files().reads({"files", "--camera", "--views", "--path", "--scene", "--mesh", "--image",
                      "--normal-map", "--bump"});
  tool.files().writes("--output", surfel::tool::Writes::kFilm);
  tool.files().writes("--keep", surfel::tool::Writes::kSurfels);
  tool.name_fields({{"y_down", "--normal-y"}});
  std::vector<char*> words = with_output(argc, argv);
  const auto body = [&](surfel::Ranks* ranks) {
    settle(tool.app(), s);
    if (ranks) check_ranks(tool, s);
    const bool leads = !ranks || ranks->rank() == 0;
    surfel::Scene scene = load_scene(tool, s);
    const std::vector<AskedView> asked = asked_views(s);
    if (s.tiles || says_made_by(s)) s.made_by = made_by(tool, s);
    std::optional<surfel::tool::Movie> movie;
    if (wants_film(s)) {
      if (s.skip_existing && is_marked(s.output, made_by_mark(s, {}))) {
        tool.note(s.output + " is there already");
        return;
      }
      if (leads) movie.emplace(s.output, s.fps, tool.common().no_clobber);
    }
    // Only process 0 writes pictures.
    const std::string output = movie           ? movie->pattern()
                               : wants_film(s) ? std::string("%06d.png")
                                               : s.output;
    const std::vector<Shot> shots = asked_shots(tool, s, output, asked);
    if (shots.empty()) return;
    for (const Shot& shot : shots) {
      if (!movie && shot.file != s.output) tool.files().write_also("--output", shot.file);
    }
    if (s.map) tool.files().write_also("the world file", surfel::world_file_name(s.output));
    Subject subject;
    const bool gaussians = draws_gaussians(tool.app(), s);
    load(tool, s, scene, asked, gaussians, subject);
    if (subject.loaded && !subject.mesh) {
      const bool named = s.color_by != "auto" && s.color_by != "none";
      choose_light(
          tool, s, surfel::tool::shown_name(s.inputs.front()),
          named || subject.legend ? surfel::ColorLight::kUnsaid : subject.loaded->color_light(),
          subject.loaded->surfels().transparent());
    }
    std::vector<surfel::View> views = find_views(tool, s, subject, asked, scene);
    if (s.tiles) choose_part(*s.tiles, views);
    require_pixels(s, views);
    const std::vector<Paint> steps = subject.gaussians ? std::vector{subject.gaussians->paint()}
                                     : subject.mesh    ? std::vector{subject.mesh->paint()}
                                                       : surfel_steps(s, *subject.loaded, scene);
    std::vector<std::string> files = draw(tool, s, subject, scene, steps, views, shots, ranks);
    if (!leads) return;
    if (movie) {
      movie->join(s.skip_existing ? made_by_mark(s, {}) : "");
      files = {s.output};
    }
    const surfel::Camera& first = views[shots.front().number].camera;
    if (s.map) write_world_file(tool, s, first);
    tell(tool, s, first, shots.size(), files);
  };
  return surfel::tool::run_ranks(tool, static_cast<int>(words.size()), words.data(), body);
}
