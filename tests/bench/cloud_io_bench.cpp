// Reading and writing binary PLY from and to the page cache. The measures are `cat FILE >
// /dev/null` for reading, which should take no more than five times as long, and no more than three
// times where surfels in space-filling order are made ready for rendering; `cp` for writing.

#include <array>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <surfel/base/morton.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/store/cloud_loader.h>
#include <unistd.h>

namespace surfel {
namespace {

/// 44 bytes a surfel as files hold it: position, normal, variance, radius, area, 8-bit colour and
/// alpha.
SurfelCloud everyday_cloud(std::size_t count) {
  SurfelCloud cloud;
  cloud.position.resize(count);
  cloud.normal.assign(count, Vec3f(0, 0.6f, 0.8f));
  cloud.variance.assign(count, 1e-4f);
  cloud.area.assign(count, 1e-4f);
  cloud.color.resize(count);
  cloud.alpha.assign(count, 1.0f);
  cloud.alpha_as_uint8 = true;
  for (std::size_t i = 0; i < count; ++i) {
    const auto x = static_cast<float>(i % 1000) / 1000;
    cloud.position[i] = Vec3f(x, x * x, 1 - x);
    cloud.color[i] = cloud.position[i];
  }
  return cloud;
}

/// A file of that many surfels, made once and removed at exit.
class BenchFile {
 public:
  explicit BenchFile(std::size_t count, bool in_order = false) {
    std::string pattern = (std::filesystem::temp_directory_path() / "surfel-bench-XXXXXX").string();
    if (!mkdtemp(pattern.data())) throw std::runtime_error("no temporary folder");
    folder_ = pattern;
    SurfelCloud cloud = everyday_cloud(count);
    if (in_order) cloud = cloud.gathered(morton_order(cloud.position));
    write_cloud(cloud, path());
  }
  ~BenchFile() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  BenchFile(const BenchFile&) = delete;
  BenchFile& operator=(const BenchFile&) = delete;
  std::string path() const { return (folder_ / "cloud.ply").string(); }
  auto size() const { return static_cast<std::int64_t>(std::filesystem::file_size(path())); }

 private:
  std::filesystem::path folder_;
};

/// What cat does with standard output at /dev/null.
void cat(benchmark::State& state) {
  const BenchFile file(static_cast<std::size_t>(state.range(0)));
  const std::string command = "cat " + file.path() + " > /dev/null";
  for (auto _ : state) {
    if (std::system(command.c_str()) != 0) state.SkipWithError("cat failed");
  }
  state.SetBytesProcessed(state.iterations() * file.size());
}

void read(benchmark::State& state) {
  const BenchFile file(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(read_cloud(file.path()));
  state.SetBytesProcessed(state.iterations() * file.size());
}

void write(benchmark::State& state) {
  const SurfelCloud cloud = everyday_cloud(static_cast<std::size_t>(state.range(0)));
  const BenchFile file(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) write_cloud(cloud, file.path());
  state.SetBytesProcessed(state.iterations() * file.size());
}

void make_ready(benchmark::State& state, bool in_order) {
  const BenchFile file(static_cast<std::size_t>(state.range(0)), in_order);
  for (auto _ : state) {
    const LoadedCloud loaded(file.path(), {});
    benchmark::DoNotOptimize(loaded.surfels().clusters().data());
  }
  state.SetBytesProcessed(state.iterations() * file.size());
}
void ready_to_render(benchmark::State& state) { make_ready(state, true); }
void ready_to_render_unsorted(benchmark::State& state) { make_ready(state, false); }

void cp(benchmark::State& state) {
  const BenchFile file(static_cast<std::size_t>(state.range(0)));
  const std::string command = "cp --reflink=never " + file.path() + " " + file.path() + ".copy";
  for (auto _ : state) {
    if (std::system(command.c_str()) != 0) state.SkipWithError("cp failed");
  }
  state.SetBytesProcessed(state.iterations() * file.size());
}

BENCHMARK(cat)->Arg(5'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(read)->Arg(5'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(ready_to_render)->Arg(5'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(ready_to_render_unsorted)->Arg(5'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(cp)->Arg(5'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(write)->Arg(5'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace surfel
