#include "tools/texture/blocks.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/progress.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/texture/fit_blocks.h>
#include <surfel/texture/normal_fit.h>
#include <surfel/texture/surface_lookup.h>

#include "tools/support/block_writer.h"
#include "tools/support/resume.h"
#include "tools/support/surfels.h"
#include "tools/texture/messages.h"
#include "tools/texture/sources.h"

namespace surfel::texture_tool {
namespace {

/// Sums of what normals of some blocks are like.
struct NormalSums {
  std::uint64_t mapped = 0, unmapped = 0, without_frame = 0;
  double tilt = 0, variance = 0;

  void add(const NormalSums& more) {
    mapped += more.mapped;
    unmapped += more.unmapped;
    without_frame += more.without_frame;
    tilt += more.tilt;
    variance += more.variance;
  }
};

/// Gives fitted surfels what comes after the fit, and writes them.
class FinishedSurfels final : public SurfelSink, public Checkpoints {
 public:
  FinishedSurfels(const Settings& s, tool::BlockWriter& writer, std::optional<NormalMaps>& normals,
                  bool colors, bool relief)
      : s_(s), writer_(writer), normals_(normals), colors_(colors), relief_(relief) {}

  void begin(const SurfelCloud& like, std::size_t count) override {
    SurfelCloud one = like;
    finish(one);
    sums_ = {};
    writer_.begin(one, count);
  }
  void put(SurfelCloud surfels, std::size_t at) override {
    last_ = finish(surfels);
    sums_.add(last_);
    writer_.put(std::move(surfels), at);
  }

  // Beside the state of a part are its sums.
  std::optional<std::string> finished(std::uint64_t part) override {
    std::optional<std::string> state = writer_.checkpoints()->finished(part);
    if (!state || state->size() < sizeof(NormalSums)) return std::nullopt;
    NormalSums sums;
    std::memcpy(&sums, state->data() + state->size() - sizeof(sums), sizeof(sums));
    sums_.add(sums);
    state->resize(state->size() - sizeof(sums));
    return state;
  }
  void finish(std::uint64_t part, std::span<const RowSpan> rows,
              const std::string& state) override {
    const NormalSums sums = rows.empty() ? NormalSums{} : last_;
    std::string with_sums = state;
    with_sums.append(reinterpret_cast<const char*>(&sums), sizeof(sums));
    writer_.checkpoints()->finish(part, rows, with_sums);
  }
  Checkpoints* checkpoints() { return writer_.checkpoints() ? this : nullptr; }

  NormalFitReport normals() const {
    NormalFitReport r;
    r.mapped = sums_.mapped;
    r.unmapped = sums_.unmapped;
    r.without_frame = sums_.without_frame;
    r.times = times_;
    if (r.mapped > 0) {
      r.mean_tilt = sums_.tilt / static_cast<double>(r.mapped);
      r.mean_variance = sums_.variance / static_cast<double>(r.mapped);
    }
    return r;
  }

 private:
  NormalSums finish(SurfelCloud& surfels) {
    if (colors_ && s_.from != From::kColors) show_coefficients(surfels);
    NormalSums sums;
    if (normals_) {
      const NormalFitReport r = fit_normals(surfels, *normals_, s_.fit, s_.input);
      const auto mapped = static_cast<double>(r.mapped);
      sums = {r.mapped, r.unmapped, r.without_frame, r.mean_tilt * mapped,
              r.mean_variance * mapped};
      for (const auto& [stage, milliseconds] : r.times.stages()) times_.add(stage, milliseconds);
    }
    // The surfels of other blocks have some.
    if (relief_) surfels.shading_normal.resize(surfels.size(), Vec3f(0, 0, 0));
    return sums;
  }

  const Settings& s_;
  tool::BlockWriter& writer_;
  std::optional<NormalMaps>& normals_;
  bool colors_;
  bool relief_;
  NormalSums last_;  ///< Of the surfels that came last.
  NormalSums sums_;
  StageTimes times_;
};

/// Textures surfels that stay in their file, a block after the other.
class BlockTexturing {
 public:
  /// \param piece  Surfels that are read at a time where each is worked on alone.
  BlockTexturing(tool::Tool& tool, Settings& s, const CloudRanges& ranges, std::size_t piece)
      : tool_(tool),
        s_(s),
        ranges_(ranges),
        piece_(piece),
        first_(ranges.read(0, 1)),
        survey_(s.output) {}

  void run() {
    tool::require_piecewise_format(s_.output, s_.input);
    tool::tell_finest(tool_, s_.input, first_, ranges_.size());
    mesh_ = load_mesh(s_, tool_);
    const TriangleMesh* const surface = mesh_ ? &*mesh_ : nullptr;
    if (mesh_) check_mesh_of_file();
    normals_ = load_normals(tool_.app(), s_, surface);
    colors_ = fits_colors(s_, surface);
    if (!colors_) {
      refuse_fits(tool_.app());
    } else if (!s_.solid_name.empty()) {
      solid_ = make_solid(s_, ranges_.bounds(), tool_);
    } else if (s_.from != From::kColors) {
      textures_ = load_textures(s_, surface);
    }
    look();
    fit();
  }

 private:
  bool solves() const { return colors_ && s_.fit.kind != TextureFitKind::kEwa; }
  FitSource source() {
    return {.textures = textures_ ? &*textures_ : nullptr,
            .solid = solid_ ? &*solid_ : nullptr,
            .mesh = mesh_ ? &*mesh_ : nullptr};
  }

  SurfelCloud read(std::size_t begin, std::size_t end, SurfaceLookupReport* found = nullptr) const {
    SurfelCloud surfels = ranges_.read(begin, end);
    if (mesh_ && surfels.uv.empty()) {
      const SurfaceLookupReport r = locate_on_mesh(surfels, *mesh_, s_.mesh);
      if (found) *found = r;
    }
    return surfels;
  }

  /// Calls visit(begin, end) for the pieces.
  template <class Visit>
  void for_pieces(const char* what, const Visit& visit) const {
    ProgressStage stage(what, ranges_.size(), "surfels");
    for (std::size_t begin = 0; begin < ranges_.size(); begin += piece_) {
      const std::size_t end = std::min(begin + piece_, ranges_.size());
      visit(begin, end);
      stage.add(end - begin);
    }
  }

  void check_mesh_of_file() {
    const std::size_t count = std::min(kMeshSample, ranges_.size());
    SurfelCloud sample = cloud_of_rows(first_, count);
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t i = k * ranges_.size() / count;
      copy_rows(ranges_.read(i, i + 1), 0, 1, sample, k);
    }
    const auto all = [&] {
      MeshProximity sum;
      sum.least_distance = std::numeric_limits<double>::infinity();
      for_pieces("measuring distances", [&](std::size_t begin, std::size_t end) {
        const SurfelCloud block = ranges_.read(begin, end);
        const MeshProximity part = mesh_proximity(block, *mesh_, block.size());
        sum.near += part.near;
        sum.far += part.far;
        if (part.near + part.far > 0) {
          sum.least_distance = std::min(sum.least_distance, part.least_distance);
        }
      });
      return sum;
    };
    check_mesh(sample, ranges_.size(), *mesh_, all, s_, tool_);
  }

  /// What has to be known of all surfels before the first is written.
  void look() {
    SurfaceLookupReport located;
    double distance = 0;
    for_pieces("looking at surfels", [&](std::size_t begin, std::size_t end) {
      SurfaceLookupReport found;
      SurfelCloud block = read(begin, end, &found);
      survey_.add(block);
      located.located += found.located;
      located.too_far += found.too_far;
      located.turned_away += found.turned_away;
      distance += found.mean_distance * static_cast<double>(found.located);
      if (textures_ && !solves()) request_kernels(block, *textures_, s_.fit, s_.input, begin);
      if (normals_ && !relief_) {
        relief_ = fit_normals(block, *normals_, s_.fit, s_.input).mapped > 0;
      }
    });
    if (textures_ && !solves()) load_requested(*textures_);
    if (mesh_ && first_.uv.empty()) {
      if (located.located > 0) {
        located.mean_distance = distance / static_cast<double>(located.located);
      }
      tell_located(located, ranges_.size(), s_, tool_);
    }
  }

  void fit() {
    tool::BlockWriter writer(
        tool_, s_.output,
        {.job = tool::job(tool_, s_.resume, inputs(), s_.output), .survey = survey_});
    FinishedSurfels finished(s_, writer, normals_, colors_, relief_);
    const TextureFitReport fitted = solves() ? fit_systems(finished) : fit_alone(finished);
    if (colors_) tell_fit(fitted, !first_.area.empty(), s_, tool_);
    if (normals_) tell_normals(finished.normals(), ranges_.size(), s_, tool_);
    writer.commit();
    tool_.wrote(s_.output, fmt::format("{} surfels", ranges_.size()));
  }

  /// The files that the result is made of.
  std::vector<std::string> inputs() const {
    std::vector<std::string> files{s_.input};
    const auto add = [&](const std::string& file) {
      if (!file.empty() && !is_procedural_image(file)) files.push_back(file);
    };
    add(s_.mesh);
    add(s_.source.image);
    add(s_.normals.maps.normal_map);
    add(s_.normals.maps.bump);
    if (mesh_ && s_.source.image.empty()) {
      const std::vector<std::string> images = image_files(*mesh_);
      files.insert(files.end(), images.begin(), images.end());
    }
    return files;
  }

  TextureFitReport fit_systems(FinishedSurfels& to) {
    TextureFitReport report;
    if (!fit_by_blocks(ranges_, source(), s_.fit, to, &report, s_.input,
                       {.checkpoints = to.checkpoints()})) {
      throw_input(s_.input, "is not in space-filling order, as fits of it in blocks need it; " +
                                range_advice(s_.input));
    }
    return report;
  }

  /// Fits what depends on no other surfel.
  TextureFitReport fit_alone(FinishedSurfels& to) {
    TextureFitReport report;
    SurfelCloud one = read(0, 1);
    if (colors_) fit_coefficients(one, source(), s_.fit, s_.input);
    to.begin(one, ranges_.size());
    Checkpoints* const checkpoints = to.checkpoints();
    for_pieces("fitting", [&](std::size_t begin, std::size_t end) {
      if (checkpoints) {
        const std::optional<std::string> state = checkpoints->finished(begin);
        std::optional<TextureFitReport> kept;
        if (state) kept = kept_report(*state);
        if (kept) return report.add(*kept);
      }
      SurfelCloud block = read(begin, end);
      TextureFitReport fitted;
      if (colors_) fitted = fit_coefficients(block, source(), s_.fit, s_.input);
      report.add(fitted);
      to.put(std::move(block), begin);
      const RowSpan rows{begin, end};
      if (checkpoints) checkpoints->finish(begin, {&rows, 1}, state_of(fitted));
    });
    return report;
  }

  tool::Tool& tool_;
  Settings& s_;
  const CloudRanges& ranges_;
  std::size_t piece_;
  SurfelCloud first_;
  CloudSurvey survey_;
  std::optional<TriangleMesh> mesh_;
  std::optional<NormalMaps> normals_;
  std::optional<SolidTexture> solid_;
  std::optional<TextureSet> textures_;
  bool colors_ = false;  ///< Colours are fitted, and not normals alone.
  bool relief_ = false;  ///< Some surfel gets a normal.
};

/// Bytes that surfels take for each that is read at a time.
constexpr std::size_t kFilter = 120;  // What they get, and what is noted of each.

[[noreturn]] void refuse_larger(const Settings& s, std::size_t surfels, std::uint64_t bytes,
                                std::uint64_t memory) {
  const std::vector<std::string> problems = fit_block_problems(s.fit);
  throw_input(
      tool::shown_name(s.input),
      fmt::format("a system of equations for its {} surfels takes {} MB in memory or more, of "
                  "which {} MB are allowed (--memory){}; --fit ewa needs no system, and fits any "
                  "number of surfels",
                  surfels, (bytes >> 20) + 1, memory >> 20,
                  problems.empty() ? "" : fmt::format(", and {}", fmt::join(problems, ", "))));
}

/// Bytes that surfels take where each is worked on alone, or all at once ...
std::uint64_t at_once(std::size_t surfels, const SurfelCloud& first, const Settings& s) {
  const std::size_t row = row_bytes(first);
  return s.fit.kind == TextureFitKind::kEwa ? std::uint64_t{surfels} * (row + kFilter)
                                            : fit_bytes(surfels, row);
}
/// ... and block by block in memory.
std::uint64_t by_blocks(std::size_t surfels, const SurfelCloud& first) {
  constexpr std::size_t kOrder = 2 * sizeof(std::uint32_t) + 2 * sizeof(std::uint64_t);
  const std::size_t row = row_bytes(first);
  return std::uint64_t{surfels} * (row + kFilter + kOrder) + fit_block_bytes(surfels, row);
}

}  // namespace

std::uint64_t least_bytes(std::size_t surfels, const SurfelCloud& first, const Settings& s) {
  const std::uint64_t all = at_once(surfels, first, s);
  const bool divides = fitted_by_blocks(std::numeric_limits<std::size_t>::max(), s.fit);
  return divides ? std::min(all, by_blocks(surfels, first)) : all;
}

std::optional<bool> texture_in_blocks(tool::Tool& tool, Settings& s, std::uint64_t memory) {
  tool::check_resume(s.resume, s.output);
  if (!s.resume && !tool::may_not_fit(s.input, memory)) return false;
  const auto ranges = s.input == "-" ? nullptr : CloudRanges::open(s.input);
  if (!ranges && s.resume) tool::refuse_resume(s.input);
  if (!ranges) return std::nullopt;
  if (ranges->size() == 0) return false;
  const SurfelCloud first = ranges->read(0, 1);
  const bool solves = s.fit.kind != TextureFitKind::kEwa;
  const bool blocks = fitted_by_blocks(ranges->size(), s.fit);
  const std::uint64_t bytes =
      blocks ? by_blocks(ranges->size(), first) : at_once(ranges->size(), first, s);
  const bool keeps = s.resume && (blocks || !solves);
  if (bytes <= memory && !keeps) return false;
  const std::size_t row = row_bytes(first);
  const std::uint64_t least = blocks ? fit_block_bytes(ranges->size(), row) : bytes;
  if (solves && least > memory) refuse_larger(s, ranges->size(), least, memory);
  constexpr std::uint64_t kLeast = 1 << 12;
  constexpr std::uint64_t kMost = 1 << 20;
  // What is kept must not depend on the memory of the run that kept it.
  constexpr std::uint64_t kKept = 1 << 12;
  const std::uint64_t piece = std::clamp(memory / 2 / (2 * (row + kFilter)), kLeast, kMost);
  BlockTexturing(tool, s, *ranges, static_cast<std::size_t>(s.resume && !solves ? kKept : piece))
      .run();
  return true;
}

}  // namespace surfel::texture_tool
