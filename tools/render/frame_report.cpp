#include "tools/render/frame_report.h"

#include <array>
#include <string>

#include <fmt/format.h>
#include <surfel/store/render_cloud.h>

namespace surfel::render_tool {

tool::Json to_json(const FrameStatistics& frame) {
  tool::Json json = {{"ms", frame.milliseconds},
                     {"stages", tool::Json::object()},
                     {"clusters", frame.clusters},
                     {"splats", frame.splats},
                     {"exact_splats", frame.exact_splats},
                     {"thinned_splats", frame.thinned_splats},
                     {"geometry_passes", frame.geometry_passes},
                     {"fragments", frame.fragments},
                     {"merged_fragments", frame.merged},
                     {"late_weight_share", frame.late_weight_share},
                     {"groups", frame.groups},
                     {"culled_fragments", frame.culled},
                     {"peeled_layers", frame.peeled_layers},
                     {"unpeeled_pixels", frame.unpeeled_pixels}};
  tool::add_stages(json, frame.stages);
  return json;
}

void warn(const tool::Tool& tool, const Settings& s, std::size_t picture,
          const FrameStatistics& frame) {
  if (frame.unpeeled_pixels > 0) {
    tool.note(
        fmt::format("picture {}: {} pixels have more than --peel {} layers; what is behind is "
                    "left out",
                    picture, frame.unpeeled_pixels, s.method_options.peel));
  }
  if (frame.thinned_splats > 0) {
    tool.note(fmt::format(
        "picture {}: thousands of surfels larger than 16x16 pixels lie over each other; "
        "only some of them are drawn, and stand for the others",
        picture));
  }
}

void explain(const tool::Tool& tool, const Settings& s, const LoadedCloud& loaded,
             const Camera& camera, const FrameStatistics& frame) {
  const RenderCloud& cloud = loaded.surfels();
  const RenderOptions& o = s.render;
  const auto say = [&](const std::string& what, const std::string& choice) {
    tool.note(fmt::format("{}: {}", what, choice));
  };
  say("memory", loaded.store().resident() ? "all surfels are kept"
                : cloud.tree().empty() ? "read piece by piece: the surfels are more than --memory"
                                       : "what each picture wants is read from the file");
  if (cloud.tree().empty()) {
    say("level of detail",
        !loaded.has_levels()
            ? fmt::format("none in the file; {} surfels drawn on {}x{} pixels (surfel-lod pays "
                          "where they are many times the pixels)",
                          frame.splats, camera.width, camera.height)
            : "off: the finest level alone");
  } else {
    say("level of detail",
        fmt::format("{} surfels drawn of {}: one may stand for {:g} pixels (--lod-error)",
                    frame.splats, cloud.size() - cloud.first_finest(), o.lod_pixels()));
  }
  if (o.kernel == Kernel::kAuto && o.filter != surfel::Filter::kCircular) {
    say("kernel", fmt::format("exact for {} of {} surfels, whose affine kernels may be off by more "
                              "than {:g} pixels (--kernel-tolerance); affine for the others",
                              frame.exact_splats, frame.splats, o.kernel_tolerance));
  }
  say("shape", cloud.anisotropic() ? "ellipses: some surfels have two variances"
                                   : "discs: no surfel has two variances");
  say("opacity",
      cloud.transparent() ? "some surfels have alpha below 1" : "no surfel has alpha below 1");
  say("normals", o.lit    ? "kept, to shade with"
                 : o.aovs ? "kept, for the picture's channels"
                          : "left out: nothing is shaded");
  say("light", !o.lit ? "none: colours are shown as they are"
               : s.scene_file.empty()
                   ? "beside the eye, above and to the left, from a sky and from the ground"
                   : "as the scene says");
  constexpr std::array<const char*, 3> kReliefs{
      "none", "what is nearer around a pixel darkens it (eye-dome lighting)",
      "what hides the sky around a pixel darkens it (occlusion)"};
  say("relief", kReliefs[static_cast<std::size_t>(o.relief)]);
  if (cloud.groups() > 0 && o.compositing().columns().groups) {
    say("groups", fmt::format("{} in the file", cloud.groups()));
  }
  if (s.method != Method::kABuffer) return;
  say("layers",
      fmt::format("{} (--layers): {} times two surfaces were merged for want of one, after which "
                  "{:.1e} of the kernels came too late for theirs",
                  o.layers, frame.merged, frame.late_weight_share));
}

}  // namespace surfel::render_tool
