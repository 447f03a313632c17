#include <surfel/base/bounds.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/gaussian_transform.h>
#include <surfel/scene/harmonic_rotation.h>

namespace surfel {

void transform_gaussians(GaussianCloud& cloud, const Similarity& similarity) {
  require_usable(similarity);
  if (similarity.identity()) return;
  const Eigen::Matrix3d rotation = similarity.rotation.toRotationMatrix();
  const Eigen::Matrix3d linear = similarity.scale * rotation;
  const HarmonicRotation colors(rotation, cloud.degree);
  const std::size_t stride = cloud.harmonics_stride();

  Bounds box;
  for (const Vec3f& p : cloud.position) box.add(linear * p.cast<double>());
  const Vec3d moved_origin = linear * cloud.origin + similarity.translation;
  box.min += moved_origin;
  box.max += moved_origin;
  cloud.origin = float_origin(box);
  const Vec3d shift = moved_origin - cloud.origin;

  constexpr std::size_t kGrain = std::size_t{1} << 12;
  parallel_each(cloud.size(), kGrain, [&](std::size_t i) {
    cloud.position[i] = (linear * cloud.position[i].cast<double>() + shift).cast<float>();
    cloud.scale[i] = (similarity.scale * cloud.scale[i].cast<double>()).cast<float>();
    std::array<float, 4>& q = cloud.rotation[i];
    const Eigen::Quaterniond turned =
        similarity.rotation * Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    q = {static_cast<float>(turned.w()), static_cast<float>(turned.x()),
         static_cast<float>(turned.y()), static_cast<float>(turned.z())};
    if (cloud.rule == AmplitudeRule::kDensity) {
      cloud.amplitude[i] = static_cast<float>(cloud.amplitude[i] / similarity.scale);
    }
    colors.turn(cloud.harmonics.data() + i * stride);
  });
  if (cloud.up) cloud.up = rotation * *cloud.up;
}

}  // namespace surfel
