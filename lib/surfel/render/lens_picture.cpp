// Heckbert, "Fundamentals of Texture Mapping and Image Warping", 1989: resampling by Gaussians.

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/lens_picture.h>

namespace surfel {
namespace {

/// Least pixels of a pinhole's picture along the side of a pixel of the result.
constexpr double kFineness = 1.25;
/// Least number of pixels of a face beyond its edge, for filters that reach over it.
constexpr int kFaceMargin = 16;
/// Standard deviations; the filter beyond them is 1 percent of the sum.
constexpr double kFilterReach = 3;
/// Slope of the sides of the widest single pinhole, 60 degrees from its axis. Beyond, its outer
/// pixels would be more than four times as fine as needed, and a cube costs less.
constexpr double kMostSlope = 1.7320508;

/// Pictures of each pole of a panorama: the cube's face, and squares of half its side and so on,
/// each twice as fine. With more it would be the few rows next to the poles that get sharper.
constexpr int kPoleLevels = 4;
/// How many pixels the face of a pole has along a slope on which other faces have one. A row's
/// pixels are as narrow as the slope from the pole, which is half of a square's side at least where
/// no finer square is; 1.12 pixels of a face are enough there, as the filter that is left then has
/// its least variance.
constexpr double kPoleFineness = 2 * 1.12 / kFineness;
/// Least width of a pixel by its length that faces are fine enough for, but at poles.
constexpr double kLeastWidth = 0.25;

/// One pinhole: `face_from_camera` turns the lens's axes into its own.
struct Face {
  Eigen::Matrix3d face_from_camera = Eigen::Matrix3d::Identity();
  Eigen::Vector2d low{0, 0};   ///< Least x / z and y / z that are seen.
  Eigen::Vector2d high{0, 0};  ///< Largest.
  double fineness = 1;         ///< Pixels along a slope on which other faces have one.
};

/// The rays of all pixels; zero where the lens shows nothing.
class RayTable {
 public:
  RayTable(const Camera& camera, const Lens& lens) : width_(camera.width), height_(camera.height) {
    const LensRays rays(camera, lens);
    table_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    parallel_each(static_cast<std::size_t>(height_), 1, [&](std::size_t row) {
      for (int x = 0; x < width_; ++x) {
        const auto ray = rays(x + 0.5, static_cast<double>(row) + 0.5);
        table_[row * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)] =
            ray ? Vec3f(ray->cast<float>()) : Vec3f(0, 0, 0);
      }
    });
  }
  int width() const { return width_; }
  int height() const { return height_; }
  Vec3d at(int x, int y) const {
    return table_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                  static_cast<std::size_t>(x)]
        .cast<double>();
  }

 private:
  int width_;
  int height_;
  std::vector<Vec3f> table_;
};

Eigen::Vector2d slope_of(const Vec3d& p) { return p.head<2>() / p.z(); }

/// The pinhole with the camera's axes, if it sees enough.
bool sees_all(const RayTable& rays, Face& face) {
  face.low.setConstant(std::numeric_limits<double>::infinity());
  face.high = -face.low;
  for (int y = 0; y < rays.height(); ++y) {
    for (int x = 0; x < rays.width(); ++x) {
      const Vec3d ray = rays.at(x, y);
      if (ray.isZero()) continue;
      if (!(ray.head<2>().cwiseAbs().maxCoeff() <= kMostSlope * ray.z())) return false;
      face.low = face.low.cwiseMin(slope_of(ray));
      face.high = face.high.cwiseMax(slope_of(ray));
    }
  }
  if (!(face.low.x() <= face.high.x())) face.low = face.high = Eigen::Vector2d(0, 0);
  return true;
}

/// The six faces, in the order of face_of(), and the squares about the poles of a panorama.
std::vector<Face> cube(bool panorama) {
  std::vector<Face> faces;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      Face face;
      const Vec3d forward = sign * Vec3d::Unit(axis);
      const Vec3d right = Vec3d::Unit((axis + 1) % 3);
      face.face_from_camera.row(0) = right;
      face.face_from_camera.row(1) = forward.cross(right);
      face.face_from_camera.row(2) = forward;
      face.low.setConstant(-1);
      face.high.setConstant(1);
      if (panorama && axis == 1) face.fineness = kPoleFineness;
      faces.push_back(face);
    }
  }
  for (int level = 1; panorama && level < kPoleLevels; ++level) {
    for (const std::size_t pole : {2, 3}) {
      Face face = faces[pole];
      face.low = std::ldexp(1, -level) * face.low;
      face.high = -face.low;
      face.fineness *= std::ldexp(1, level);
      faces.push_back(face);
    }
  }
  return faces;
}

/// The one of `count` faces that shows a ray.
std::size_t face_of(const Vec3d& ray, std::size_t count) {
  if (count == 1) return 0;
  Eigen::Index axis = 0;
  double along = ray.cwiseAbs().maxCoeff(&axis);
  const std::size_t side = ray[axis] < 0 ? 1 : 0;
  std::size_t face = 2 * static_cast<std::size_t>(axis) + side;
  if (axis != 1) return face;
  const double across = std::max(std::abs(ray.x()), std::abs(ray.z()));
  for (std::size_t next = 6; next < count && 2 * across <= along; next += 2) {
    face = next + side;
    along /= 2;
  }
  return face;
}

/// Derivative of x / z, y / z on a face by the places of the result's pixels; nullopt where a pixel
/// has no neighbours that are seen.
std::optional<Eigen::Matrix2d> derivative(const RayTable& rays, const Face& face, int x, int y) {
  const auto slope_at = [&](int u, int v) -> std::optional<Eigen::Vector2d> {
    if (u < 0 || v < 0 || u >= rays.width() || v >= rays.height()) return std::nullopt;
    const Vec3d p = face.face_from_camera * rays.at(u, v);
    if (!(p.z() > 0)) return std::nullopt;
    return slope_of(p);
  };
  const Eigen::Vector2d middle = *slope_at(x, y);
  Eigen::Matrix2d result;
  for (int axis = 0; axis < 2; ++axis) {
    const int u = axis == 0 ? 1 : 0;
    const auto after = slope_at(x + u, y + 1 - u);
    const auto before = slope_at(x - u, y - 1 + u);
    if (!after && !before) return std::nullopt;
    result.col(axis) =
        (after.value_or(middle) - before.value_or(middle)) / ((after ? 1 : 0) + (before ? 1 : 0));
  }
  return result;
}

/// The singular value of J that a face's fineness is chosen by: the smaller one, but of panoramas,
/// whose poles have faces of their own, the larger one.
double stretch(const Eigen::Matrix2d& j, bool panorama) {
  const double sum = j.squaredNorm();
  const double d = std::abs(j.determinant());
  const double most = std::sqrt((sum + std::sqrt(std::max(0.0, sum * sum - 4 * d * d))) / 2);
  return panorama || most == 0 ? most : std::max(d / most, kLeastWidth * most);
}

/// A picture with the pinhole camera that it was drawn by, and the Gaussian sums over it.
class FacePicture {
 public:
  FacePicture(const Camera& camera, const Face& face, Image image, double lowpass, bool distances)
      : camera_(camera),
        face_(face),
        image_(std::move(image)),
        variance_(lowpass * lowpass),
        distances_(distances) {
    for (int c = 4; c < image_.channel_count(); ++c) {
      depths_.push_back(image_.channels[static_cast<std::size_t>(c)].starts_with("Z"));
    }
  }

  /// A picture for the result, with this background and nothing seen.
  Image blank(const Camera& camera, const std::array<float, 4>& background) const {
    Image blank{camera.width, camera.height, image_.channels, {}};
    const std::size_t channels = blank.channels.size();
    blank.data.assign(
        channels * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height),
        0.0F);
    for (std::size_t i = 0; i < blank.data.size(); i += channels) {
      std::copy(background.begin(), background.end(),
                blank.data.begin() + static_cast<std::ptrdiff_t>(i));
      for (std::size_t c = 4; c < channels; ++c) {
        if (depths_[c - 4]) blank.data[i + c] = std::numeric_limits<float>::infinity();
      }
    }
    return blank;
  }

  void sample(const RayTable& rays, int x, int y, float* to) const {
    const Vec3d ray = rays.at(x, y);
    const Vec3d p = face_.face_from_camera * ray;
    const Eigen::Vector2d focal(camera_.focal_x, camera_.focal_y);
    const Eigen::Vector2d center =
        focal.cwiseProduct(slope_of(p)) + Eigen::Vector2d(camera_.center_x, camera_.center_y);
    const Eigen::Matrix2d j =
        focal.asDiagonal() *
        derivative(rays, face_, x, y).value_or(Eigen::Matrix2d::Identity() * kFineness / focal.x());
    add_colors(center, filter_of(j), to);
    copy_nearest(center, ray, p.z(), to);
  }

 private:
  /// Variance of the part of the pixel filter that the face's own filter has not done: the wanted
  /// one in the face's pixels less the one that drew the face.
  Eigen::Matrix2d filter_of(const Eigen::Matrix2d& j) const {
    constexpr double kLeast = 0.25;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(variance_ * j * j.transpose());
    const Eigen::Vector2d left = (axes.eigenvalues().array() - variance_).max(kLeast).matrix();
    return axes.eigenvectors() * left.asDiagonal() * axes.eigenvectors().transpose();
  }

  void add_colors(const Eigen::Vector2d& center, const Eigen::Matrix2d& variance, float* to) const {
    const Eigen::Matrix2d inverse = variance.inverse();
    const int first_x = first(center.x(), kFilterReach * std::sqrt(variance(0, 0)), image_.width);
    const int first_y = first(center.y(), kFilterReach * std::sqrt(variance(1, 1)), image_.height);
    const int last_x = last(center.x(), kFilterReach * std::sqrt(variance(0, 0)), image_.width);
    const int last_y = last(center.y(), kFilterReach * std::sqrt(variance(1, 1)), image_.height);
    double total = 0;
    std::array<double, 4> sum{};
    for (int v = first_y; v <= last_y; ++v) {
      for (int u = first_x; u <= last_x; ++u) {
        const Eigen::Vector2d d(u + 0.5 - center.x(), v + 0.5 - center.y());
        const double beta = d.dot(inverse * d) / 2;
        if (beta > kFilterReach * kFilterReach / 2) continue;
        const double weight = portable::exp(-beta);
        const float* pixel = image_.pixel(u, v);
        for (std::size_t c = 0; c < 4; ++c) sum[c] += weight * static_cast<double>(pixel[c]);
        total += weight;
      }
    }
    for (std::size_t c = 0; c < 4; ++c) to[c] = static_cast<float>(sum[c] / total);
  }

  void copy_nearest(const Eigen::Vector2d& center, const Vec3d& ray, double along,
                    float* to) const {
    const int u = std::clamp(static_cast<int>(center.x()), 0, image_.width - 1);
    const int v = std::clamp(static_cast<int>(center.y()), 0, image_.height - 1);
    const float* pixel = image_.pixel(u, v);
    // Depths along the face's axis become distances, or depths along the camera's.
    const double scale = (distances_ ? ray.norm() : ray.z()) / along;
    for (std::size_t c = 4; c < image_.channels.size(); ++c) {
      to[c] = depths_[c - 4] ? static_cast<float>(pixel[c] * scale) : pixel[c];
    }
  }

  static int first(double center, double reach, int size) {
    return std::clamp(static_cast<int>(std::floor(center - reach)), 0, size - 1);
  }
  static int last(double center, double reach, int size) {
    return std::clamp(static_cast<int>(std::floor(center + reach)), 0, size - 1);
  }

  const Camera& camera_;
  const Face& face_;
  Image image_;
  double variance_;
  bool distances_;
  std::vector<bool> depths_;  ///< Which of the channels after R G B A are depths.
};

/// The camera of a face.
/// \param of_others  pixels along a slope of 1 where the face's fineness is 1
/// \param lowpass    LensPictureOptions::lowpass
Camera camera_of_face(const Camera& camera, const Face& face, double of_others, double lowpass) {
  Camera result = camera;
  const double focal = of_others * face.fineness;
  // Pixels of the result are as long on all faces, however narrow they are, and longer where their
  // slope is not 0.
  constexpr double kLonger = 1.5;
  const double reach = kFilterReach * lowpass * kLonger * kFineness * face.fineness;
  const int margin = std::max(kFaceMargin, static_cast<int>(std::ceil(reach)));
  const auto pixels = [&](double slope) { return static_cast<int>(std::ceil(slope * focal)); };
  const int left = pixels(-face.low.x()) + margin;
  const int top = pixels(-face.low.y()) + margin;
  result.width = left + pixels(face.high.x()) + margin;
  result.height = top + pixels(face.high.y()) + margin;
  result.center_x = left;
  result.center_y = top;
  result.focal_x = focal;
  result.focal_y = focal;
  result.camera_from_world = face.face_from_camera * camera.camera_from_world;
  return result;
}

/// Pixels along a slope of 1 with which no pixel of the result is coarser than the faces'.
double focal_of_faces(const RayTable& rays, const std::vector<Face>& faces) {
  std::vector<double> least(static_cast<std::size_t>(rays.height()),
                            std::numeric_limits<double>::infinity());
  parallel_each(least.size(), 1, [&](std::size_t row) {
    for (int x = 0; x < rays.width(); ++x) {
      const Vec3d ray = rays.at(x, static_cast<int>(row));
      if (ray.isZero()) continue;
      const Face& face = faces[face_of(ray, faces.size())];
      const auto j = derivative(rays, face, x, static_cast<int>(row));
      if (j) least[row] = std::min(least[row], stretch(*j, faces.size() > 6));
    }
  });
  const double smallest = *std::min_element(least.begin(), least.end());
  return smallest > 0 && std::isfinite(smallest) ? kFineness / smallest : 1;
}

void require_few_pixels(const std::vector<Face>& faces, const Camera& camera, double focal,
                        double lowpass) {
  for (const Face& face : faces) {
    const Camera pinhole = camera_of_face(camera, face, std::min(focal, 1e5), lowpass);
    if (pinhole.problems().empty()) continue;
    throw_usage(
        "the lens bends lines so much that its picture would be made from one of too many pixels; "
        "make a smaller picture");
  }
}

}  // namespace

bool needs_cube(const Camera& camera, const Lens& lens) {
  Face face;
  return lens.model == Lens::Model::kEquirectangular || !sees_all(RayTable(camera, lens), face);
}

Image draw_through_lens(const Camera& camera, const Lens& lens,
                        const std::function<Image(const Camera&)>& draw,
                        const LensPictureOptions& options) {
  const RayTable rays(camera, lens);
  const bool distances = lens.model == Lens::Model::kEquirectangular;
  std::vector<Face> faces(1);
  if (distances || !sees_all(rays, faces[0])) faces = cube(distances);
  const double focal = focal_of_faces(rays, faces);
  require_few_pixels(faces, camera, focal, options.lowpass);

  Image result;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const auto is_here = [&](const Vec3d& ray) {
      return !ray.isZero() && face_of(ray, faces.size()) == i;
    };
    bool seen = faces.size() == 1;
    for (int y = 0; y < rays.height() && !seen; ++y) {
      for (int x = 0; x < rays.width() && !seen; ++x) seen = is_here(rays.at(x, y));
    }
    if (!seen) continue;
    const Camera pinhole = camera_of_face(camera, faces[i], focal, options.lowpass);
    const FacePicture picture(pinhole, faces[i], draw(pinhole), options.lowpass, distances);
    if (result.data.empty()) result = picture.blank(camera, options.background);
    parallel_each(static_cast<std::size_t>(camera.height), 1, [&](std::size_t row) {
      const int y = static_cast<int>(row);
      for (int x = 0; x < camera.width; ++x) {
        if (is_here(rays.at(x, y))) picture.sample(rays, x, y, result.pixel(x, y));
      }
    });
  }
  return result;
}

}  // namespace surfel
