// Surfels from a program's own data, a sphere of many colours, to a file:  write OUT.ply
#include <cmath>
#include <cstdio>
#include <numbers>

#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/scene/surfel_cloud.h>

int main(int argc, char** argv) try {
  if (argc != 2) return 2;
  constexpr int kCount = 20000;
  surfel::SurfelCloud cloud;
  for (int i = 0; i < kCount; ++i) {
    // A spiral from pole to pole spreads the points evenly.
    const double y = 1 - (2 * i + 1.0) / kCount;
    const double angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - y * y);
    const surfel::Vec3d p(r * std::cos(angle), y, r * std::sin(angle));
    cloud.position.push_back(p.cast<float>());
    cloud.normal.push_back(p.cast<float>());
    cloud.color.emplace_back(((p.array() + 1) / 2).cast<float>());  // Linear light.
  }
  const auto area = static_cast<float>(4 * std::numbers::pi / kCount);
  cloud.area.assign(kCount, area);             // Surface that each point stands for.
  cloud.variance.assign(kCount, 0.5F * area);  // Standard deviation: 0.7 spacings.
  cloud.provenance.emplace_back("write");
  surfel::write_cloud(cloud, argv[1]);
  std::printf("%zu surfels\n", cloud.size());
} catch (const surfel::Error& error) {
  std::fprintf(stderr, "write: error: %s\n", error.what());
  return 1;
}
