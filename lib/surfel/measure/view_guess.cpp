#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/measure/front_guess.h>
#include <surfel/measure/judged_surface.h>
#include <surfel/measure/sensor_view.h>
#include <surfel/measure/upright_guess.h>
#include <surfel/measure/view_guess.h>

namespace surfel {
namespace {

constexpr const char* kSensorReason = "as the sensor stood";

/// The guess of a scene that can be judged.
ViewGuess judge_view(const JudgedSurface& s, const ViewHints& hints) {
  ViewGuess guess;
  Vec3d sensor_up(0, 1, 0);
  if (hints.viewpoint) guess.sensor = find_sensor_view(s, *hints.viewpoint, sensor_up);
  std::array<double, 3> symmetry{};
  for (std::size_t k = 0; k < 3; ++k) symmetry[k] = s.mirrored(k);
  if (hints.up) {
    guess.up = hints.up->normalized();
    guess.reason = hints.up_reason;
    guess.margin = std::numeric_limits<double>::infinity();
  } else if (guess.sensor) {
    guess.up = snapped(sensor_up, 2);
    guess.reason = kSensorReason;
    guess.margin = std::numeric_limits<double>::infinity();
  } else {
    const UprightGuess upright = guess_upright(s, symmetry);
    guess.up = upright.up;
    guess.margin = upright.margin;
    guess.reason = upright.reason;
  }
  std::optional<SensorView> seen_by = guess.sensor;
  if (!seen_by && s.of_camera()) seen_by = find_sensor_view(s, Viewpoint{}, sensor_up);
  if (seen_by) {
    const Vec3d back = -seen_by->forward;
    const Vec3d level = back - back.dot(guess.up) * guess.up;
    guess.front = level.norm() > 1e-3 ? Vec3d(level.normalized()) : conventional_front(guess.up);
    guess.elevation = portable::atan2(back.dot(guess.up), level.norm());
  } else {
    const FrontGuess front = guess_front(s, guess.up, symmetry);
    guess.front = front.front;
    guess.azimuth = front.azimuth;
    guess.elevation = front.elevation;
  }
  // Zeros without a sign, as people write them.
  guess.up += Vec3d::Zero();
  guess.front += Vec3d::Zero();
  return guess;
}

/// "z", "-y", or the numbers of a direction that is no axis.
std::string direction_name(const Vec3d& d) {
  constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    if (std::abs(d[k]) > 1 - 1e-9) {
      return fmt::format("{}{}", d[k] < 0 ? "-" : "", kNames[static_cast<std::size_t>(k)]);
    }
  }
  return fmt::format("{:.3g},{:.3g},{:.3g}", d.x(), d.y(), d.z());
}

struct ViewDirection {
  Vec3d from;
  Vec3d up;
};

/// Direction from the scene's middle to the eye, and the picture's up.
ViewDirection named_direction(const ViewGuess& guess, NamedView view) {
  switch (view) {
    case NamedView::kBack:
      return {-guess.front, guess.up};
    case NamedView::kLeft:
      return {-guess.right(), guess.up};
    case NamedView::kRight:
      return {guess.right(), guess.up};
    case NamedView::kTop:
      return {guess.up, -guess.front};
    case NamedView::kBottom:
      return {-guess.up, guess.front};
    case NamedView::kIso:
      return {guess.front + guess.right() + guess.up, guess.up};
    case NamedView::kFront:
    case NamedView::kSensor:
      break;
  }
  return {guess.front, guess.up};
}

}  // namespace

Vec3d ViewGuess::from() const {
  return portable::cos(elevation) *
             (portable::cos(azimuth) * front + portable::sin(azimuth) * right()) +
         portable::sin(elevation) * up;
}

std::string ViewGuess::sentence(std::optional<NamedView> view) const {
  if (view) {
    constexpr std::array<const char*, 8> kFrom{"the front",
                                               "the back",
                                               "the left",
                                               "the right",
                                               "above",
                                               "below",
                                               "the front, right and above",
                                               "where the sensor stood"};
    return fmt::format("up {} ({}), seen from {}", direction_name(up), reason,
                       kFrom[static_cast<std::size_t>(*view)]);
  }
  const char* side = azimuth > 0 ? "the front right" : "the front";
  const char* height = elevation > radians(45) ? " and high above" : "";
  const std::string from = sensor ? "where the sensor stood" : std::string(side).append(height);
  // Where the sensor stood it is the reason, too.
  const std::string why = sensor && reason == kSensorReason ? "" : fmt::format(" ({})", reason);
  return fmt::format("up {}, seen from {}{}", direction_name(up), from, why);
}

ViewGuess guess_view(const SurfaceSample& sample, const ViewHints& hints) {
  const JudgedSurface surface(sample);
  if (surface.usable()) return judge_view(surface, hints);
  ViewGuess guess;
  guess.up = hints.up ? hints.up->normalized() : Vec3d(0, 1, 0);
  guess.reason = hints.up ? hints.up_reason : "by convention";
  guess.front = conventional_front(guess.up);
  guess.elevation = radians(20);
  return guess;
}

std::string aim_camera(CameraOptions& camera, const ViewChoice& choice, const ViewGuess& guess) {
  const std::optional<NamedView>& view = choice.view;
  if (view && (camera.eye || camera.from)) {
    throw_usage("`view` and a direction of the camera exclude each other; leave out one");
  }
  if (view == NamedView::kSensor && !guess.sensor) {
    throw_usage(
        "`view` is sensor, and the file does not say where a sensor stood that looks at the "
        "points; give `eye` and `target`");
  }
  const bool placed = camera.eye || camera.from;
  const std::string sentence =
      placed ? fmt::format("up {} ({})", direction_name(guess.up), guess.reason)
             : guess.sentence(view);
  if (!camera.up) camera.up = guess.up;
  if (placed) return sentence;
  const bool from_sensor = view ? view == NamedView::kSensor : guess.sensor.has_value();
  if (!from_sensor) {
    const ViewDirection direction =
        view ? named_direction(guess, *view) : ViewDirection{guess.from(), *camera.up};
    camera.from = direction.from;
    camera.up = direction.up;
    return sentence;
  }
  const SensorView& sensor = *guess.sensor;
  if (camera.target || camera.ortho) {
    camera.from = -sensor.forward;
    return sentence;
  }
  camera.eye = sensor.eye;
  camera.target = sensor.eye + sensor.forward;
  if (camera.fov == CameraOptions{}.fov) {
    constexpr double kMargin = 1.05;
    const double wanted =
        std::max(sensor.tan_y, sensor.tan_x * camera.height / std::max(1, camera.width));
    camera.fov = 2 * portable::atan(kMargin * wanted) * 180 / std::numbers::pi;
  }
  return sentence;
}

}  // namespace surfel
