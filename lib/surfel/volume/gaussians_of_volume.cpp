#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/volume/gaussians_of_volume.h>

namespace surfel {
namespace {

constexpr std::size_t kBlock = 8;  ///< Voxels along the edge of the largest merged block.
/// Optical depth of a voxel that counts as opaque. More would make its kernel opaque far beyond the
/// voxel.
constexpr double kMostDepth = 3;
constexpr double kHarmonic1 = 0.4886025119029199;  ///< sqrt(3 / (4 pi)).

/// What a voxel, or a block of voxels, looks like.
struct Look {
  double density = 0;        ///< Optical depth per scene unit.
  Vec3f color{0, 0, 0};      ///< Seen at right angles to the normal, or without a normal.
  Eigen::Matrix3f by_sight;  ///< Row k: what the colour channel k gains along the sight.

  static Look of(double density, const Vec3f& color) {
    return {density, color, Eigen::Matrix3f::Zero()};
  }
};

class Builder {
 public:
  Builder(const Volume& volume, const TransferFunction& function,
          const GaussiansOfVolumeOptions& options)
      : volume_(volume), function_(function), options_(options) {
    const auto [least, most] = std::minmax_element(volume.value.begin(), volume.value.end());
    range_ = static_cast<double>(*most) - static_cast<double>(*least);
    double product = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      edge_[k] = volume.step[k].norm();
      product *= edge_[k];
    }
    mean_edge_ = portable::exp(portable::log(product) / 3);
    // A kernel's density at its centre, times (2 pi)^(3/2) s^3, is a voxel's density times its
    // size.
    const double s = options.deviation;
    peak_ = 1 / (2 * std::numbers::pi * std::sqrt(2 * std::numbers::pi) * s * s * s);
  }

  GaussianCloud run(GaussiansOfVolumeReport& report) {
    std::array<std::size_t, 3> blocks;
    for (std::size_t k = 0; k < 3; ++k) blocks[k] = (volume_.size[k] + kBlock - 1) / kBlock;
    const std::size_t count = blocks[0] * blocks[1] * blocks[2];
    std::vector<Part> part(count);
    ProgressStage stage("classifying", volume_.voxels(), "voxels");
    parallel_for(count, 1, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t b = begin; b < end; ++b) {
        build_block({b % blocks[0] * kBlock, b / blocks[0] % blocks[1] * kBlock,
                     b / blocks[0] / blocks[1] * kBlock},
                    part[b]);
        stage.add(part[b].voxels);
      }
    });
    return joined(part, report);
  }

 private:
  struct Kernel {
    Vec3f position;     ///< In voxels.
    std::uint8_t edge;  ///< Of the block, voxels; 0: part of a larger one, or never was.
    Look look;
    /// Unit direction in voxels across which the kernel is flat, and by how much its variance along
    /// it is smaller than along others, voxels^2.
    Vec3f across{0, 0, 0};
    float thinner = 0;
  };
  struct Part {
    std::vector<Kernel> kernel;
    std::size_t voxels = 0;
    std::size_t empty = 0;
    std::size_t merged = 0;
  };

  /// Values along an axis at the places kPlace, in voxels from the middle one of three.
  static constexpr std::array<double, 3> kPlace{-1.0 / 3, 0, 1.0 / 3};
  static std::array<double, 3> interpolated(double before, double here, double after) {
    return {here + kPlace[0] * (here - before), here, here + kPlace[2] * (after - here)};
  }

  /// Values at 3 x 3 x 3 places in a voxel, of which the first index is along z.
  using Samples = std::array<std::array<std::array<double, 3>, 3>, 3>;
  Samples samples(const std::array<std::size_t, 3>& voxel) const {
    std::array<std::array<std::size_t, 3>, 3> near;
    for (std::size_t k = 0; k < 3; ++k) {
      near[k] = {voxel[k] - std::min<std::size_t>(voxel[k], 1), voxel[k],
                 std::min(voxel[k] + 1, volume_.size[k] - 1)};
    }
    Samples out;
    for (std::size_t z = 0; z < 3; ++z) {
      for (std::size_t y = 0; y < 3; ++y) {
        const float* row = volume_.value.data() + volume_.index(0, near[1][y], near[2][z]);
        out[z][y] =
            interpolated(static_cast<double>(row[near[0][0]]), static_cast<double>(row[near[0][1]]),
                         static_cast<double>(row[near[0][2]]));
      }
      for (std::size_t x = 0; x < 3; ++x) {
        const auto column = interpolated(out[z][0][x], out[z][1][x], out[z][2][x]);
        for (std::size_t y = 0; y < 3; ++y) out[z][y][x] = column[y];
      }
    }
    for (std::size_t y = 0; y < 3; ++y) {
      for (std::size_t x = 0; x < 3; ++x) {
        const auto line = interpolated(out[0][y][x], out[1][y][x], out[2][y][x]);
        for (std::size_t z = 0; z < 3; ++z) out[z][y][x] = line[z];
      }
    }
    return out;
  }

  /// The kernel of a voxel: mean density and colour of what the transfer function makes of the
  /// values in it, the density's centre, and its variance along the gradient.
  Kernel classify(const std::array<std::size_t, 3>& voxel) const {
    const Samples value = samples(voxel);
    const Vec3d gradient(value[1][1][2] - value[1][1][0], value[1][2][1] - value[1][0][1],
                         value[2][1][1] - value[0][1][1]);
    const Vec3d across = gradient.normalized();  // Zero stays zero.
    double sum = 0;
    double square = 0;
    Vec3d color(0, 0, 0);
    Vec3d center(0, 0, 0);
    for (std::size_t z = 0; z < 3; ++z) {
      for (std::size_t y = 0; y < 3; ++y) {
        for (std::size_t x = 0; x < 3; ++x) {
          const TransferFunction::Point p = function_(value[z][y][x]);
          if (p.density == 0) continue;
          const Vec3d place(kPlace[x], kPlace[y], kPlace[z]);
          sum += p.density;
          color += p.color.cast<double>() * p.density;
          center += place * p.density;
          square += portable::squared(across.dot(place)) * p.density;
        }
      }
    }
    const Vec3d middle(static_cast<double>(voxel[0]), static_cast<double>(voxel[1]),
                       static_cast<double>(voxel[2]));
    Kernel kernel{middle.cast<float>(), 1, Look::of(0, Vec3f(0, 0, 0))};
    if (sum == 0) return kernel;
    color /= sum;
    center /= sum;
    const double density = std::min(sum / 27 * options_.density, kMostDepth / mean_edge_);
    kernel.look = Look::of(density, color.cast<float>());
    shade(middle, kernel.look);
    kernel.position += center.cast<float>();
    // Each sample stands for a third of the voxel's edge.
    constexpr double kOfSample = 1.0 / (12 * 9);
    const double along = square / sum - portable::squared(across.dot(center)) + kOfSample;
    if (across.squaredNorm() > 0) {
      kernel.across = across.cast<float>();
      kernel.thinner =
          static_cast<float>(std::max(0.0, portable::squared(options_.deviation) - along));
    }
    return kernel;
  }

  /// Adds what the colour depends on the sight.
  void shade(const Vec3d& center, Look& look) const {
    const Vec3d gradient = gradient_at(volume_, center);
    const double length = gradient.norm();
    if (!(length > 0) || options_.shading == 0) return;
    const double weight = shading_weight(length, range_, mean_edge_);
    const Vec3f normal = (-gradient / length).cast<float>();
    const auto half = static_cast<float>(options_.shading * weight / 2);
    look.by_sight = look.color * (half * normal.transpose());
    look.color *= 1 - half;
  }

  /// The least and the largest density that the transfer function gives to values in a block, or
  /// within a margin of voxels around it.
  std::array<double, 2> densities_around(const std::array<std::size_t, 3>& first,
                                         const std::array<std::size_t, 3>& size,
                                         std::size_t margin) const {
    const auto begin = [&](std::size_t k) { return first[k] - std::min(first[k], margin); };
    const auto end = [&](std::size_t k) {
      return std::min(first[k] + size[k] + margin, volume_.size[k]);
    };
    float low = volume_.value[volume_.index(first[0], first[1], first[2])];
    float high = low;
    for (std::size_t z = begin(2); z < end(2); ++z) {
      for (std::size_t y = begin(1); y < end(1); ++y) {
        const float* row = volume_.value.data() + volume_.index(0, y, z);
        for (std::size_t x = begin(0); x < end(0); ++x) {
          low = std::min(low, row[x]);
          high = std::max(high, row[x]);
        }
      }
    }
    return function_.density_range(low, high);
  }

  void build_block(const std::array<std::size_t, 3>& first, Part& part) const {
    std::array<std::size_t, 3> size;
    for (std::size_t k = 0; k < 3; ++k) size[k] = std::min(kBlock, volume_.size[k] - first[k]);
    part.voxels = size[0] * size[1] * size[2];
    if (densities_around(first, size, 1)[1] == 0) {
      part.empty = part.voxels;
      return;
    }
    std::vector<Kernel> kernels;
    kernels.reserve(part.voxels);
    for (std::size_t z = 0; z < size[2]; ++z) {
      for (std::size_t y = 0; y < size[1]; ++y) {
        for (std::size_t x = 0; x < size[0]; ++x) {
          kernels.push_back(classify({first[0] + x, first[1] + y, first[2] + z}));
        }
      }
    }
    merge(first, size, kernels);
    for (const Kernel& kernel : kernels) {
      const std::size_t voxels = std::size_t{kernel.edge} * kernel.edge * kernel.edge;
      if (kernel.look.density * mean_edge_ < options_.least_depth) {
        part.empty += voxels;
        continue;
      }
      if (kernel.edge > 1) part.merged += voxels;
      part.kernel.push_back(kernel);
    }
  }

  static double opacity_of(double density, double length) {
    return -portable::expm1(-density * length);
  }

  /// Whether a kernel as wide as a block may reach beyond the block: what is around it is as dense.
  bool has_room(const std::array<std::size_t, 3>& first, std::size_t edge) const {
    const auto [least, most] = densities_around(first, {edge, edge, edge}, edge / 2);
    const double length = mean_edge_ * static_cast<double>(edge);
    return opacity_of(most * options_.density, length) -
               opacity_of(least * options_.density, length) <=
           options_.max_error;
  }

  /// Whether kernels look so much alike that their mean can stand for them.
  bool alike(const std::array<Kernel*, 8>& child) const {
    const double edge = mean_edge_ * child[0]->edge * 2;
    Look least = child[0]->look;
    Look most = least;
    for (const Kernel* kernel : child) {
      const Look& look = kernel->look;
      least.density = std::min(least.density, look.density);
      most.density = std::max(most.density, look.density);
      least.color = least.color.cwiseMin(look.color);
      most.color = most.color.cwiseMax(look.color);
      least.by_sight = least.by_sight.cwiseMin(look.by_sight);
      most.by_sight = most.by_sight.cwiseMax(look.by_sight);
    }
    const double opacity = opacity_of(most.density, edge);
    const double color = static_cast<double>((most.color - least.color).maxCoeff() +
                                             (most.by_sight - least.by_sight).maxCoeff());
    return opacity - opacity_of(least.density, edge) <= options_.max_error &&
           color * opacity <= options_.max_error;
  }

  /// Merges the kernels of a block, which lie in rows, as long as eight of them look alike and have
  /// room.
  void merge(const std::array<std::size_t, 3>& first, const std::array<std::size_t, 3>& size,
             std::vector<Kernel>& kernels) const {
    std::array<std::size_t, 3> cells = size;
    std::vector<Kernel> done;
    std::vector<Kernel> grid = std::move(kernels);
    for (std::size_t edge = 1; edge < kBlock; edge *= 2) {
      std::array<std::size_t, 3> halves;
      for (std::size_t k = 0; k < 3; ++k) halves[k] = cells[k] / 2;
      std::vector<Kernel> coarse(halves[0] * halves[1] * halves[2]);
      const auto index = [&](std::size_t x, std::size_t y, std::size_t z) {
        return (z * cells[1] + y) * cells[0] + x;
      };
      for (std::size_t z = 0; z < halves[2]; ++z) {
        for (std::size_t y = 0; y < halves[1]; ++y) {
          for (std::size_t x = 0; x < halves[0]; ++x) {
            std::array<Kernel*, 8> child;
            bool all = true;
            for (std::size_t k = 0; k < 8; ++k) {
              child[k] = &grid[index(2 * x + (k & 1), 2 * y + (k >> 1 & 1), 2 * z + (k >> 2))];
              all = all && child[k]->edge == edge;
            }
            Kernel& parent = coarse[(z * halves[1] + y) * halves[0] + x];
            parent.edge = 0;
            if (!all || !alike(child)) continue;
            const std::size_t wide = 2 * edge;
            if (!has_room({first[0] + wide * x, first[1] + wide * y, first[2] + wide * z}, wide)) {
              continue;
            }
            parent = mean(child);
            for (Kernel* kernel : child) kernel->edge = 0;
          }
        }
      }
      for (const Kernel& kernel : grid) {
        if (kernel.edge > 0) done.push_back(kernel);
      }
      grid = std::move(coarse);
      cells = halves;
    }
    for (const Kernel& kernel : grid) {
      if (kernel.edge > 0) done.push_back(kernel);
    }
    kernels = std::move(done);
  }

  static Kernel mean(const std::array<Kernel*, 8>& child) {
    Kernel out{Vec3f(0, 0, 0), static_cast<std::uint8_t>(2 * child[0]->edge),
               Look::of(0, Vec3f(0, 0, 0))};
    double weight = 0;
    for (const Kernel* kernel : child) {
      out.position += kernel->position / 8;
      out.look.density += kernel->look.density / 8;
      const double w = kernel->look.density;
      weight += w;
      out.look.color += kernel->look.color * static_cast<float>(w);
      out.look.by_sight += kernel->look.by_sight * static_cast<float>(w);
    }
    if (weight > 0) {
      out.look.color /= static_cast<float>(weight);
      out.look.by_sight /= static_cast<float>(weight);
    }
    return out;
  }

  GaussianCloud joined(const std::vector<Part>& part, GaussiansOfVolumeReport& report) const {
    std::size_t count = 0;
    for (const Part& p : part) {
      count += p.kernel.size();
      report.voxels += p.voxels;
      report.empty += p.empty;
      report.merged += p.merged;
    }
    GaussianCloud cloud;
    cloud.rule = AmplitudeRule::kDensity;
    cloud.up = volume_.up;
    cloud.degree = options_.shading > 0 ? 1 : 0;
    Vec3d last;
    for (int k = 0; k < 3; ++k) {
      last[k] = static_cast<double>(volume_.size[static_cast<std::size_t>(k)] - 1);
    }
    cloud.origin = volume_.world(last / 2);
    cloud.resize(count);
    std::size_t i = 0;
    for (const Part& p : part) {
      for (const Kernel& kernel : p.kernel) {
        cloud.position[i] =
            (volume_.world(kernel.position.cast<double>()) - cloud.origin).cast<float>();
        shape(kernel, cloud, i);
        put_color(kernel.look, cloud.harmonics.data() + i * cloud.harmonics_stride());
        ++i;
      }
    }
    return cloud;
  }

  /// Gives Gaussian i its scales, rotation and density: its mass is a voxel's, or a block's.
  void shape(const Kernel& kernel, GaussianCloud& cloud, std::size_t i) const {
    const double variance = portable::squared(options_.deviation);
    const double thin = variance - static_cast<double>(kernel.thinner);
    Eigen::Matrix3d axes;
    Vec3d scale;
    if (kernel.thinner == 0) {
      for (int k = 0; k < 3; ++k) {
        scale[k] = options_.deviation * kernel.edge * edge_[static_cast<std::size_t>(k)];
        axes.col(k) = volume_.step[static_cast<std::size_t>(k)].normalized();
      }
    } else {
      Eigen::Matrix3d world;
      for (int k = 0; k < 3; ++k) world.col(k) = volume_.step[static_cast<std::size_t>(k)];
      const Vec3d across = kernel.across.cast<double>();
      const Eigen::Matrix3d covariance =
          world *
          (variance * Eigen::Matrix3d::Identity() -
           static_cast<double>(kernel.thinner) * across * across.transpose()) *
          world.transpose();
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
      axes = solver.eigenvectors();
      scale = solver.eigenvalues().cwiseMax(0).cwiseSqrt();
    }
    // A Gaussian does not tell an axis from its opposite.
    if (axes.determinant() < 0) axes.col(2) = -axes.col(2);
    const Quaternion q(axes);
    cloud.rotation[i] = {static_cast<float>(q.w()), static_cast<float>(q.x()),
                         static_cast<float>(q.y()), static_cast<float>(q.z())};
    cloud.scale[i] = scale.cast<float>();
    cloud.amplitude[i] =
        static_cast<float>(peak_ * kernel.look.density * std::sqrt(variance / thin));
  }

  /// Spherical harmonics, whose direction goes from the eye, of a colour that depends on the sight,
  /// which goes to the eye.
  void put_color(const Look& look, float* harmonics) const {
    for (int c = 0; c < 3; ++c) {
      harmonics[c] = static_cast<float>((static_cast<double>(look.color[c]) - 0.5) /
                                        GaussianCloud::kHarmonic0);
      if (options_.shading == 0) continue;
      const auto scale = static_cast<float>(1 / kHarmonic1);
      harmonics[3 + c] = look.by_sight(c, 1) * scale;
      harmonics[6 + c] = -look.by_sight(c, 2) * scale;
      harmonics[9 + c] = look.by_sight(c, 0) * scale;
    }
  }

  const Volume& volume_;
  const TransferFunction& function_;
  const GaussiansOfVolumeOptions& options_;
  std::array<double, 3> edge_;
  double mean_edge_;
  double range_;
  double peak_;
};

}  // namespace

std::vector<std::string> GaussiansOfVolumeOptions::problems() const {
  std::vector<std::string> out;
  if (!(deviation >= 0.4 && deviation <= 2)) out.emplace_back("`deviation` must be in 0.4..2");
  if (!(max_error >= 0 && max_error <= 1)) out.emplace_back("`max_error` must be in 0..1");
  if (!(least_depth >= 0)) out.emplace_back("`least_depth` must be 0 or more");
  if (!(shading >= 0 && shading <= 1)) out.emplace_back("`shading` must be in 0..1");
  if (!(density > 0) || !std::isfinite(density)) out.emplace_back("`density` must be above 0");
  return out;
}

std::string likely_transfer_function(const Volume& volume) {
  constexpr float kLikelyAir = -500;
  const float least = *std::min_element(volume.value.begin(), volume.value.end());
  return least < kLikelyAir ? "ct" : "mr";
}

double shading_weight(double gradient, double range, double edge) {
  constexpr double kNoise = 0.02;  // Of the range, over a voxel: what noise makes.
  const double change = gradient * edge / (kNoise * range);
  return change * change / (1 + change * change);
}

GaussianCloud gaussians_of_volume(const Volume& volume, const TransferFunction& function,
                                  const std::string& name, const GaussiansOfVolumeOptions& options,
                                  GaussiansOfVolumeReport* report) {
  const std::vector<std::string> problems = options.problems();
  if (!problems.empty()) throw_usage(problems.front());
  GaussiansOfVolumeReport done;
  GaussianCloud cloud = Builder(volume, function, options).run(done);
  if (report) *report = done;
  if (cloud.size() == 0) {
    throw_input(name,
                "no voxel can be seen: the transfer function gives all of them a density of "
                "0; surfel-info tells the range of the values");
  }
  return cloud;
}

}  // namespace surfel
