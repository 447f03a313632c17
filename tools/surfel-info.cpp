// surfel-info: what is in a file of surfels, Gaussians, a mesh, a volume or an image, and is it
// sound.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/output_file.h>
#include <surfel/base/plugin.h>
#include <surfel/base/shell_quote.h>
#include <surfel/intake/intake.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/gaussian_levels.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/volume_io.h>
#include <surfel/measure/cloud_needs.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/measure/cloud_summary.h>
#include <surfel/measure/gaussian_statistics.h>
#include <surfel/measure/mesh_statistics.h>
#include <surfel/measure/mesh_topology.h>
#include <surfel/measure/view_guess.h>
#include <surfel/measure/volume_statistics.h>
#include <surfel/render/render_options.h>
#include <surfel/report/info_charts.h>
#include <surfel/report/info_page.h>
#include <surfel/report/page_chart.h>
#include <surfel/report/previews.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/store/attribute_values.h>

#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

using surfel::tool::Tool;
using Json = nlohmann::ordered_json;

struct Settings {
  surfel::CloudStatisticsOptions statistics;
  surfel::tool::PartSettings part;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  std::string html;                     ///< Page to write; empty: none.
};

Json describe(const surfel::Vec3d& v) { return {v.x(), v.y(), v.z()}; }

Json describe(const surfel::Bounds& box) {
  if (box.empty()) return nullptr;
  return {{"min", describe(box.min)}, {"max", describe(box.max)}, {"diagonal", box.diagonal()}};
}

Json describe(const std::optional<surfel::Distribution>& d) {
  if (!d) return nullptr;
  return {{"mean", d->mean},     {"min", d->min},           {"p5", d->percentile_5},
          {"median", d->median}, {"p95", d->percentile_95}, {"max", d->max}};
}

Json describe(const std::optional<surfel::Coverage>& c) {
  if (!c) return nullptr;
  return {{"hole_share", c->hole_share},
          {"overlap", c->overlap},
          {"cells", c->cells},
          {"cell_area_mean", c->cell_area_mean}};
}

/// Sampled surfels by the number of others within their radius.
Json describe(const std::optional<surfel::NeighborCounts>& n) {
  if (!n) return nullptr;
  return {{"samples", n->samples()}, {"none_to_24_and_more", n->surfels}};
}

Json describe(const surfel::ViewGuess& view) {
  return {{"up", describe(view.up)}, {"front", describe(view.front)}, {"reason", view.reason}};
}

/// The command to run next: raw points become surfels, and surfels a picture.
std::string next_command(const surfel::CloudSummary& summary, const std::string& file,
                         const surfel::CloudReadOptions& part) {
  const surfel::SurfelCloud& cloud = summary.like;
  if (!surfel::has_variance(cloud)) {
    surfel::SurfelCloud told = cloud;
    if (!summary.tells_sensors) told.scan_viewpoints.clear();
    return surfel::estimate_command(told, file, part);
  }
  const std::string command = surfel::picture_command(file);
  const double fitted = cloud.basis_cutoff.value_or(surfel::RenderOptions().cutoff);
  if (fitted == surfel::RenderOptions().cutoff) return command;
  return fmt::format("{} --cutoff {:g}", command, fitted);
}

/// What surfels can be coloured by, with the spread of the values.
Json describe(const std::vector<std::pair<std::string, surfel::AttributeSummary>>& summaries) {
  Json attributes = Json::array();
  for (const auto& [name, s] : summaries) {
    Json item = {{"name", name}, {"missing", s.missing}};
    if (s.count > 0) {
      item.update({{"min", s.min},
                   {"p1", s.percentile_1},
                   {"median", s.median},
                   {"p99", s.percentile_99},
                   {"max", s.max}});
    }
    attributes.push_back(item);
  }
  return attributes;
}

/// Where the scanner stood, or of several scans the scanners.
Json describe_viewpoint(const surfel::SurfelCloud& cloud) {
  if (cloud.viewpoint) return describe(cloud.viewpoint->position);
  if (cloud.scan_viewpoints.empty()) return nullptr;
  Json views = Json::array();
  for (const surfel::Viewpoint& view : cloud.scan_viewpoints) {
    views.push_back(describe(view.position));
  }
  return views;
}

/// Surfels of a piece of a file, so that a piece takes an eighth of the memory.
std::size_t piece_size(std::uint64_t memory, std::size_t row_bytes) {
  constexpr std::uint64_t kLeast = 1 << 12;
  constexpr std::uint64_t kMost = 1 << 18;
  return std::clamp(memory / 8 / surfel::summary_bytes(1, 2 * row_bytes), kLeast, kMost);
}

/// Summarises a file, in pieces where it does not fit into the memory.
surfel::CloudSummary summarize(const std::string& file, const Settings& s) {
  const std::uint64_t memory = surfel::memory_to_use(s.memory);
  const surfel::CloudReadOptions part = s.part.options();
  const auto bytes = [](std::uint64_t surfels, const surfel::SurfelCloud& first) {
    return surfel::summary_bytes(surfels, surfel::row_bytes(first));
  };
  if (surfel::tool::may_not_fit(file, memory)) {
    if (surfel::CloudReader::reads_pieces(file)) {
      const surfel::CloudReader reader(file, part);
      const surfel::SurfelCloud first = reader.first();
      if (bytes(reader.size(), first) > memory) {
        const std::size_t most = piece_size(memory, surfel::row_bytes(first));
        return surfel::summarize_cloud(
            [&](surfel::FunctionRef<void(const surfel::SurfelCloud&)> visit) {
              reader.for_each_placed(most, [&](const surfel::SurfelCloud& piece) { visit(piece); });
            },
            s.statistics, file, memory);
      }
    } else {
      surfel::tool::require_room(file, part, memory, bytes);
    }
  }
  return surfel::summarize_cloud(surfel::read_cloud(file, part), s.statistics, file);
}

Json describe_cloud(const std::string& file, const Settings& settings) {
  const surfel::CloudSummary summary = summarize(file, settings);
  const surfel::SurfelCloud& cloud = summary.like;
  const surfel::CloudStatistics& s = summary.statistics;
  Json properties = Json::array();
  for (const auto& [name, type] : surfel::cloud_properties(cloud)) {
    properties.push_back({{"name", name}, {"type", type}});
  }
  Json out = {{"file", file}, {"kind", "surfels"}, {"count", s.count}, {"properties", properties}};
  out["coarser_levels"] = cloud.coarser_skipped;
  out["unmeasured_points"] = cloud.unmeasured_skipped;
  out["bounds"] = describe(s.bounds);
  out["strays"] = nullptr;
  if (const auto& strays = summary.strays) {
    out["strays"] = {
        {"count", strays->count}, {"first", strays->first}, {"at", describe(strays->place)}};
  }
  out["origin"] = describe(cloud.origin);
  out["spacing"] = describe(s.spacing);
  out["coincident_share"] = s.coincident_share;
  out["cutoff"] = settings.statistics.cutoff;
  out["radius"] = describe(s.radius);
  out["neighbors"] = describe(s.neighbors);
  out["coverage"] = describe(s.coverage);
  out["nonfinite_positions"] = s.nonfinite_positions;
  out["nonfinite_normals"] = s.nonfinite_normals;
  out["zero_normals"] = s.zero_normals;
  out["non_unit_normals"] = s.non_unit_normals;
  out["nonfinite_values"] = s.nonfinite_values;
  out["negative_variances"] = s.negative_variances;
  out["clipped_by_one_line"] = summary.by_lines[1];
  out["clipped_by_two_lines"] = summary.by_lines[2];
  out["clipped_at_center"] = summary.cut_off;
  out["view"] = describe(summary.view);
  out["viewpoint"] = describe_viewpoint(cloud);
  out["basis_cutoff"] = cloud.basis_cutoff ? Json(*cloud.basis_cutoff) : Json(nullptr);
  out["provenance"] = cloud.provenance;
  out["comments"] = cloud.comments;
  out["attributes"] = describe(summary.attributes);
  out["needs"] = Json::array();
  for (const surfel::CloudNeed& need : summary.needs) {
    out["needs"].push_back(
        {{"topic", need.topic}, {"measure", need.measure}, {"command", need.command}});
  }
  out["next"] = next_command(summary, file, settings.part.options());
  return out;
}

/// Adds what the half-edges of a mesh tell.
void describe_topology(const surfel::TriangleMesh& mesh, Json& out) {
  const surfel::MeshTopology t = surfel::mesh_topology(mesh);
  Json places = Json::array();
  for (const surfel::Vec3d& place : t.non_manifold_places) places.push_back(describe(place));
  out["border_loops"] = t.border_loops;
  out["longest_border"] = t.longest_border;
  out["pinched_vertices"] = t.non_manifold_vertices;
  out["non_manifold_at"] = places;
  out["non_orientable"] = t.non_orientable_components;
  out["crease_edges"] = t.crease_edges;
  out["crease_length"] = t.crease_length;
  out["euler_characteristic"] = t.euler_characteristic;
  out["genus"] = t.genus ? Json(*t.genus) : Json(nullptr);
  out["repair"] = {{"components", t.components},
                   {"faces_turned", t.turned_faces},
                   {"vertices_split", t.split_vertices},
                   {"faces_left_out", t.left_out_faces}};
}

Json describe_mesh(const std::string& file, const Tool& tool) {
  const surfel::TriangleMesh mesh = surfel::read_mesh(file);
  for (const std::string& note : mesh.notes) tool.note(file + ": " + note);
  const surfel::MeshStatistics s = surfel::mesh_statistics(mesh);
  Json materials = Json::array();
  for (const surfel::MeshMaterial& material : mesh.material) {
    materials.push_back({{"name", material.name}, {"texture", material.texture}});
  }
  Json out = {{"file", file},
              {"kind", "mesh"},
              {"vertices", s.vertices},
              {"faces", s.faces},
              {"components", s.components},
              {"border_edges", s.edges.border},
              {"border_length", s.edges.border_length},
              {"non_manifold_edges", s.edges.non_manifold},
              {"inconsistent_edges", s.edges.inconsistent},
              {"degenerate_faces", mesh.degenerate_faces},
              {"area", s.area},
              {"bounds", describe(s.bounds)},
              {"uv", !mesh.wedge_uv.empty()},
              {"normals", !mesh.wedge_normal.empty()},
              {"colors", !mesh.color.empty()},
              {"materials", materials},
              {"view", describe(surfel::guess_view(surfel::sample_surface(mesh),
                                                   {.up = mesh.up, .viewpoint = {}}))}};
  if (surfel::has_plugin("openmesh")) {
    describe_topology(mesh, out);
  } else {
    tool.note(file + ": its half-edges are not described; for these " +
              surfel::plugin_advice("openmesh"));
  }
  out["next"] = surfel::picture_command(file);
  return out;
}

Json describe_image(const std::string& file) {
  const surfel::Image image = surfel::read_image(file, true);
  std::size_t nonfinite = 0;
  for (const float value : image.data) nonfinite += std::isfinite(value) ? 0 : 1;
  return {{"file", file},
          {"kind", "image"},
          {"width", image.width},
          {"height", image.height},
          {"channels", image.channels},
          {"nonfinite_values", nonfinite},
          {"next", fmt::format("surfel-compare {} OTHER.png", surfel::shell_file(file))}};
}

Json describe(const surfel::Histogram& h) { return {{"edges", h.edges}, {"counts", h.counts}}; }

/// The renderer that a file was trained with, as far as it says.
Json trained_with(const surfel::GaussianCloud& cloud) {
  switch (cloud.trained_with) {
    case surfel::TrainedWith::kInria:
      return "inria";
    case surfel::TrainedWith::kMip:
      return "mip";
    case surfel::TrainedWith::k2dgs:
      return "2dgs";
    case surfel::TrainedWith::kUnknown:
      break;
  }
  return nullptr;
}

/// What the amplitudes of Gaussians are.
const char* rule_name(surfel::AmplitudeRule rule) {
  switch (rule) {
    case surfel::AmplitudeRule::kSurfel:
      return "surfel";
    case surfel::AmplitudeRule::kCompensated:
      return "opacity, compensated";
    case surfel::AmplitudeRule::kDensity:
      return "density";
    case surfel::AmplitudeRule::kOpacity:
      break;
  }
  return "opacity";
}

/// How many Gaussians the levels of detail of a file have, finest first.
Json levels_of(const std::string& file) {
  const surfel::GaussianLevels levels(file);
  std::vector<std::size_t> counts;
  for (const surfel::TreeCluster& cluster : levels.head().tree) {
    counts.resize(std::max<std::size_t>(counts.size(), cluster.level + std::size_t{1}));
    counts[cluster.level] += cluster.end - cluster.begin;
  }
  return counts;
}

Json describe_gaussians(const std::string& file) {
  const surfel::GaussianCloud cloud = surfel::read_gaussians(file);
  const surfel::GaussianStatistics s = surfel::gaussian_statistics(cloud);
  const std::string amplitude =
      cloud.rule == surfel::AmplitudeRule::kDensity ? "density" : "opacity";
  Json out = {{"file", file},
              {"kind", "gaussians"},
              {"count", s.count},
              {"unusable", cloud.unusable_skipped},
              {"degree", cloud.degree},
              {"amplitude", rule_name(cloud.rule)},
              {"trained_with", trained_with(cloud)},
              {"up", cloud.up ? describe(*cloud.up) : Json(nullptr)},
              {"bounds", describe(s.bounds)},
              {"origin", describe(cloud.origin)}};
  out[amplitude] = describe(s.amplitude);
  out[amplitude + "_histogram"] = describe(s.amplitudes);
  out["scale"] = describe(s.scale);
  out["scale_histogram"] = describe(s.scales);
  out["elongation"] = describe(s.elongation);
  out["flatness"] = describe(s.flatness);
  out["invisible"] = s.invisible;
  out["invisible_share"] = static_cast<double>(s.invisible) / static_cast<double>(s.count);
  out["isolated"] = s.isolated;
  out["veils"] = s.veils;
  for (const surfel::PictureNeed& need : s.needs) {
    out["picture_rows"].push_back(need.rows);
    out["picture_needs"].push_back(need.gaussians);
  }
  if (cloud.coarser_skipped > 0) out["levels"] = levels_of(file);
  out["next"] = surfel::picture_command(file);
  return out;
}

Json describe_volume(const std::string& file) {
  const surfel::Volume volume = surfel::read_volume(file);
  const surfel::VolumeStatistics s = surfel::volume_statistics(volume);
  return {{"file", file},
          {"kind", "volume"},
          {"size", volume.size},
          {"spacing", {volume.step[0].norm(), volume.step[1].norm(), volume.step[2].norm()}},
          {"origin", describe(volume.origin)},
          {"up", volume.up ? describe(*volume.up) : Json(nullptr)},
          {"not_finite", volume.not_finite},
          {"value", describe(s.value)},
          {"value_histogram", describe(s.values)},
          {"next",
           fmt::format("surfel-from-volume {} -o {}", surfel::shell_file(file),
                       surfel::shell_file(std::filesystem::path(file).stem().string() + ".ply"))}};
}

Json describe_file(const std::string& file, const Settings& settings, Tool& tool) {
  const surfel::FileKind kind = surfel::file_kind(file);
  if (kind != surfel::FileKind::kCloud) {
    surfel::tool::require_valid(surfel::tool::without_effect(
        tool.app(), {"--columns", "--level", "--bounds", "--every", "--memory"},
        "on meshes, Gaussians, volumes and images"));
  }
  switch (kind) {
    case surfel::FileKind::kMesh:
      return describe_mesh(file, tool);
    case surfel::FileKind::kImage:
      return describe_image(file);
    case surfel::FileKind::kGaussians:
      return describe_gaussians(file);
    case surfel::FileKind::kVolume:
      return describe_volume(file);
    case surfel::FileKind::kCloud:
      break;
  }
  return describe_cloud(file, settings);
}

/// A value for people: "mean 0.01, min 0.008" for an object, "1 2 3" for numbers.
std::string text(const Json& value) {
  if (value.is_null()) return "-";
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_float()) return fmt::format("{:.7g}", value.get<double>());
  if (!value.is_structured()) return value.dump();
  std::string out;
  for (const auto& [key, item] : value.items()) {
    if (value.is_object()) {
      out += fmt::format("{}{} {}", out.empty() ? "" : ", ", key, text(item));
    } else {
      out += (out.empty() ? "" : item.is_structured() ? "; " : " ") + text(item);
    }
  }
  return out.empty() ? "-" : out;
}

/// "x y z (double), nx ny nz (float)": runs of one type together.
std::string property_list(const Json& properties) {
  std::string out;
  for (std::size_t i = 0; i < properties.size(); ++i) {
    out += text(properties[i]["name"]);
    const bool last = i + 1 == properties.size();
    const bool run_ends = last || properties[i + 1]["type"] != properties[i]["type"];
    out += !run_ends ? " " : fmt::format(" ({}){}", text(properties[i]["type"]), last ? "" : ", ");
  }
  return out;
}

/// What is described, by name, in lines: a name is empty where a line goes on with the one before.
std::vector<std::pair<std::string, std::string>> lines_of(const Json& description) {
  std::vector<std::pair<std::string, std::string>> out;
  const auto line = [&](const std::string& key, const std::string& value) {
    out.emplace_back(key, value);
  };
  for (const auto& [key, value] : description.items()) {
    if (key == "properties") {
      line(key, property_list(value));
    } else if (key == "provenance" || key == "comments") {
      for (const Json& item : value) line(key, text(item));
    } else if (key == "attributes") {
      for (const Json& attribute : value) {
        Json spread = attribute;
        spread.erase("name");
        line("attribute", text(attribute["name"]) + ": " + text(spread));
      }
      if (!value.empty()) {
        line("", fmt::format("surfel-render {} -o picture.png --color-by={}",
                             surfel::shell_file(text(description["file"])),
                             surfel::shell_quoted(text(value.front()["name"]))));
      }
    } else if (key == "needs") {
      if (value.empty()) line(key, "nothing");
      for (const Json& need : value) {
        line("needs " + text(need["topic"]), text(need["measure"]));
        line("", text(need["command"]));
      }
    } else {
      line(key, text(value));
    }
  }
  return out;
}

std::string for_people(const Json& description) {
  std::string out;
  for (const auto& [key, value] : lines_of(description)) {
    out += fmt::format("{:20} {}\n", key, value);
  }
  return out;
}

/// The figures that a page begins with, where the description has them.
std::vector<std::pair<std::string, std::string>> main_figures(const Json& description) {
  std::vector<std::pair<std::string, std::string>> out;
  for (const char* key : {"count", "vertices", "faces", "width", "height", "size", "bounds",
                          "spacing", "radius", "coverage", "scale", "levels", "view"}) {
    const auto found = description.find(key);
    if (found != description.end() && !found->is_null()) out.emplace_back(key, text(*found));
  }
  return out;
}

/// How many others lie within a surfel's radius, which tells whether discs overlap enough.
surfel::InfoChart neighbor_chart(const Json& neighbors, const Json& description) {
  const std::vector<std::size_t> counts = neighbors["none_to_24_and_more"];
  surfel::Histogram histogram;
  for (std::size_t i = 0; i <= counts.size(); ++i) {
    histogram.edges.push_back(static_cast<double>(i));
  }
  histogram.counts = counts;
  const std::size_t samples = neighbors["samples"];
  std::size_t median = 0;
  for (std::size_t below = counts[0]; 2 * below < samples; below += counts[median]) ++median;
  const bool all = samples == description["count"].get<std::size_t>();
  const std::string sample =
      all ? "of all surfels"
          : fmt::format("of {} surfels, spread evenly over {}, each among all", samples,
                        description["count"].get<std::size_t>());
  return {fmt::format("other surfels within the radius at cutoff {:g}",
                      description["cutoff"].get<double>()),
          fmt::format("median {}, none around {}; {}; {} stands for more, too", median, counts[0],
                      sample, surfel::NeighborCounts::kMost),
          surfel::histogram_svg(histogram)};
}

/// Charts of histograms that the description has, and of the values of surfels and pictures.
std::vector<surfel::InfoChart> charts_of(const std::string& file, const Json& description,
                                         const Settings& s) {
  std::vector<surfel::InfoChart> charts;
  for (const auto& [key, value] : description.items()) {
    if (!key.ends_with("_histogram")) continue;
    const surfel::Histogram histogram{value["edges"], value["counts"]};
    charts.push_back({key.substr(0, key.rfind('_')), "", surfel::histogram_svg(histogram)});
  }
  const std::string kind = description["kind"];
  if (kind == "image") {
    const auto more = surfel::image_charts(surfel::read_image(file));
    charts.insert(charts.end(), more.begin(), more.end());
  }
  if (kind != "surfels") return charts;
  const Json& neighbors = description["neighbors"];
  if (!neighbors.is_null()) charts.push_back(neighbor_chart(neighbors, description));
  surfel::CloudReadOptions some = s.part.options();
  const std::uint64_t count = description["count"].get<std::uint64_t>();
  const std::uint64_t every =
      std::max<std::uint64_t>(1, (count + surfel::kChartSurfels - 1) / surfel::kChartSurfels);
  some.every *= every;
  const auto up = description["view"]["up"].get<std::array<double, 3>>();
  const auto more =
      surfel::cloud_charts(surfel::read_cloud(file, some), {up[0], up[1], up[2]},
                           every > 1 ? fmt::format("of one in {} surfels", some.every) : "");
  charts.insert(charts.end(), more.begin(), more.end());
  return charts;
}

/// The page of a file that has been described.
std::string page_of(const Tool& tool, const std::string& file, const Json& description,
                    const Settings& s) {
  surfel::InfoPage page;
  page.file = file;
  page.kind = description["kind"];
  page.figures = main_figures(description);
  Json rest = description;
  if (description.contains("needs")) {
    page.findings.emplace();
    for (const Json& need : description["needs"]) {
      page.findings->push_back({need["topic"], need["measure"], need["command"]});
    }
    rest.erase("needs");
  }
  page.next = description["next"];
  rest.erase("next");
  for (const auto& [key, value] : description.items()) {
    if (key.ends_with("_histogram")) rest.erase(key);
  }
  page.facts = lines_of(rest);
  page.charts = charts_of(file, description, s);
  try {
    surfel::PreviewOptions options;
    options.part = s.part.options();
    options.memory = s.memory;
    page.pictures = surfel::preview_pictures(file, options);
  } catch (const surfel::Error& error) {
    // What cannot be drawn is still described.
    if (error.kind() != surfel::ErrorKind::kInput) throw;
    page.no_pictures = fmt::format("There is no picture: {}", error.what());
  }
  page.command = fmt::format(
      "surfel-info {}{}", surfel::shell_file(file),
      tool.options_given({"threads", "quiet", "verbose", "progress", "stats", "no-clobber"}));
  return surfel::info_page_html(page);
}

}  // namespace

int main(int argc, char** argv) {
  Tool tool(
      "surfel-info",
      "Tells what is in a file of surfels, Gaussians, a mesh, a volume or an image, whether it is "
      "sound, what surfels need, and the command to run next.");
  std::string file;
  bool json = false;
  Settings settings;
  surfel::CloudStatisticsOptions& options = settings.statistics;
  tool.app()
      .add_option("file", file,
                  "Surfels, trained splats, mesh or image (- = surfels from standard input)")
      ->required();
  tool.app().add_flag("--json", json, "Print JSON");
  tool.app().add_option("--html", settings.html,
                        "Page to write: pictures, histograms, what is wrong and what to do, all "
                        "figures; it opens in a browser and needs no network");
  surfel::tool::add_part(tool.app(), settings.part);
  tool.app().add_option("--cutoff", options.cutoff,
                        "Cutoff c at which discs of radius sqrt(2 c variance) should cover, > 0");
  tool.app().add_option("--samples", options.samples,
                        "Surfels whose spacing and coverage are measured, >= 1");
  tool.app().add_option("--seed", options.seed, "Choice of these surfels");
  surfel::tool::add_memory(tool.app(), settings.memory,
                           "Memory for surfels: a larger file, but for PLY and PCD as text, PCD "
                           "compressed and standard input, is read in pieces, several times");
  tool.everyday({"--json", "--html", "--cutoff", "--samples", "--memory"},
                {"surfel-info lion.ply", "surfel-info lion.obj --html lion.html",
                 "surfel-info lion.ply --json"});
  tool.reads_images();
  tool.reads_named_files();
  tool.files().reads({"file"});
  tool.files().writes("--html", surfel::tool::Writes::kPage);
  return tool.run(argc, argv, [&] {
    std::vector<std::string> problems = options.problems();
    surfel::tool::append(problems, settings.part.options().problems());
    if (!settings.html.empty() && file == "-") {
      problems.emplace_back("--html reads the surfels several times; name a file");
    }
    if (settings.html == "-") {
      problems.emplace_back("the figures go to standard output; name a file for --html");
    }
    surfel::tool::require_valid(problems);
    // What cannot be written fails before the work.
    std::optional<surfel::OutputFile> page;
    if (!settings.html.empty()) page.emplace(settings.html, tool.common().no_clobber);
    const Json description = describe_file(file, settings, tool);
    if (page) {
      page->write(page_of(tool, file, description, settings));
      page->commit();
      tool.wrote(settings.html, "a page");
    }
    const auto replace = Json::error_handler_t::replace;
    surfel::tool::print(json ? description.dump(2, ' ', false, replace) + "\n"
                             : for_people(description));
    tool.report()["info"] = surfel::tool::Json::parse(description.dump(-1, ' ', false, replace));
  });
}
