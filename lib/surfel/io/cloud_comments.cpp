#include <algorithm>
#include <array>
#include <span>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/version.h>
#include <surfel/io/cloud_comments.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::string_view kVersionComment = "surfel ";
constexpr std::string_view kBasisComment = "surfel_basis ";
constexpr std::string_view kProvenanceComment = "surfel_provenance ";
constexpr std::string_view kViewpointComment = "surfel_viewpoint ";
constexpr std::string_view kScanViewpointComment = "surfel_scan_viewpoint ";
constexpr std::string_view kUpComment = "surfel_up ";
constexpr std::string_view kColorComment = "surfel_color ";
constexpr std::string_view kLasComment = "surfel_las ";
constexpr std::array<std::pair<std::string_view, ColorLight>, 3> kColorLights{
    {{"recorded", ColorLight::kRecorded},
     {"reflectance", ColorLight::kReflectance},
     {"mixed", ColorLight::kMixed}}};

/// Blank-separated numbers, exactly as many as `values` has; false if they are not there.
bool parse_numbers(std::string_view text, std::span<double> values) {
  TextScanner words({}, text);
  for (double& value : values) {
    const auto number = parse_number(words.word());
    if (!number) return false;
    value = *number;
  }
  return words.at_line_end();
}

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  return text;
}

/// How a LAS file stored the points, for a later LAS file.
std::string las_comment(const LasStorage& las) {
  return fmt::format("{}{} {} {} {}", kLasComment, fmt::join(las.scale, " "),
                     fmt::join(las.offset, " "), las.point_format, las.global_encoding);
}

LasStorage parse_las_comment(std::string_view text, const std::string& file) {
  double numbers[8];
  const bool all = parse_numbers(text.substr(kLasComment.size()), numbers);
  const Vec3d scale(numbers);
  const Vec3d offset(numbers + 3);
  if (!all || !scale.allFinite() || (scale.array() == 0).any() || !offset.allFinite() ||
      !representable<std::uint8_t>(numbers[6]) || numbers[6] > 10 ||
      !representable<std::uint16_t>(numbers[7])) {
    throw_input(file, "the header comment " + quoted_excerpt(text) +
                          " has not a scale, an offset, a point format and an encoding");
  }
  return {.scale = scale,
          .offset = offset,
          .point_format = static_cast<int>(numbers[6]),
          .global_encoding = static_cast<std::uint16_t>(numbers[7]),
          .records = {}};
}

/// \param name  The words of the comment before its numbers.
Viewpoint parse_viewpoint(std::string_view text, std::string_view name, const std::string& file) {
  double view[7];
  if (!parse_numbers(text.substr(name.size()), view)) {
    throw_input(file, "the header comment " + quoted_excerpt(text) + " has not seven numbers");
  }
  return {Vec3d(view), Eigen::Vector4d(view + 3)};
}

}  // namespace

std::vector<std::string> write_comments(const SurfelCloud& cloud, bool pcd) {
  const bool with_viewpoint = !pcd || (cloud.viewpoint && is_default(*cloud.viewpoint));
  std::vector<std::string> lines{std::string(kVersionComment) + version()};
  if (cloud.basis_cutoff) lines.push_back(fmt::format("{}{}", kBasisComment, *cloud.basis_cutoff));
  const auto add_view = [&](std::string_view name, const Viewpoint& view) {
    lines.push_back(fmt::format("{}{} {}", name, fmt::join(view.position, " "),
                                fmt::join(view.orientation, " ")));
  };
  if (with_viewpoint && cloud.viewpoint) add_view(kViewpointComment, *cloud.viewpoint);
  for (const Viewpoint& view : cloud.scan_viewpoints) add_view(kScanViewpointComment, view);
  if (cloud.up) {
    lines.push_back(fmt::format("{}{}", kUpComment, fmt::join(*cloud.up, " ")));
  }
  for (const auto& [name, light] : kColorLights) {
    if (cloud.color_light == light) lines.push_back(fmt::format("{}{}", kColorComment, name));
  }
  for (const std::string& line : cloud.provenance) {
    lines.push_back(std::string(kProvenanceComment) + one_line(line));
  }
  for (const std::string& line : cloud.comments) lines.push_back(one_line(line));
  return lines;
}

std::vector<std::string> file_comments(const SurfelCloud& cloud, bool pcd) {
  std::vector<std::string> comments = write_comments(cloud, pcd);
  if (cloud.las) comments.push_back(las_comment(*cloud.las));
  return comments;
}

void read_comments(const std::vector<std::string>& comments, const std::string& file,
                   SurfelCloud& cloud) {
  for (const std::string& comment : comments) {
    const std::string_view text = comment;
    if (text.starts_with(kProvenanceComment)) {
      cloud.provenance.emplace_back(text.substr(kProvenanceComment.size()));
    } else if (text.starts_with(kBasisComment)) {
      double cutoff = 0;
      if (!parse_numbers(text.substr(kBasisComment.size()), {&cutoff, 1}) || !(cutoff > 0)) {
        throw_input(file, "the header comment " + quoted_excerpt(text) + " has no cutoff > 0");
      }
      cloud.basis_cutoff = cutoff;
    } else if (text.starts_with(kViewpointComment)) {
      cloud.viewpoint = parse_viewpoint(text, kViewpointComment, file);
    } else if (text.starts_with(kScanViewpointComment)) {
      cloud.scan_viewpoints.push_back(parse_viewpoint(text, kScanViewpointComment, file));
    } else if (text.starts_with(kUpComment)) {
      double up[3];
      const bool numbers = parse_numbers(text.substr(kUpComment.size()), up);
      if (!numbers || !Vec3d(up).allFinite() || !(Vec3d(up).norm() > 0)) {
        throw_input(file, "the header comment " + quoted_excerpt(text) + " has no direction");
      }
      cloud.up = Vec3d(up).normalized();
    } else if (text.starts_with(kLasComment)) {
      cloud.las = parse_las_comment(text, file);
    } else if (text.starts_with(kColorComment)) {
      const std::string_view said = text.substr(kColorComment.size());
      const auto* const known =
          std::find_if(kColorLights.begin(), kColorLights.end(),
                       [&](const auto& light) { return light.first == said; });
      if (known == kColorLights.end()) {
        throw_input(file, "the header comment " + quoted_excerpt(text) +
                              " says neither recorded, reflectance nor mixed");
      }
      cloud.color_light = known->second;
    } else if (!text.starts_with(kVersionComment)) {
      cloud.comments.push_back(comment);
    }
  }
}

double finest_las_step(const std::vector<std::string>& comments, const std::string& file) {
  const auto told = std::find_if(comments.begin(), comments.end(), [](const std::string& comment) {
    return comment.starts_with(kLasComment);
  });
  return told == comments.end() ? 0 : parse_las_comment(*told, file).scale.cwiseAbs().minCoeff();
}

}  // namespace surfel
