#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/surface_sample.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// What is known of a scene besides its surface.
struct ViewHints {
  std::optional<Vec3d> up;                     ///< Direction that is up: no guess then.
  const char* up_reason = "as the file says";  ///< Why `up` is known.
  std::optional<Viewpoint> viewpoint;          ///< Where the sensor of a scan stood.
};

/// How a sensor saw a scene.
struct SensorView {
  Vec3d eye;      ///< World coordinates.
  Vec3d forward;  ///< Unit: the middle of what it saw.
  Vec3d up;       ///< Unit, across `forward`.
  double tan_x;   ///< Tangents of half the angles that hold what it saw, to either side and
  double tan_y;   ///< up and down; > 0.
};

/// Views by name, relative to a guess.
enum class NamedView : std::uint8_t {
  kFront,
  kBack,
  kLeft,  ///< From the left of who stands in front.
  kRight,
  kTop,     ///< The front at the picture's lower edge.
  kBottom,  ///< The front at the upper edge.
  kIso,     ///< From the front, the right and above alike.
  kSensor
};

/// Which way is up, and from where a scene is best looked at.
struct ViewGuess {
  Vec3d up{0, 1, 0};     ///< Unit.
  Vec3d front{0, 0, 1};  ///< Unit, across `up`: from the scene's middle to who looks at it.
  double azimuth = 0;    ///< The eye stands that far to the right of the front,
  double elevation = 0;  ///< and that far above the middle; radians.
  std::string reason;    ///< What the guess of `up` rests on, in words.
  double margin = 0;     ///< How far ahead of the second best `up` is, 0 = not at all; about
                         ///< 0.5 is clear. Infinite where it is known.
  std::optional<SensorView> sensor;  ///< Set where a viewpoint is known that looks at the scene.

  Vec3d right() const { return up.cross(front); }
  /// Direction from the scene's middle to the eye.
  SURFEL_API Vec3d from() const;
  /// "up z, seen from the front right (largest flat support)"; "up z (largest flat support), seen
  /// from the left" where the view is another than the guess.
  SURFEL_API std::string sentence(std::optional<NamedView> view = {}) const;
};

/// Guesses how a scene stands and where its front is.
///
/// Up is one of the axes of the scene's coordinates, or, where a plane under everything that is
/// larger than any other shows that the scene is tilted, that plane's normal. Axes are compared by
/// the support that the scene has when it stands on its lowest points (Fu et al. 2008, "Upright
/// orientation of man-made objects": the hull of the lowest points must hold the centre of mass),
/// by how flat it lies, by mirror symmetry (whose plane holds the upward direction), in rooms by
/// where the things are that stand on the floor, and by convention: y, then z, where nothing else
/// tells. Open surfaces that look along -z have coordinates of a camera (x right, y down), those
/// that look along +z of a graphics program; those with coordinates of a map have z up.
///
/// The front is across the plane of symmetry or the wider silhouette, on the side with more detail;
/// scans are seen from where the sensor stood.
///
/// The result depends neither on the order of the points nor on threads. Takes some 10 ms.
SURFEL_API ViewGuess guess_view(const SurfaceSample& sample, const ViewHints& hints = {});

/// What a user asks of a view, beside CameraOptions.
struct ViewChoice {
  /// Guess which way is up even where the camera has a place or a direction, with which y is up
  /// otherwise.
  bool guess_up = false;
  std::optional<NamedView> view;

  /// Is a guess needed for this camera?
  bool needs_guess(const CameraOptions& camera) const {
    return guess_up || view || (!camera.eye && !camera.from);
  }
};

/// Fills in what a camera leaves open, by a guess that was made with `camera.up` as a hint: its
/// direction, unless it has one; its up; and for views from the sensor the eye and the field of
/// view, unless the camera has a target or a field of view other than the default. Throws
/// Error(kUsage) for a view beside a direction, and for a view from an unknown sensor. Returns what
/// was done in words: "up z, seen from the front right (largest flat support)".
SURFEL_API std::string aim_camera(CameraOptions& camera, const ViewChoice& choice,
                                  const ViewGuess& guess);

}  // namespace surfel
