#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/truth/volume_march.h>
#include <surfel/volume/gaussians_of_volume.h>

namespace surfel {
namespace {

class Marcher {
 public:
  Marcher(const Volume& volume, const TransferFunction& function, const VolumeMarchOptions& options)
      : volume_(volume), function_(function), options_(options) {
    Eigen::Matrix3d steps;
    for (int k = 0; k < 3; ++k) steps.col(k) = volume.step[static_cast<std::size_t>(k)];
    voxel_from_world_ = steps.inverse();
    edge_ = portable::exp(portable::log(std::abs(steps.determinant())) / 3);
    const auto [least, most] = std::minmax_element(volume.value.begin(), volume.value.end());
    range_ = static_cast<double>(*most) - static_cast<double>(*least);
  }

  /// Premultiplied colour and opacity of a ray.
  Eigen::Array4d operator()(const Vec3d& eye, const Vec3d& direction) const {
    const Vec3d from = voxel_from_world_ * (eye - volume_.origin);
    const Vec3d along = voxel_from_world_ * direction;
    double first = 0;
    double last = 1e300;
    for (int k = 0; k < 3; ++k) {
      const double low = -0.5 - from[k];
      const double high =
          static_cast<double>(volume_.size[static_cast<std::size_t>(k)]) - 0.5 - from[k];
      if (along[k] == 0) {
        if (low > 0 || high < 0) return Eigen::Array4d::Zero();
        continue;
      }
      first = std::max(first, std::min(low / along[k], high / along[k]));
      last = std::min(last, std::max(low / along[k], high / along[k]));
    }
    Eigen::Array4d out = Eigen::Array4d::Zero();
    if (!(first < last)) return out;
    const double step = options_.step * edge_;
    const auto steps = static_cast<std::size_t>(std::ceil((last - first) / step));
    const double length = (last - first) / static_cast<double>(steps);
    constexpr double kOpaque = 1 - 1e-6;
    for (std::size_t i = 0; i < steps && out[3] < kOpaque; ++i) {
      const Vec3d at = from + along * (first + (static_cast<double>(i) + 0.5) * length);
      const TransferFunction::Point p = function_(value_at(volume_, at));
      if (p.density == 0) continue;
      const double alpha = -portable::expm1(-p.density * options_.density * length);
      const double share = (1 - out[3]) * alpha * shade(at, direction);
      for (int c = 0; c < 3; ++c) out[c] += share * static_cast<double>(p.color[c]);
      out[3] += (1 - out[3]) * alpha;
    }
    return out;
  }

 private:
  double shade(const Vec3d& at, const Vec3d& direction) const {
    const Vec3d gradient = gradient_at(volume_, at);
    const double length = gradient.norm();
    if (!(length > 0)) return 1;
    const double half = options_.shading * shading_weight(length, range_, edge_) / 2;
    // Values fall along the normal, and the sight goes to the eye.
    return 1 - half + half * gradient.dot(direction) / length;
  }

  const Volume& volume_;
  const TransferFunction& function_;
  const VolumeMarchOptions& options_;
  Eigen::Matrix3d voxel_from_world_;
  double edge_ = 1;
  double range_ = 1;
};

}  // namespace

Image march_volume(const Volume& volume, const TransferFunction& function, const Camera& camera,
                   const VolumeMarchOptions& options) {
  if (camera.orthographic) throw_usage("volumes are marched through in perspective");
  const Marcher march(volume, function, options);
  Image image = rgba_image(camera.width, camera.height);
  // Places of the pixel filter, up to three standard deviations, with their weights.
  const int rays = std::clamp(options.rays, 1, 16);
  const double reach = 3 * options.lowpass;
  std::vector<double> offset;
  std::vector<double> weight;
  double sum = 0;
  for (int k = 0; k < rays; ++k) {
    const double at = reach * ((2.0 * k + 1) / rays - 1);
    offset.push_back(at);
    weight.push_back(options.lowpass > 0
                         ? portable::exp(-at * at / (2 * portable::squared(options.lowpass)))
                         : 1.0);
    sum += weight.back();
  }
  for (double& w : weight) w /= sum;
  parallel_each(static_cast<std::size_t>(camera.height), 1, [&](std::size_t row) {
    for (int x = 0; x < camera.width; ++x) {
      Eigen::Array4d pixel = Eigen::Array4d::Zero();
      for (std::size_t j = 0; j < offset.size(); ++j) {
        for (std::size_t i = 0; i < offset.size(); ++i) {
          const Vec3d sight(
              (x + 0.5 + offset[i] - camera.center_x) / camera.focal_x,
              (static_cast<double>(row) + 0.5 + offset[j] - camera.center_y) / camera.focal_y, 1);
          const Vec3d direction = (camera.camera_from_world.transpose() * sight).normalized();
          pixel += weight[i] * weight[j] * march(camera.eye, direction);
        }
      }
      float* to = image.pixel(x, static_cast<int>(row));
      for (int c = 0; c < 4; ++c) to[c] = static_cast<float>(pixel[c]);
    }
  });
  return image;
}

}  // namespace surfel
