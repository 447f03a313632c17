#include <charconv>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/option_check.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {
namespace {

constexpr std::string_view kCrsComment = "surfel_crs EPSG:";
constexpr std::string_view kGeographic = " geographic";

}  // namespace

std::vector<std::string> CoordinateSystem::problems() const {
  std::vector<std::string> found;
  // GeoTIFF 1.1 leaves codes below 1024 and above 32766 to others.
  check_option(found, epsg >= 1024 && epsg <= 32766, "epsg", epsg, "in 1024..32766");
  return found;
}

CoordinateSystem coordinate_system_of_code(int epsg) {
  return {.epsg = epsg, .geographic = epsg >= 4000 && epsg <= 4999};
}

std::string coordinate_system_comment(const CoordinateSystem& system) {
  return fmt::format("{}{}{}", kCrsComment, system.epsg, system.geographic ? kGeographic : "");
}

std::optional<CoordinateSystem> coordinate_system(const std::vector<std::string>& comments) {
  std::optional<CoordinateSystem> found;
  for (const std::string& comment : comments) {
    if (!comment.starts_with(kCrsComment)) continue;
    CoordinateSystem system;
    const char* const end = comment.data() + comment.size();
    const auto [stop, error] =
        std::from_chars(comment.data() + kCrsComment.size(), end, system.epsg);
    if (error != std::errc{} || !system.problems().empty()) return std::nullopt;
    system.geographic = std::string_view(stop, static_cast<std::size_t>(end - stop)) == kGeographic;
    if (found && *found != system) return std::nullopt;
    found = system;
  }
  return found;
}

void set_coordinate_system(SurfelCloud& cloud, const std::optional<CoordinateSystem>& system) {
  std::erase_if(cloud.comments,
                [](const std::string& line) { return line.starts_with(kCrsComment); });
  if (cloud.las) {
    std::erase_if(cloud.las->records,
                  [](const LasRecord& record) { return record.user == "LASF_Projection"; });
  }
  if (system) cloud.comments.push_back(coordinate_system_comment(*system));
}

}  // namespace surfel
