// A frame of trained-like Gaussians at 1920 x 1080, by every profile, and beside it a plain loop
// (bench/gaussian_loop.h) that draws what the profile inria does. `dB` says how alike the two are.

#include <cmath>
#include <map>

#include <benchmark/benchmark.h>
#include <surfel/gaussian/gaussian_renderer.h>

#include "bench/gaussian_loop.h"
#include "bench/gaussian_scene.h"

namespace surfel {
namespace {

constexpr int kWidth = 1920;
constexpr int kHeight = 1080;

const GaussianCloud& cloud_of(std::int64_t count) {
  static std::map<std::int64_t, GaussianCloud> made;
  const auto found = made.find(count);
  if (found != made.end()) return found->second;
  return made.emplace(count, bench::trained_like(static_cast<std::size_t>(count))).first->second;
}

template <GaussianProfile kProfile>
void frame(benchmark::State& state) {
  GaussianRenderer renderer(cloud_of(state.range(0)), {.profile = kProfile});
  const Camera camera = bench::walking_camera(kWidth, kHeight);
  for (auto _ : state) benchmark::DoNotOptimize(renderer.render(camera).data.data());
}

void plain_loop(benchmark::State& state) {
  const GaussianCloud& cloud = cloud_of(state.range(0));
  const Camera camera = bench::walking_camera(kWidth, kHeight);
  bench::GaussianLoop loop(cloud);
  for (auto _ : state) benchmark::DoNotOptimize(loop.render(camera).data());
  const Image ours =
      GaussianRenderer(cloud, {.profile = GaussianProfile::kInria, .display = true}).render(camera);
  const std::vector<float>& theirs = loop.render(camera);
  double sum = 0;
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    const double d = theirs[i] - ours.data[i / 3 * 4 + i % 3];
    sum += d * d;
  }
  state.counters["dB"] = -10 * std::log10(sum / static_cast<double>(theirs.size()));
}

#define SURFEL_GAUSSIAN_BENCH(work) \
  BENCHMARK(work)->Unit(benchmark::kMillisecond)->UseRealTime()->Arg(500000)
SURFEL_GAUSSIAN_BENCH(frame<GaussianProfile::kInria>)->Arg(5000000);
SURFEL_GAUSSIAN_BENCH(frame<GaussianProfile::kGsplat>);
SURFEL_GAUSSIAN_BENCH(frame<GaussianProfile::kMip>);
SURFEL_GAUSSIAN_BENCH(frame<GaussianProfile::k2dgs>);
SURFEL_GAUSSIAN_BENCH(frame<GaussianProfile::kExact>);
SURFEL_GAUSSIAN_BENCH(plain_loop);

}  // namespace
}  // namespace surfel
