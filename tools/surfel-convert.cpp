// surfel-convert: files of surfels in another format, moved, joined into one, or as trained splats;
// files of trained splats in another format.

#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <numbers>
#include <utility>

#include <fmt/format.h>
#include <surfel/align/align_scans.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/rotation.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_sort.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/gaussian_transform.h>
#include <surfel/scene/gaussians_of_surfels.h>
#include <surfel/scene/join.h>
#include <surfel/scene/keep_columns.h>
#include <surfel/scene/transform.h>
#include <sys/resource.h>

#include "tools/support/gaussians.h"
#include "tools/support/options.h"
#include "tools/support/resume.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::vector<std::string> inputs;
  std::string output;
  bool as_gaussians = false;
  bool ascii = false;
  std::string material;
  bool align = false;
  surfel::AlignOptions alignment;
  surfel::JoinOptions join;
  surfel::tool::PartSettings part;
  double scale = 1;
  std::optional<Eigen::Vector4d> rotation;
  surfel::Vec3d translation{0, 0, 0};
  std::optional<std::array<double, 16>> transform;
  std::string kept_columns;
  std::optional<int> epsg;
  bool sorted = false;  ///< In space-filling order, instead of the files'.
  bool resume = false;  ///< Keep what an interrupted run has made.
  std::optional<std::uint64_t> memory;
};

void declare_options(surfel::tool::CommandLine& app, Settings& s) {
  using namespace surfel::tool;
  app.add_option("surfels", s.inputs,
                 "Surfels or points (PLY, PCD, LAS, LAZ, E57, PTX, text), one file or several (- = "
                 "standard input), or one file of trained splats (PLY, .splat, .spz, .ksplat)")
      ->default_str("")
      ->required();
  app.add_option("-o,--output", s.output,
                 "Surfels to write (PLY, PCD, LAS, LAZ, XYZ, CSV, points of OBJ; - = standard "
                 "output), or Gaussians (.splat, .usda, PLY with --gaussians)")
      ->required();
  app.add_flag("--gaussians", s.as_gaussians,
               "Write surfels as Gaussians in space, as PLY files of trained splats have them, for "
               "viewers of splats; names that end in .splat and .usda say so themselves");
  app.add_flag("--ascii", s.ascii, "Write PLY as text; every value reads back as it was");
  app.add_option("--keep-columns", s.kept_columns,
                 "Columns of the result beside the positions, parted by commas: names of the file "
                 "format such as intensity, or normal, color, size; default: all");

  app.group("Order");
  add_choice(
      app, "--sort", s.sorted, {{"none", false}, {"curve", true}},
      "Order of the surfels: that of the files, one after the other, or along a curve that "
      "fills space, where what is near in space is near in the file: such files (binary PLY) "
      "are read faster, and worked on piece by piece where they are larger than memory");
  add_memory(app, s.memory,
             "Of --sort curve: memory for surfels; what does not fit is sorted on the disk of the "
             "result, and takes as much again there meanwhile");
  surfel::tool::add_resume(app, s.resume);

  add_part(app, s.part);
  app.group("Scans of one surface, before they are joined");
  app.add_flag(
      "--align", s.align,
      "Move every file but the first so that overlapping surfaces lie on one another (ICP, "
      "then a bundle of all poses); the files must be near to their places already");
  app.add_option(
      "--align-reach", s.alignment.reach,
      "How far points may be from their places at first, scene units; 0 = a twentieth of "
      "the largest file's diameter");

  app.group("Materials");
  app.add_option("--material", s.material,
                 "Row of the material table, 0..65535: N for all surfels, or N,N,... for those of "
                 "each file, keep = as they are; default: keep");
  app.add_flag("--separate-materials", s.join.separate_materials,
               "Put the rows of each file after those of the files before it");

  app.group("Place of the result, in this order, about the world's origin");
  app.add_option("--scale", s.scale, "Factor of lengths, 1e-9..1e9");
  add_vector(app, "--rotate", s.rotation, "Axis and angle in degrees, right-handed: X,Y,Z,DEGREES");
  add_vector(app, "--translate", s.translation, "Offset, scene units (of the result): X,Y,Z");
  add_vector(app, "--transform", s.transform,
             "All at once: the 16 numbers of a matrix, row by row, that turns, scales by one "
             "factor and moves column vectors");
  app.add_option(
      "--epsg", s.epsg,
      "Code of the coordinate system that the result is in, 1024..32766; default: as the "
      "files say, where nothing is moved");
  app.group("Options");
}

/// Rows for so many files from "3", "3,4" or "keep,3".
std::vector<int> parse_materials(const std::string& text, std::size_t files) {
  std::vector<int> rows;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    const std::string word = text.substr(begin, end - begin);
    const bool digits =
        !word.empty() && word.size() <= 5 &&
        std::all_of(word.begin(), word.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
    if (!digits && word != "keep") {
      surfel::throw_usage(fmt::format(
          "--material is '{}'; it must be a row in 0..65535, or keep, for all files or, "
          "parted by commas, for each",
          text));
    }
    rows.push_back(digits ? std::stoi(word) : -1);
    begin = end + 1;
  }
  if (rows.size() == 1) rows.resize(files, rows.front());
  return rows;
}

/// The names between the commas.
std::vector<std::string> parse_columns(const std::string& text) {
  std::vector<std::string> names;
  for (std::size_t begin = 0; begin <= text.size() && !text.empty();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    names.push_back(text.substr(begin, end - begin));
    if (names.back().empty()) {
      surfel::throw_usage(fmt::format("--keep-columns is '{}'; it has an empty name", text));
    }
    begin = end + 1;
  }
  return names;
}

/// The similarity that a matrix is.
surfel::Similarity similarity_of(const std::array<double, 16>& rows) {
  using Matrix = Eigen::Matrix<double, 4, 4, Eigen::RowMajor | Eigen::DontAlign>;
  const Matrix matrix(rows.data());
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  const double scale = linear.col(0).norm();
  const Eigen::Matrix3d rotation = linear / scale;
  constexpr double kTolerance = 1e-6;  // Matrices are written with some digits.
  const bool last_row = matrix.row(3) == Eigen::RowVector4d(0, 0, 0, 1);
  const Eigen::Matrix3d error = rotation * rotation.transpose() - Eigen::Matrix3d::Identity();
  if (!last_row || !(linear.determinant() > 0) || !(error.cwiseAbs().maxCoeff() < kTolerance)) {
    surfel::throw_usage(
        "--transform is no rotation with one factor and an offset; its last row must be 0,0,0,1, "
        "and it must not mirror or shear");
  }
  return {.scale = scale,
          .rotation = surfel::Quaternion(rotation).normalized(),
          .translation = matrix.topRightCorner<3, 1>()};
}

surfel::Similarity similarity(const Settings& s) {
  if (s.transform) return similarity_of(*s.transform);
  surfel::Similarity out{.scale = s.scale, .translation = s.translation};
  if (s.rotation) {
    const surfel::Vec3d axis = s.rotation->head<3>();
    const double angle = (*s.rotation)[3] * std::numbers::pi / 180;
    // A vector without a direction stays so, and is refused as a rotation.
    out.rotation = surfel::rotation_about(axis.stableNormalized(), angle);
  }
  return out;
}

bool writes_gaussians(const Settings& s) {
  return s.as_gaussians || surfel::tool::names_gaussians(s.output);
}

void check(const surfel::tool::CommandLine& app, Settings& s) {
  if (!s.material.empty()) s.join.material = parse_materials(s.material, s.inputs.size());
  std::vector<std::string> problems = s.join.problems(s.inputs.size());
  surfel::tool::append(problems, similarity(s).problems());
  surfel::tool::append(problems, s.alignment.problems());
  surfel::tool::append(problems, s.part.options().problems());
  if (s.epsg) {
    surfel::tool::append(problems, surfel::coordinate_system_of_code(*s.epsg).problems());
  }
  if (s.align && s.inputs.size() < 2) {
    problems.emplace_back("--align needs two files or more, of overlapping scans");
  }
  if (!s.align) {
    surfel::tool::append(problems,
                         surfel::tool::without_effect(app, {"--align-reach"}, "without --align"));
  }
  if (s.transform) {
    surfel::tool::append(problems,
                         surfel::tool::without_effect(app, {"--scale", "--rotate", "--translate"},
                                                      "beside --transform"));
  }
  if (!s.sorted) {
    surfel::tool::append(problems, surfel::tool::without_effect(app, {"--memory", "--resume"},
                                                                "without --sort curve"));
  } else {
    surfel::tool::append(
        problems, surfel::tool::without_effect(app, {"--ascii", "--align"}, "beside --sort curve"));
  }
  if (std::count(s.inputs.begin(), s.inputs.end(), "-") > 1) {
    problems.emplace_back("standard input can be read once only; name files for the others");
  }
  const std::string extension = surfel::tool::lower_extension(s.output);
  if (s.ascii && !extension.empty() && extension != ".ply") {
    problems.emplace_back("--ascii has no effect on formats other than PLY; leave it out");
  }
  if (s.as_gaussians && !extension.empty() && extension != ".ply" &&
      !surfel::tool::names_gaussians(s.output)) {
    problems.push_back(s.output + ": Gaussians are written as PLY, .splat or .usda");
  }
  if (s.sorted && !extension.empty() && extension != ".ply" && !writes_gaussians(s)) {
    problems.push_back(s.output + ": --sort curve writes PLY alone; give a .ply");
  }
  if (writes_gaussians(s)) {
    surfel::tool::append(
        problems,
        surfel::tool::without_effect(
            app, {"--ascii", "--keep-columns", "--epsg", "--sort", "--memory", "--resume"},
            "on Gaussians, which have columns of their own"));
  }
  surfel::tool::require_valid(problems);
}

surfel::tool::Json fit_json(const std::string& file, const surfel::ScanFit& fit) {
  const surfel::Quaternion& q = fit.pose.rotation;
  const surfel::Vec3d& t = fit.pose.translation;
  return {{"file", file},
          {"rotation", {q.w(), q.x(), q.y(), q.z()}},
          {"translation", {t.x(), t.y(), t.z()}},
          {"points", fit.points},
          {"matched", fit.matched},
          {"rms", fit.rms},
          {"moved", fit.moved}};
}

/// Moves all scans but the first onto one another.
void align(surfel::tool::Tool& tool, const Settings& s, std::vector<surfel::SurfelCloud>& clouds) {
  const surfel::AlignReport r = surfel::align_scans(clouds, s.alignment, s.inputs);
  surfel::tool::Json& json = tool.report()["align"];
  json = {{"reach", r.reach},
          {"rms", r.rms},
          {"matches", r.matches},
          {"rounds", r.rounds},
          {"converged", r.converged}};
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    const surfel::ScanFit& fit = r.scans[k];
    json["scans"].push_back(fit_json(s.inputs[k], fit));
    const double degrees = surfel::rotation_angle(fit.pose.rotation) * 180 / std::numbers::pi;
    tool.note(fmt::format(
        "{}: {}; {} of {} points lie on other scans, {:.3g} from them (RMS)", s.inputs[k],
        k == 0
            ? "stays"
            : fmt::format("turned by {:.3g} degrees, moved by {:.3g} at most", degrees, fit.moved),
        fit.matched, fit.points, fit.rms));
    surfel::transform_cloud(clouds[k], fit.pose);
  }
  if (!r.converged) {
    tool.note(fmt::format("--align: poses still changed after {} rounds", r.rounds));
  }
  surfel::tool::add_stages(json, r.times);
}

/// Tells what joining made up or left out.
void tell(surfel::tool::Tool& tool, const Settings& s, const surfel::JoinReport& r) {
  for (std::size_t k = 0; k < s.inputs.size(); ++k) {
    std::string columns;
    for (const auto& [cloud, column] : r.filled) {
      if (cloud == k) columns += (columns.empty() ? "" : ", ") + column;
    }
    if (columns.empty()) continue;
    tool.note(fmt::format("{}: has no {}; filled in", s.inputs[k], columns));
  }
  if (!r.dropped.empty()) {
    tool.note(fmt::format("{}: left out, as not all files have them: {}", s.output,
                          fmt::join(r.dropped, ", ")));
  }
  if (r.basis_differs) {
    tool.note(
        fmt::format("{}: the files' coefficients were fitted for different cutoffs", s.output));
  }
  if (r.viewpoints_dropped) {
    tool.note(fmt::format(
        "{}: has no viewpoints, as not all files tell where their scans were taken from",
        s.output));
  }
  surfel::tool::Json& report = tool.report();
  for (const auto& [k, column] : r.filled) {
    report["filled"].push_back({{"file", s.inputs[k]}, {"column", column}});
  }
  report["dropped"] = r.dropped;
}

/// What is done to a cloud, or to each piece of it, before it is written.
class Changes {
 public:
  explicit Changes(const Settings& s)
      : file_(s.inputs.front()), moves_(similarity(s)), columns_(parse_columns(s.kept_columns)) {
    if (s.epsg) system_ = surfel::coordinate_system_of_code(*s.epsg);
  }

  void apply(surfel::SurfelCloud& cloud) const {
    surfel::transform_cloud(cloud, moves_);
    if (system_) surfel::set_coordinate_system(cloud, system_);
    if (!columns_.empty()) surfel::keep_columns(cloud, columns_, file_);
  }

 private:
  const std::string& file_;
  surfel::Similarity moves_;
  std::vector<std::string> columns_;
  std::optional<surfel::CoordinateSystem> system_;
};

/// Lets the process keep so many files open, where the system's hard limit allows it.
void allow_open_files(std::size_t files) {
  constexpr rlim_t kOthers = 64;  // Standard streams, the result, libraries.
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= files + kOthers) return;
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, files + kOthers);
  setrlimit(RLIMIT_NOFILE, &limit);
}

/// Reports the number of surfels that were written; returns what the file holds.
std::string counted_surfels(surfel::tool::Tool& tool, std::size_t surfels) {
  tool.report()["surfels"] = surfels;
  return fmt::format("{} surfels", surfels);
}

/// Begins to sort surfels, and says what disk that takes.
void begin_sort(surfel::tool::Tool& tool, const Settings& s, const surfel::CloudSurvey& survey,
                const surfel::PositionSample& sample, const surfel::SurfelCloud& first,
                std::optional<surfel::SortedCloudWriter>& sorter) {
  sorter.emplace(
      s.output, survey, sample, first,
      surfel::CloudSortOptions{.memory = surfel::memory_to_use(s.memory),
                               .no_clobber = tool.common().no_clobber,
                               .job = surfel::tool::job(tool, s.resume, s.inputs, s.output)});
  surfel::tool::tell_resumed(tool, s.output, sorter->kept(), survey.count);
  const std::uint64_t bytes = sorter->scratch_bytes();
  tool.report()["scratch_bytes"] = bytes;
  if (bytes == 0) return;
  tool.note(
      fmt::format("{}: {} surfels do not fit into memory; sorting takes {:.3g} GB beside it "
                  "until it is done",
                  s.output, survey.count, static_cast<double>(bytes) / 1e9));
}

/// Files that are read piece by piece, as often as it takes, joined and changed.
class JoinedFiles {
 public:
  explicit JoinedFiles(const Settings& s) : settings_(s), changes_(s) {
    allow_open_files(s.inputs.size());
    for (const std::string& input : s.inputs) {
      readers_.push_back(std::make_unique<surfel::CloudReader>(input, s.part.options()));
      heads_.push_back(readers_.back()->first());
    }
  }

  /// Hands on the pieces of all files as they are, and joined and changed:
  /// visit(file, piece, changed), where changed() makes the latter.
  template <class Visit>
  surfel::JoinReport for_each(const Visit& visit) {
    surfel::CloudJoiner joiner(heads_, settings_.join, settings_.inputs);
    for (std::size_t k = 0; k < readers_.size(); ++k) {
      readers_[k]->for_each([&](surfel::SurfelCloud piece) {
        const auto changed = [&] {
          surfel::SurfelCloud out = joiner.joined(k, std::move(piece));
          changes_.apply(out);
          return out;
        };
        visit(k, piece, changed);
      });
    }
    return joiner.report();
  }

  /// The first pass: visit(changed piece) for all, and what there is to tell of the files.
  template <class Visit>
  void survey(surfel::tool::Tool& tool, const Visit& visit) {
    const Settings& s = settings_;
    std::vector<surfel::tool::NotFinite> not_finite(readers_.size());
    std::vector<std::uint64_t> counts(readers_.size());
    const surfel::JoinReport joined =
        for_each([&](std::size_t k, const surfel::SurfelCloud& piece, const auto& changed) {
          if (counts[k] == 0) surfel::tool::tell_skipped(tool, s.inputs[k], piece);
          counts[k] += piece.size();
          not_finite[k].add(piece);
          // How many bits the colours of a LAS file have is known once it was read.
          heads_[k] = surfel::CloudJoiner::head(piece);
          visit(changed());
        });
    for (std::size_t k = 0; k < readers_.size(); ++k) {
      surfel::tool::tell_not_finite(tool, s.inputs[k], not_finite[k]);
      tool.report()["inputs"].push_back({{"file", s.inputs[k]}, {"surfels", counts[k]}});
    }
    tell(tool, s, joined);
  }

 private:
  const Settings& settings_;
  Changes changes_;
  std::vector<std::unique_ptr<surfel::CloudReader>> readers_;
  std::vector<surfel::SurfelCloud> heads_;
};

/// Converts and joins files piece by piece: they are read twice, first to know how many surfels
/// there will be and which types hold their values.
std::string convert_pieces(surfel::tool::Tool& tool, const Settings& s) {
  const surfel::Timer timer;
  JoinedFiles files(s);
  surfel::CloudSurvey survey(s.output);
  surfel::PositionSample sample;
  files.survey(tool, [&](const surfel::SurfelCloud& piece) {
    survey.add(piece);
    if (s.sorted) sample.add(piece);
  });
  tool.report()["survey_ms"] = timer.milliseconds();

  std::optional<surfel::CloudWriter> writer;
  std::optional<surfel::SortedCloudWriter> sorter;
  files.for_each([&](std::size_t, const surfel::SurfelCloud&, const auto& changed) {
    surfel::SurfelCloud out = changed();
    survey.settle(out);
    out.provenance.push_back(tool.provenance());
    if (!writer && !sorter) {
      surfel::tool::tell_lost_columns(tool, out, s.output);
      if (s.sorted) {
        begin_sort(tool, s, survey, sample, out, sorter);
      } else {
        writer.emplace(
            s.output, survey,
            surfel::CloudWriteOptions{.no_clobber = tool.common().no_clobber, .ascii = s.ascii});
      }
    }
    if (writer) writer->append(out);
    if (sorter) sorter->append(out);
  });
  if (writer) surfel::tool::tell_changed_columns(tool, s.output, writer->commit());
  if (sorter) sorter->commit();
  return counted_surfels(tool, survey.count);
}

/// All files in memory, moved onto one another where that is asked for, joined and changed.
surfel::SurfelCloud joined_in_memory(surfel::tool::Tool& tool, const Settings& s) {
  surfel::tool::Json& report = tool.report();
  const surfel::Timer timer;
  std::vector<surfel::SurfelCloud> clouds;
  for (const std::string& input : s.inputs) {
    clouds.push_back(surfel::read_cloud(input, s.part.options()));
    surfel::tool::tell_skipped(tool, input, clouds.back());
    surfel::tool::NotFinite not_finite;
    not_finite.add(clouds.back());
    surfel::tool::tell_not_finite(tool, input, not_finite);
    report["inputs"].push_back({{"file", input}, {"surfels", clouds.back().size()}});
  }
  report["load_ms"] = timer.milliseconds();

  if (s.align) align(tool, s, clouds);
  surfel::JoinReport joined;
  surfel::SurfelCloud cloud = surfel::join_clouds(std::move(clouds), s.join, s.inputs, &joined);
  tell(tool, s, joined);

  Changes(s).apply(cloud);
  return cloud;
}

std::string convert_aligned(surfel::tool::Tool& tool, const Settings& s) {
  surfel::SurfelCloud cloud = joined_in_memory(tool, s);
  surfel::tool::write_result(tool, cloud, s.output, s.ascii);
  return counted_surfels(tool, cloud.size());
}

/// Writes Gaussians; returns what the file holds.
std::string write_gaussians(surfel::tool::Tool& tool, const surfel::GaussianCloud& cloud,
                            const Settings& s) {
  surfel::tool::write_result(tool, cloud, s.output);
  return fmt::format("{} Gaussians", cloud.size());
}

/// Writes surfels as Gaussians in space.
std::string convert_to_gaussians(surfel::tool::Tool& tool, const Settings& s) {
  const surfel::SurfelCloud cloud = joined_in_memory(tool, s);
  surfel::GaussiansOfSurfelsOptions options;
  const surfel::CloudStatistics measured = surfel::cloud_statistics(cloud);
  if (measured.coverage && measured.coverage->overlap > 0) {
    options.overlap = measured.coverage->overlap;
  }
  // A stage has flat kernels; other formats store the thickness' logarithm.
  if (surfel::tool::lower_extension(s.output) == ".usda") options.thickness = 0;
  surfel::GaussiansOfSurfelsReport r;
  const surfel::GaussianCloud gaussians =
      surfel::gaussians_of_surfels(cloud, s.inputs.front(), options, &r);
  surfel::tool::tell_left_out(tool, s.inputs.front(), r.left_out);
  if (r.clipped + r.mirrored > 0) {
    tool.note(
        fmt::format("{}: {} surfels that end at lines are whole Gaussians now, {} that lie "
                    "beyond their lines are left out",
                    s.output, r.clipped, r.mirrored));
  }
  tool.report()["overlap"] = options.overlap;
  tool.report()["opacity"] = r.opacity;
  return write_gaussians(tool, gaussians, s);
}

/// Converts, joins and moves files of trained splats.
std::string convert_gaussians(surfel::tool::Tool& tool, const Settings& s) {
  surfel::tool::require_valid(surfel::tool::without_effect(
      tool.app(),
      {"--ascii", "--keep-columns", "--columns", "--level", "--bounds", "--every", "--material",
       "--separate-materials", "--epsg", "--align"},
      "on Gaussians in space"));
  surfel::tool::require_gaussian_name(s.output, s.inputs.front());
  surfel::GaussianCloud cloud = surfel::tool::load_gaussians(tool, s.inputs);
  surfel::transform_gaussians(cloud, similarity(s));
  return write_gaussians(tool, cloud, s);
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool(
      "surfel-convert",
      "Converts files of surfels or of trained splats, moves them, joins several "
      "into one, and makes splats of surfels.");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday({"--output", "--gaussians", "--ascii", "--sort", "--align", "--material", "--scale",
                 "--rotate", "--translate"},
                {"surfel-convert lion.ply -o lion.splat",
                 "surfel-convert city.laz --sort curve -o sorted.ply",
                 "surfel-convert front.ply back.ply --align -o whole.ply"});
  tool.files().reads({"surfels"});
  tool.files().writes("--output", surfel::tool::Writes::kSurfelsOrGaussians);
  tool.name_fields({{"reach", "--align-reach"}, {"rotation", "--rotate"}});
  return tool.run(argc, argv, [&] {
    check(tool.app(), s);
    const auto holds_gaussians = [](const std::string& file) {
      return surfel::holds_gaussians(file);
    };
    const bool splats = std::any_of(s.inputs.begin(), s.inputs.end(), holds_gaussians);
    const auto convert = splats                ? convert_gaussians
                         : writes_gaussians(s) ? convert_to_gaussians
                         : s.align             ? convert_aligned
                                               : convert_pieces;
    tool.wrote(s.output, convert(tool, s));
  });
}
