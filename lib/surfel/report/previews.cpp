#include <algorithm>
#include <array>
#include <memory>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/parallel.h>
#include <surfel/gaussian/gaussian_extent.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/intake/intake.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/image_io.h>
#include <surfel/io/volume_io.h>
#include <surfel/measure/terrain.h>
#include <surfel/measure/view_guess.h>
#include <surfel/render/renderer.h>
#include <surfel/report/previews.h>
#include <surfel/scene/transfer_function.h>
#include <surfel/scene/volume.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/store/colored_source.h>
#include <surfel/volume/gaussians_of_volume.h>

namespace surfel {
namespace {

/// A side that is shown: as guess_view() has it, or by name.
struct Side {
  std::optional<NamedView> view;
  const char* name;
};
constexpr std::array<Side, 4> kSides{
    {{{}, ""}, {NamedView::kLeft, "left"}, {NamedView::kBack, "back"}, {NamedView::kTop, "top"}}};

/// Calls draw(camera options, caption) for all sides.
template <class Draw>
std::vector<Preview> from_all_sides(const ViewGuess& guess, int size, const Draw& draw) {
  std::vector<Preview> previews;
  for (const Side& side : kSides) {
    CameraOptions view;
    view.width = view.height = size;
    const std::string said = aim_camera(view, {.guess_up = false, .view = side.view}, guess);
    previews.push_back({side.view ? side.name : said, draw(view)});
  }
  return previews;
}

/// Colours of surfels that have none: terrain by elevation, others by intensity where they have it.
class ColorsOfNone {
 public:
  std::unique_ptr<SurfelSource> operator()(const CloudFacts& facts) {
    if (facts.source.attributes().color) return nullptr;
    const SurfaceSample sample = facts.sample();
    const ViewGuess guess = guess_view(sample, {.up = facts.up, .viewpoint = facts.viewpoint});
    std::optional<std::string> attribute = AttributeValues::find(facts.source, "intensity");
    const bool terrain = is_terrain(sample, guess);
    if (terrain) attribute = "elevation";
    if (!attribute) return nullptr;
    const AttributeValues values(facts.source, *attribute, guess.up, {});
    const AttributeSummary summary = values.summary(facts.first_finest, facts.source.size());
    if (summary.count == 0) return nullptr;
    AttributeColors colors{.map = terrain ? ColorMap::kTerrain : ColorMap::kGrey};
    std::tie(colors.min, colors.max) = summary.robust_range();
    name_ = *attribute;
    return std::make_unique<ColoredSource>(facts.source, values, colors);
  }
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

std::vector<Preview> of_surfels(const LoadedCloud& loaded, const std::string& colored, int size,
                                const std::string& note) {
  const ColorLight light = colored.empty() ? loaded.color_light() : ColorLight::kUnsaid;
  const ViewGuess guess =
      guess_view(loaded.sample(), {.up = loaded.up(), .viewpoint = loaded.viewpoint()});
  const SceneExtent extent = loaded.surfels().extent();
  Scene scene = default_scene();
  RenderOptions options;
  options.lit = light != ColorLight::kRecorded;
  if (light == ColorLight::kUnsaid && !loaded.surfels().transparent()) {
    options.relief = Relief::kOcclusion;
  }
  if (scene.sky) scene.sky->up = guess.up;
  Renderer renderer(loaded.store(), scene, options);
  std::vector<Preview> previews = from_all_sides(guess, size, [&](const CameraOptions& view) {
    return renderer.render(make_camera(view, extent));
  });
  std::string& caption = previews.front().caption;
  if (!colored.empty()) caption += "; coloured by " + colored;
  if (!note.empty()) caption += "; " + note;
  return previews;
}

/// The mean values of cubes of `edge` voxels a side; voxels beyond the last whole cube are left
/// out.
Volume coarser(const Volume& volume, std::size_t edge) {
  Volume out = volume;
  const auto size = static_cast<double>(edge);
  const double middle = (size - 1) / 2;
  out.origin = volume.world({middle, middle, middle});
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out.size[axis] = volume.size[axis] / edge;
    out.step[axis] *= size;
  }
  out.value.assign(out.voxels(), 0);
  parallel_each(out.size[2], 1, [&](std::size_t z) {
    for (std::size_t y = 0; y < out.size[1]; ++y) {
      for (std::size_t x = 0; x < out.size[0]; ++x) {
        double sum = 0;
        for (std::size_t k = z * edge; k < (z + 1) * edge; ++k) {
          for (std::size_t j = y * edge; j < (y + 1) * edge; ++j) {
            const float* row = volume.value.data() + volume.index(x * edge, j, k);
            sum = std::accumulate(row, row + edge, sum);
          }
        }
        out.value[out.index(x, y, z)] = static_cast<float>(sum / (size * size * size));
      }
    }
  });
  return out;
}

std::vector<Preview> of_gaussians(const GaussianCloud& cloud, int size) {
  const SceneExtent extent = gaussian_extent(cloud);
  ViewHints hints{.up = cloud.up, .viewpoint = {}};
  if (!hints.up) {
    // Trained files have the axes of their cameras, whose y points down, as rows of images do.
    const bool density = cloud.rule == AmplitudeRule::kDensity;
    hints.up = Vec3d(0, -1, 0);
    hints.up_reason = density ? "as rows of images go down" : "as trained splats mostly have it";
  }
  const ViewGuess guess = guess_view(sample_surface(cloud), hints);
  GaussianOptions options;
  options.profile = profile_of(cloud);
  GaussianRenderer renderer(cloud, options);
  return from_all_sides(guess, size, [&](const CameraOptions& view) {
    return renderer.render(make_camera(view, extent));
  });
}

/// As the Gaussians that surfel-from-volume makes of it are drawn.
std::vector<Preview> of_volume(const std::string& path, const PreviewOptions& options) {
  Volume volume = read_volume(path);
  const std::string name = likely_transfer_function(volume);
  std::size_t edge = 1;
  while (volume.voxels() / (edge * edge * edge) > options.most_voxels) ++edge;
  const std::size_t narrowest = *std::min_element(volume.size.begin(), volume.size.end());
  edge = std::min(edge, narrowest);
  if (edge > 1) volume = coarser(volume, edge);
  const TransferFunction function = absolute(transfer_function(name), volume);
  std::vector<Preview> previews =
      of_gaussians(gaussians_of_volume(volume, function, path), options.size);
  std::string& caption = previews.front().caption;
  caption += fmt::format("; by the transfer function {}", name);
  if (edge > 1) caption += fmt::format(", means of {0} x {0} x {0} voxels", edge);
  return previews;
}

}  // namespace

std::vector<Preview> preview_pictures(const std::string& path, const PreviewOptions& options) {
  const FileKind kind = file_kind(path);
  if (kind == FileKind::kImage) return {{"", read_premultiplied_image(path)}};
  if (kind == FileKind::kGaussians) return of_gaussians(read_gaussians(path), options.size);
  if (kind == FileKind::kVolume) return of_volume(path, options);
  ColorsOfNone colors;
  CloudLoadOptions load{.columns = {.levels = true},
                        .memory = options.memory,
                        .sample = true,
                        .wrap = [&](const CloudFacts& facts) { return colors(facts); }};
  const CloudReadOptions& part = options.part;
  const bool whole = part.columns.empty() && !part.level && !part.bounds && part.every == 1;
  if (kind == FileKind::kCloud && whole && holds_surfels(path)) {
    const LoadedCloud loaded(path, load);
    return of_surfels(loaded, colors.name(), options.size, "");
  }
  CloudReadOptions some = part;
  std::string note;
  if (kind == FileKind::kCloud && CloudReader::reads_pieces(path)) {
    const std::uint64_t points = CloudReader(path, part).size() / part.every;
    const std::uint64_t every = (points + options.most_points - 1) / options.most_points;
    if (every > 1) {
      some.every = part.every * every;
      note = fmt::format("one in {} points", some.every);
    }
  }
  Intake intake({path}, some);
  const Bounds box = intake.bounds();
  // Half a pixel, where the scene's box is as wide as the picture.
  const double spacing =
      box.empty() || !(box.diagonal() > 0) ? 1 : box.diagonal() / (2.0 * options.size);
  const Intake::Made made = intake.surfels(spacing);
  const LoadedCloud loaded(made.cloud, path, load);
  return of_surfels(loaded, colors.name(), options.size, note);
}

}  // namespace surfel
