#include "stability/published_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <surfel/render/a_buffer.h>

#include "render/inverse_jacobian.h"

namespace surfel::test {
namespace {

/// SS01 table 1, without normal and material.
template <class T>
struct PublishedFragment {
  T red = 0, green = 0, blue = 0, alpha = 0;  ///< Sums by weight; shaded: premultiplied.
  T weight = 0;                               ///< Sum of rho; shaded: below zero.
  T z = 0;                                    ///< Sum by weight; shaded: mean.

  T depth() const { return weight < 0 ? z : z / weight; }
};

template <class T>
class PublishedBuffer {
 public:
  using Fragment = PublishedFragment<T>;

  PublishedBuffer(int width, int height, const PublishedOptions& options)
      : options_(options), width_(width), pixels_(static_cast<std::size_t>(width) * height) {}

  /// SS01 section 6, steps 1 to 3.
  void add(int x, int y, const Fragment& contribution, T threshold) {
    std::vector<Fragment>& fragments = pixels_[static_cast<std::size_t>(y) * width_ + x];
    const T z = contribution.depth();
    for (Fragment& f : fragments) {
      if (!(std::abs(f.depth() - z) < threshold)) continue;
      if (f.weight < 0) return;
      f.red += contribution.red;
      f.green += contribution.green;
      f.blue += contribution.blue;
      f.alpha += contribution.alpha;
      f.weight += contribution.weight;
      f.z += contribution.z;
      return;
    }
    fragments.push_back(contribution);
    std::sort(fragments.begin(), fragments.end(),
              [](const Fragment& a, const Fragment& b) { return a.depth() < b.depth(); });
    if (fragments.size() <= static_cast<std::size_t>(options_.layers)) return;
    if (options_.layers == 1) {  // Section 4: the nearer one replaces the other.
      fragments.pop_back();
      return;
    }
    merge_nearest_pair(fragments);
  }

  Rgba resolve(int x, int y) const {
    Rgba color;
    for (const Fragment& f : pixels_[static_cast<std::size_t>(y) * width_ + x]) {
      const Fragment s = shaded(f);
      color.composite({static_cast<float>(s.red), static_cast<float>(s.green),
                       static_cast<float>(s.blue), static_cast<float>(s.alpha)});
    }
    return color;
  }

 private:
  Fragment shaded(const Fragment& f) const {
    if (f.weight < 0) return f;
    const T coverage = std::min(T(1), f.weight / static_cast<T>(options_.coverage));
    const T scale = coverage / f.weight;
    return {f.red * scale, f.green * scale, f.blue * scale, f.alpha * scale, -1, f.depth()};
  }

  void merge_nearest_pair(std::vector<Fragment>& fragments) const {
    std::size_t pair = 0;
    for (std::size_t i = 1; i + 1 < fragments.size(); ++i) {
      const auto gap = [&](std::size_t k) {
        return fragments[k + 1].depth() - fragments[k].depth();
      };
      if (gap(i) < gap(pair)) pair = i;
    }
    Fragment front = shaded(fragments[pair]);
    const Fragment back = shaded(fragments[pair + 1]);
    const T through = 1 - front.alpha;  // (12)
    front.red += back.red * through;
    front.green += back.green * through;
    front.blue += back.blue * through;
    front.alpha += back.alpha * through;
    front.z = (front.z + back.z) / 2;
    fragments[pair] = front;
    fragments.erase(fragments.begin() + static_cast<std::ptrdiff_t>(pair) + 1);
  }

  PublishedOptions options_;
  int width_;
  std::vector<std::vector<Fragment>> pixels_;  ///< Nearest first.
};

}  // namespace

template <class T>
Image render_published(const SurfelCloud& cloud, const Camera& camera,
                       const PublishedOptions& options) {
  using Vec3 = Eigen::Matrix<T, 3, 1>;
  using Mat2 = Eigen::Matrix<T, 2, 2>;
  const Eigen::Matrix<T, 3, 3> rotation = camera.camera_from_world.cast<T>();
  const Vec3 eye = camera.eye.cast<T>();
  const Array<Vec3f>& colors = *cloud.render_color();
  const auto focal = static_cast<T>(camera.focal_x);
  const auto cutoff = static_cast<T>(options.cutoff);
  PublishedBuffer<T> buffer(camera.width, camera.height, options);
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const Vec3 P = rotation * (cloud.world(k).cast<T>() - eye);
    const Vec3 n = rotation * cloud.normal[k].cast<T>().normalized();
    if (!(P.z() > 0)) continue;
    const T variance = cloud.variance[k];
    const Mat2 JJ = focal * focal * Sigma_by_inverse<T>(P, n);
    const Mat2 Sigma = variance * JJ + Mat2::Identity();  // (6)
    const T determinant = Sigma.determinant();
    const Mat2 inverse = Sigma.inverse();
    const T amplitude = static_cast<T>(cloud.area.empty() ? variance : cloud.area[k]) *
                        std::sqrt(std::abs(JJ.determinant())) /
                        (T(2 * M_PI) * std::sqrt(determinant));
    const T x_k = focal * P.x() / P.z() + static_cast<T>(camera.center_x);
    const T y_k = focal * P.y() / P.z() + static_cast<T>(camera.center_y);
    const T threshold = options.depth_threshold > 0 ? static_cast<T>(options.depth_threshold)
                                                    : std::sqrt(2 * cutoff * variance);
    const auto first = [](T x) { return static_cast<int>(std::floor(std::max(x, T(0)))); };
    const auto last = [](T x, int size) {
      return static_cast<int>(std::ceil(std::min(x, static_cast<T>(size))));
    };
    const T half_x = std::sqrt(2 * cutoff * Sigma(0, 0));
    const T half_y = std::sqrt(2 * cutoff * Sigma(1, 1));
    if (!std::isfinite(half_x) || !std::isfinite(half_y)) continue;
    if (x_k + half_x < 0 || y_k + half_y < 0 || x_k - half_x > static_cast<T>(camera.width) ||
        y_k - half_y > static_cast<T>(camera.height)) {
      continue;
    }
    for (int y = first(y_k - half_y); y < last(y_k + half_y, camera.height); ++y) {
      for (int x = first(x_k - half_x); x < last(x_k + half_x, camera.width); ++x) {
        const Eigen::Matrix<T, 2, 1> d(static_cast<T>(x) + T(0.5) - x_k,
                                       static_cast<T>(y) + T(0.5) - y_k);
        const T beta = d.dot(inverse * d) / 2;
        if (!(beta < cutoff)) continue;
        const T rho = amplitude * std::exp(-beta);
        const Vec3 ray((static_cast<T>(x) + T(0.5) - static_cast<T>(camera.center_x)) / focal,
                       (static_cast<T>(y) + T(0.5) - static_cast<T>(camera.center_y)) / focal, 1);
        const T z = n.dot(P) / n.dot(ray);
        if (!(rho > 0) || !std::isfinite(z)) continue;
        const T weight = rho * static_cast<T>(cloud.alpha.empty() ? 1 : cloud.alpha[k]);
        const Vec3 color = weight * colors[k].cast<T>();
        buffer.add(x, y, {color.x(), color.y(), color.z(), weight, rho, rho * z}, threshold);
      }
    }
  }
  Image image;
  image.width = camera.width;
  image.height = camera.height;
  image.channels = {"R", "G", "B", "A"};
  image.data.resize(static_cast<std::size_t>(camera.width) * camera.height * 4);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Rgba c = buffer.resolve(x, y);
      const float values[] = {c.red, c.green, c.blue, c.alpha};
      std::copy_n(values, 4, image.pixel(x, y));
    }
  }
  return image;
}

template Image render_published<float>(const SurfelCloud&, const Camera&, const PublishedOptions&);
template Image render_published<double>(const SurfelCloud&, const Camera&, const PublishedOptions&);

}  // namespace surfel::test
