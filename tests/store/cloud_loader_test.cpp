// From files to pictures without a cloud in between, and piece by piece.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <type_traits>
#include <utility>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/scene.h>
#include <surfel/sp06/methods.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/store/cloud_stream.h>
#include <surfel/store/record_source.h>

#include "support/memory_file.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel {
namespace {

using test::TemporaryFolder;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

SurfelCloud ordered(const std::string& kind, std::size_t count) {
  const SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), {.count = count});
  return cloud.gathered(morton_order(cloud.position));
}

std::vector<const Array<float>*> columns(const RenderCloud& c) {
  return {&c.x,         &c.y,         &c.z,         &c.normal_x,    &c.normal_y,     &c.normal_z,
          &c.tangent_x, &c.tangent_y, &c.tangent_z, &c.deviation_u, &c.deviation_v,  &c.area,
          &c.red,       &c.green,     &c.blue,      &c.alpha,       &c.group_radius, &c.shading_x,
          &c.shading_y, &c.shading_z};
}

/// Bit for bit.
void expect_equal(const RenderCloud& a, const RenderCloud& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.origin(), b.origin());
  EXPECT_EQ(a.dropped().position, b.dropped().position);
  EXPECT_EQ(a.dropped().variance, b.dropped().variance);
  EXPECT_EQ(a.dropped().color, b.dropped().color);
  EXPECT_EQ(a.groups(), b.groups());
  EXPECT_EQ(a.copies(), b.copies());
  EXPECT_EQ(a.tree().size(), b.tree().size());
  EXPECT_EQ(a.first_finest(), b.first_finest());
  EXPECT_EQ(a.mean_deviation(), b.mean_deviation());
  EXPECT_TRUE(a.material == b.material);
  EXPECT_TRUE(a.group == b.group);
  const auto of_a = columns(a);
  const auto of_b = columns(b);
  for (std::size_t k = 0; k < of_a.size(); ++k) {
    ASSERT_EQ(of_a[k]->size(), of_b[k]->size()) << "column " << k;
    if (of_a[k]->empty()) continue;  // memcmp() takes no null pointers.
    EXPECT_EQ(std::memcmp(of_a[k]->data(), of_b[k]->data(), of_a[k]->size() * sizeof(float)), 0)
        << "column " << k;
  }
  ASSERT_EQ(a.clusters().size(), b.clusters().size());
  for (std::size_t i = 0; i < a.clusters().size(); ++i) {
    EXPECT_EQ(a.clusters()[i].center, b.clusters()[i].center);
    EXPECT_EQ(a.clusters()[i].radius, b.clusters()[i].radius);
    EXPECT_EQ(a.clusters()[i].cone_cosine, b.clusters()[i].cone_cosine);
    EXPECT_EQ(a.clusters()[i].half_extent, b.clusters()[i].half_extent);
    EXPECT_EQ(a.clusters()[i].max_group_radius, b.clusters()[i].max_group_radius);
  }
}

/// What the file gives by both ways.
void expect_same_as_read_cloud(const SurfelCloud& cloud, const RenderColumns& needed = {}) {
  const TemporaryFolder folder;
  const std::string path = folder / "cloud.ply";
  write_cloud(cloud, path);
  const LoadedCloud loaded(path, {.columns = needed, .may_stream = false});
  EXPECT_TRUE(loaded.store().resident());
  expect_equal(loaded.surfels(), RenderCloud(read_cloud(path, {.levels = true}), needed));
  EXPECT_EQ(loaded.has_levels(), !cloud.tree.empty());
}

SurfelCloud with_every_column() {
  SurfelCloud cloud = ordered("head", 3000);
  const std::size_t n = cloud.size();
  cloud.tangent = cloud.dpdu;
  cloud.variance_u = cloud.variance;
  cloud.variance_v.assign(n, 2e-4F);
  cloud.alpha.resize(n);
  cloud.material.resize(n);
  cloud.group.resize(n);
  cloud.group_radius.assign(n, 0.02F);
  for (std::size_t i = 0; i < n; ++i) {
    cloud.alpha[i] = static_cast<float>(i % 7) / 6;
    cloud.material[i] = static_cast<std::uint16_t>(i % 3);
    cloud.group[i] = static_cast<std::uint16_t>(5 * (i % 4));
    // Lengths of means, lengths that no mean has, and none.
    cloud.shading_normal.push_back(cloud.normal[i] * (0.4F * static_cast<float>(i % 4)));
    cloud.normal[i] *= static_cast<float>(1 + i % 2);
  }
  return cloud;
}

TEST(LoadedCloud, IsWhatReadCloudGives) {
  expect_same_as_read_cloud(ordered("terrain", 5000));
  const SurfelCloud all = with_every_column();
  expect_same_as_read_cloud(all, {.groups = true, .group_radius = true});
  SurfelCloud eight_bits = all;
  eight_bits.alpha_as_uint8 = true;
  eight_bits.coefficient = eight_bits.color;
  expect_same_as_read_cloud(eight_bits);
  for (const ColorEncoding encoding : {ColorEncoding::kUint16Srgb, ColorEncoding::kFloatLinear}) {
    SurfelCloud other = all;
    other.color_encoding = encoding;
    expect_same_as_read_cloud(other);
  }
  SurfelCloud bare;
  bare.position = all.position;
  bare.variance = all.variance;
  expect_same_as_read_cloud(bare);
}

TEST(LoadedCloud, TakesSurfelsInAnyOrder) {
  SurfelCloud cloud = ordered("torus", 4000);
  std::reverse(cloud.position.begin(), cloud.position.end());
  expect_same_as_read_cloud(cloud);
}

TEST(LoadedCloud, MovesFarAwayScenesToTheirOrigin) {
  SurfelCloud cloud = ordered("plane", 3000);
  for (const double far : {1e3, 1e7}) {
    cloud.origin = Vec3d(far, 0, -far);
    for (const bool wide : {false, true}) {
      cloud.double_positions = wide;
      expect_same_as_read_cloud(cloud);
    }
  }
}

TEST(LoadedCloud, LeavesOutCopies) {
  SurfelCloud cloud = ordered("sphere", 1000);
  Array<std::uint32_t> order(1200);
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i < 1000 ? i : 3 * (i - 1000);
  cloud = cloud.gathered(order);
  cloud.source = order;
  expect_same_as_read_cloud(cloud);
  expect_same_as_read_cloud(cloud, {.copies = true});
  EXPECT_EQ(RenderCloud(cloud).copies(), 200U);
}

TEST(LoadedCloud, KeepsLevelsOfDetail) {
  const SurfelCloud levels = build_hierarchy(ordered("torus", 3000), {});
  ASSERT_FALSE(levels.tree.empty());
  expect_same_as_read_cloud(levels);
  expect_same_as_read_cloud(levels, {.levels = true});
}

TEST(LoadedCloud, LeavesOutWhatCannotBeDrawn) {
  SurfelCloud cloud = ordered("sphere", 2000);
  cloud.alpha.assign(cloud.size(), 0.5F);
  cloud.color_encoding = ColorEncoding::kFloatLinear;
  cloud.position[3].x() = kNan;
  cloud.position[300].y() = kInfinity;
  cloud.variance[700] = -1;
  cloud.variance[701] = kNan;
  cloud.variance[702] = 0;
  cloud.color[900].z() = kInfinity;
  cloud.alpha[901] = kInfinity;
  cloud.area[902] = -kInfinity;
  cloud.normal[1000] = Vec3f(kNan, 0, 0);
  expect_same_as_read_cloud(cloud);
  RenderCloud surfels(cloud);
  EXPECT_EQ(surfels.dropped().position, 2U);
  EXPECT_EQ(surfels.dropped().variance, 3U);
  EXPECT_EQ(surfels.dropped().color, 3U);
}

TEST(LoadedCloud, ReadsWhatIsNotDecodedDirectly) {
  const TemporaryFolder folder;
  const SurfelCloud cloud = ordered("sphere", 500);
  write_cloud(cloud, folder / "text.ply", {.ascii = true});
  expect_equal(LoadedCloud(folder / "text.ply", {}).surfels(),
               RenderCloud(read_cloud(folder / "text.ply")));
  // Radius alone, in a type of its own.
  const test::MemoryFile doubles(
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nproperty double radius\nend_header\n" +
      std::string(12, '\0') + std::string("\0\0\0\0\0\0\0\x40", 8));
  EXPECT_FLOAT_EQ(LoadedCloud(doubles.path(), {}).surfels().deviation_u[0], std::sqrt(2.0F));
}

TEST(LoadedCloud, RefusesFilesWithoutAnyUsableSurfel) {
  const TemporaryFolder folder;
  SurfelCloud cloud = ordered("sphere", 3);
  cloud.position.assign(3, Vec3f::Constant(kNan));
  const auto expect_refused = [&](int visible, bool ascii) {
    write_cloud(cloud, folder / "nan.ply", {.ascii = ascii});
    const std::string message = fmt::format(
        "none of the {} visible surfels can be used: {} with positions", visible, visible);
    try {
      LoadedCloud(folder / "nan.ply", {});
      ADD_FAILURE() << "not refused";
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(message), std::string::npos) << e.what();
    }
  };
  for (const bool ascii : {false, true}) expect_refused(3, ascii);
  // Two invisible surfels elsewhere are no picture either.
  cloud.position[1] = cloud.position[2] = Vec3f::Zero();
  cloud.alpha = {1, 0, 0};
  for (const bool ascii : {false, true}) expect_refused(1, ascii);
}

/// Every prefix of a file is refused with its name, or complete.
TEST(LoadedCloud, RefusesTruncatedFiles) {
  const TemporaryFolder folder;
  write_cloud(ordered("plane", 10), folder / "cloud.ply");
  const std::string bytes = test::read_text(folder / "cloud.ply");
  for (std::size_t size = 0; size < bytes.size(); size += 7) {
    const test::MemoryFile cut(bytes.substr(0, size));
    EXPECT_THROW(LoadedCloud(cut.path(), {}), Error) << size;
  }
}

Image picture(Renderer&& renderer, const Camera& camera) { return renderer.render(camera); }

constexpr std::uint64_t kLittle = std::uint64_t{12} << 20;  ///< Bytes of memory.

class StreamedCloud : public testing::Test {
 protected:
  static constexpr std::size_t kCount = 200'000;  ///< More than fit into it.

  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    cloud_ = new SurfelCloud(ordered("head", kCount));
    write_cloud(*cloud_, path());
  }
  static void TearDownTestSuite() {
    delete cloud_;
    delete folder_;
  }
  static std::string path() { return *folder_ / "cloud.ply"; }

  static TemporaryFolder* folder_;
  static SurfelCloud* cloud_;
};
TemporaryFolder* StreamedCloud::folder_ = nullptr;
SurfelCloud* StreamedCloud::cloud_ = nullptr;

/// Root of the mean square of the differences.
double difference(const Image& a, const Image& b) {
  double squares = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) squares += std::pow(a.data[i] - b.data[i], 2);
  return std::sqrt(squares / static_cast<double>(a.data.size()));
}

Camera camera_of(const RenderCloud& cloud) {
  CameraOptions view;
  view.width = 100;
  view.height = 90;
  return make_camera(view, cloud.extent());
}

void expect_same_extent(const SceneExtent& a, const SceneExtent& b) {
  EXPECT_EQ(a.box.min, b.box.min);
  EXPECT_EQ(a.box.max, b.box.max);
  for (const Vec3d& along : {Vec3d(1, 2, -3), Vec3d(-2, 0, 0.5), Vec3d(0.1, -1, 1)}) {
    for (const double outward : {0.0, 1.5, 40.0}) {
      EXPECT_EQ(a.support(along, outward), b.support(along, outward)) << along.transpose();
    }
  }
}

/// The support function is the greatest over the surfels, in whatever order they come.
TEST_F(StreamedCloud, ReachesAsFarAsItsSurfels) {
  Array<std::uint32_t> order(cloud_->size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(),
            [](std::uint32_t a, std::uint32_t b) { return random_bits(3, a) < random_bits(3, b); });
  RenderCloud surfels(*cloud_);
  RenderCloud shuffled(cloud_->gathered(order));
  expect_same_extent(surfels.extent(), shuffled.extent());
  for (const Vec3d& along : {Vec3d(1, 2, -3), Vec3d(0, -1, 0)}) {
    for (const double outward : {0.0, 2.5}) {
      double greatest = -std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < cloud_->size(); ++i) {
        greatest = std::max(greatest,
                            along.dot(cloud_->world(i)) + outward * std::sqrt(cloud_->variance[i]));
      }
      EXPECT_NEAR(surfels.extent().support(along, outward), greatest, 1e-6);
    }
  }
}

/// A stream of one batch, in bands or not, gives the same bytes as memory does.
TEST_F(StreamedCloud, GivesTheSamePictureAsMemory) {
  CloudSource source(*cloud_, "");
  RenderCloud whole(*cloud_);
  const Scene scene;
  RenderOptions options;
  options.aovs = true;
  const Camera camera = camera_of(whole);
  const Image expected = picture(Renderer(whole, scene, options), camera);
  for (const std::size_t picture_bytes : {std::size_t{1} << 30, std::size_t{1}}) {
    const auto stream =
        CloudStream::make(source, {.batch = kCount, .picture_bytes = picture_bytes});
    ASSERT_NE(stream, nullptr);
    EXPECT_TRUE(picture(Renderer(*stream, scene, options), camera).data == expected.data);
  }
}

/// Several batches merge fragments in another order, but alike on any number of threads.
TEST_F(StreamedCloud, DrawsBatchByBatch) {
  const LoadedCloud streamed(path(), {.memory = kLittle});
  ASSERT_FALSE(streamed.store().resident());
  EXPECT_LT(streamed.store().batch_clusters() * RenderCloud::kClusterSize, kCount / 8);
  const LoadedCloud whole(path(), {});
  ASSERT_TRUE(whole.store().resident());
  EXPECT_EQ(streamed.surfels().size(), kCount);
  EXPECT_EQ(streamed.surfels().mean_deviation(), whole.surfels().mean_deviation());
  expect_same_extent(streamed.surfels().extent(), whole.surfels().extent());
  EXPECT_LT(streamed.surfels().memory_bytes(), whole.surfels().memory_bytes() / 4);

  const Scene scene;
  Renderer renderer(streamed.store(), scene, {});
  const Camera camera = camera_of(whole.surfels());
  FrameStatistics statistics;
  const Image image = renderer.render(camera, &statistics);
  EXPECT_EQ(statistics.stages.stages()[1].first, "read");
  EXPECT_GT(statistics.splats, kCount / 2);
  EXPECT_LT(difference(image, picture(Renderer(whole.store(), scene, {}), camera)), 0.01);
  for (const int threads : {1, 3}) {
    set_thread_count(threads);
    EXPECT_TRUE(renderer.render(camera).data == image.data) << threads;
  }
  set_thread_count(0);
}

void expect_same_sample(const SurfaceSample& a, const SurfaceSample& b) {
  EXPECT_EQ(a.origin, b.origin);
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    ASSERT_EQ(a.points[i].position, b.points[i].position) << i;
    ASSERT_EQ(a.points[i].normal, b.points[i].normal) << i;
    ASSERT_EQ(a.points[i].area, b.points[i].area) << i;
  }
}

/// Views that are guessed must not depend on the memory that there is.
TEST_F(StreamedCloud, IsSampledAsInMemory) {
  SurfelCloud flawed = *cloud_;
  for (std::size_t i = 0; i < kCount; i += 1000) flawed.variance[i] = kNan;
  flawed.viewpoint = Viewpoint{Vec3d(1, 2, 3), Eigen::Vector4d(0, 1, 0, 0)};
  flawed.up = Vec3d(0, 0, 1);
  const TemporaryFolder folder;
  const auto samples = [&](const SurfelCloud& cloud, bool levels) {
    write_cloud(cloud, folder / "cloud.ply");
    write_cloud(cloud, folder / "cloud.txt.ply", {.ascii = true});
    const LoadedCloud whole(folder / "cloud.ply",
                            {.columns = {.levels = levels}, .may_stream = false, .sample = true});
    const LoadedCloud streamed(folder / "cloud.ply",
                               {.columns = {.levels = levels}, .memory = kLittle, .sample = true});
    const LoadedCloud text(folder / "cloud.txt.ply",
                           {.columns = {.levels = levels}, .sample = true});
    ASSERT_TRUE(whole.store().resident());
    ASSERT_FALSE(streamed.store().resident());
    EXPECT_GT(whole.sample().points.size(), SurfaceSampler::kPoints / 2);
    EXPECT_LT(whole.sample().points.size(), 2 * SurfaceSampler::kPoints);
    expect_same_sample(whole.sample(), streamed.sample());
    expect_same_sample(whole.sample(), text.sample());
    EXPECT_EQ(streamed.up(), cloud.up);
    ASSERT_TRUE(text.viewpoint());
    EXPECT_EQ(text.viewpoint()->position, Vec3d(1, 2, 3));
  };
  samples(flawed, false);
  SurfelCloud sound = *cloud_;
  sound.viewpoint = flawed.viewpoint;
  const SurfelCloud levels = build_hierarchy(sound, {});
  samples(levels, true);
  samples(levels, false);
  EXPECT_TRUE(LoadedCloud(folder / "cloud.ply", {}).sample().points.empty());
}

TEST_F(StreamedCloud, LeavesOutWhatCannotBeDrawn) {
  SurfelCloud flawed = *cloud_;
  flawed.origin = Vec3d(1e6, 0, 0);
  for (std::size_t i = 0; i < kCount; i += 1000) flawed.variance[i] = kNan;
  for (std::size_t i = 512; i < 768; ++i) flawed.position[i].x() = kNan;  // A whole cluster.
  const TemporaryFolder folder;
  write_cloud(flawed, folder / "flawed.ply");
  const LoadedCloud streamed(folder / "flawed.ply", {.memory = kLittle});
  ASSERT_FALSE(streamed.store().resident());
  RenderCloud whole(flawed);
  EXPECT_EQ(streamed.surfels().size(), whole.size());
  EXPECT_EQ(streamed.surfels().dropped().position, whole.dropped().position);
  EXPECT_EQ(streamed.surfels().dropped().variance, whole.dropped().variance);

  const Scene scene;
  const Camera camera = camera_of(whole);
  // Clusters are others, so that merged fragments may differ.
  EXPECT_LT(difference(picture(Renderer(streamed.store(), scene, {}), camera),
                       picture(Renderer(whole, scene, {}), camera)),
            0.01);
}

// Sources and decoders keep references to clouds and tables.
static_assert(std::is_constructible_v<CloudSource, const SurfelCloud&, std::string>);
static_assert(!std::is_constructible_v<CloudSource, SurfelCloud, std::string>);
static_assert(std::is_constructible_v<RecordSource, const RecordTable&, std::string>);
static_assert(!std::is_constructible_v<RecordSource, RecordTable, std::string>);
static_assert(std::is_constructible_v<SurfelDecoder, const RecordTable&, std::string>);
static_assert(!std::is_constructible_v<SurfelDecoder, RecordTable, std::string>);
template <class Source>
concept Streamable = requires(Source&& source, CloudStreamOptions options) {
  CloudStream::make(std::forward<Source>(source), options);
};
static_assert(Streamable<CloudSource&> && !Streamable<CloudSource>);
template <class Cloud>
concept HasExtent = requires(Cloud&& cloud) {
  std::forward<Cloud>(cloud).extent();
};
static_assert(HasExtent<const RenderCloud&> && !HasExtent<RenderCloud>);

TEST_F(StreamedCloud, BatchIsCheckedWhetherOrNotTheFileIsStreamed) {
  EXPECT_TRUE(CloudLoadOptions{}.problems().empty());
  EXPECT_EQ(CloudLoadOptions{.batch = 255}.problems(),
            std::vector<std::string>{"`batch` is 255; it must be >= 256"});
  for (const auto memory : {std::optional<std::uint64_t>{}, std::optional{kLittle}}) {
    try {
      const LoadedCloud loaded(path(), {.memory = memory, .batch = 255});
      FAIL() << "not refused";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kUsage);
      EXPECT_NE(std::string(error.what()).find("`batch` is 255"), std::string::npos);
    }
  }
}

TEST_F(StreamedCloud, IsOnlyMadeWhereItWorks) {
  const auto message = [](const std::string& file, const CloudLoadOptions& options) {
    try {
      const LoadedCloud loaded(file, options);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  EXPECT_NE(message(path(), {.memory = 1000}).find("give 11 MB at least"), std::string::npos);
  EXPECT_NE(message(path(), {.memory = kLittle, .may_stream = false}).find("`method` abuffer"),
            std::string::npos);
  const LoadedCloud streamed(path(), {.memory = kLittle});
  const Scene scene;
  RenderOptions peeled;
  peeled.method = compositing_method(Method::kDepthPeel);
  EXPECT_THROW(Renderer(streamed.store(), scene, peeled), Error);

  const TemporaryFolder folder;
  SurfelCloud copies = *cloud_;
  copies.source.assign(kCount, 1);
  write_cloud(copies, folder / "copies.ply");
  EXPECT_NE(message(folder / "copies.ply", {.memory = kLittle}).find("copies of splats"),
            std::string::npos);
  SurfelCloud mixed = *cloud_;
  for (std::size_t i = 0; i < kCount; ++i) mixed.position[i] = cloud_->position[i * 7919 % kCount];
  write_cloud(mixed, folder / "mixed.ply");
  EXPECT_NE(message(folder / "mixed.ply", {.memory = kLittle}).find("close together"),
            std::string::npos);
  EXPECT_EQ(message(folder / "mixed.ply", {}), "none");
}

/// Levels of detail stay in their file.
class StreamedLevels : public testing::Test {
 protected:
  void SetUp() override {
    cloud_ = ordered("head", kCount);
    paint_alpha(1);
  }
  /// Of every third surfel.
  void paint_alpha(float alpha) {
    cloud_.alpha.assign(cloud_.size(), 1.0F);
    for (std::size_t i = 0; i < cloud_.size(); i += 3) cloud_.alpha[i] = alpha;
  }
  std::string write() const {
    const std::string path = folder_ / "levels.ply";
    write_cloud(build_hierarchy(cloud_, {}), path);
    return path;
  }
  static Camera view(const RenderCloud& cloud, double zoom) {
    CameraOptions options;
    options.width = 120;
    options.height = 100;
    options.zoom = zoom;
    return make_camera(options, cloud.extent());
  }

  static constexpr std::size_t kCount = 60'000;
  TemporaryFolder folder_;
  SurfelCloud cloud_;
};

/// From far away, near by and again, so that clusters come and go, and some stay.
TEST_F(StreamedLevels, GiveTheSamePicturesAsMemory) {
  const Scene scene;
  const RenderColumns levels{.levels = true};
  for (const float alpha : {1.0F, 0.5F}) {
    for (const double far : {0.0, 1e7}) {
      paint_alpha(alpha);
      cloud_.origin = Vec3d(far, 0, -far);
      cloud_.double_positions = far > 0;
      const std::string path = write();
      const LoadedCloud streamed(path, {.columns = levels});
      const LoadedCloud whole(path, {.columns = levels, .may_stream = false});
      ASSERT_FALSE(streamed.store().resident());
      ASSERT_TRUE(whole.store().resident());
      EXPECT_TRUE(streamed.has_levels());
      EXPECT_EQ(streamed.surfels().transparent(), alpha < 1);
      EXPECT_EQ(whole.surfels().transparent(), alpha < 1);
      EXPECT_EQ(streamed.surfels().size(), whole.surfels().size());
      expect_same_extent(streamed.surfels().extent(), whole.surfels().extent());
      Renderer from_file(streamed.store(), scene, {});
      Renderer from_memory(whole.store(), scene, {});
      for (const double zoom : {1.0, 8.0, 0.2, 8.0, 1.0}) {
        const Camera camera = view(whole.surfels(), zoom);
        FrameStatistics statistics;
        EXPECT_TRUE(from_file.render(camera, &statistics).data == from_memory.render(camera).data)
            << alpha << " " << far << " " << zoom;
        EXPECT_GT(statistics.splats, 100U);
      }
    }
  }
}

/// Bounds are those of the surfels, whatever their clusters: views of both are the same.
TEST_F(StreamedLevels, HaveTheExtentOfTheirCloud) {
  const LoadedCloud streamed(write(), {.columns = {.levels = true}});
  RenderCloud plain(cloud_);
  expect_same_extent(streamed.surfels().extent(), plain.extent());
}

/// A few surfels far away change no frame, in whatever order they come, in memory and in files.
TEST_F(StreamedLevels, AreFramedWithoutStraySurfels) {
  const Camera expected = view(RenderCloud(cloud_), 1);
  Array<std::uint32_t> order(cloud_.size() + 5, 0);
  std::iota(order.begin(), order.begin() + cloud_.size(), 0U);
  cloud_ = cloud_.gathered(order);
  const std::size_t ends[] = {cloud_.size() - 1, cloud_.size() - 2, cloud_.size() - 3, 7, 30'000};
  for (std::size_t i = 0; i < std::size(ends); ++i) {
    std::swap(cloud_.position[cloud_.size() - 1 - i], cloud_.position[ends[i]]);
    cloud_.position[ends[i]] = Vec3f(-20, 9, 4) * static_cast<float>(i * i + 1);
  }
  const auto expect_frame = [&](const RenderCloud& cloud) {
    EXPECT_EQ(cloud.extent().stray, 5U);
    const Camera camera = view(cloud, 1);
    EXPECT_LT((camera.eye - expected.eye).norm(), 1e-5);
    CameraOptions all;
    all.frame_all = true;
    EXPECT_GT(make_camera(all, cloud.extent()).eye.norm(), 10 * expected.eye.norm());
  };
  expect_frame(RenderCloud(cloud_));
  const std::string path = write();
  for (const bool may_stream : {false, true}) {
    const LoadedCloud loaded(path, {.columns = {.levels = true}, .may_stream = may_stream});
    ASSERT_EQ(loaded.store().resident(), !may_stream);
    expect_frame(loaded.surfels());
  }
}

/// Several batches, all levels or the finest.
TEST_F(StreamedLevels, FitIntoLittleMemory) {
  cloud_ = ordered("head", 200'000);
  const std::string path = write();
  const Scene scene;
  for (const bool levels : {true, false}) {
    const RenderColumns columns{.levels = levels};
    const LoadedCloud streamed(path, {.columns = columns, .memory = kLittle});
    const LoadedCloud whole(path, {.columns = columns, .may_stream = false});
    ASSERT_FALSE(streamed.store().resident());
    EXPECT_LT(streamed.surfels().memory_bytes(), whole.surfels().memory_bytes() / 3);
    const Camera camera = view(whole.surfels(), 1);
    RenderOptions options;
    if (levels) options.lod_error = 0.0;  // All of the finest level.
    Renderer renderer(streamed.store(), scene, options);
    const Image image = renderer.render(camera);
    EXPECT_LT(difference(image, picture(Renderer(whole.store(), scene, options), camera)), 0.01);
    for (const int threads : {1, 3}) {
      set_thread_count(threads);
      EXPECT_TRUE(renderer.render(camera).data == image.data) << threads;
    }
    set_thread_count(0);
  }
}

/// The message tells what processes need that draw them together, too.
TEST_F(StreamedLevels, NeedMemoryForTheirTree) {
  const std::string path = write();
  const std::string message =
      test::message_of([&] { LoadedCloud(path, {.columns = {.levels = true}, .memory = 1000}); });
  EXPECT_NE(message.find("at least, to each process"), std::string::npos) << message;
}

/// What is not seen is not looked at; what is wrong is not drawn, not at the next try either.
TEST_F(StreamedLevels, RefuseSurfelsThatCannotBeDrawn) {
  SurfelCloud levels = build_hierarchy(cloud_, {});
  levels.alpha = {};
  levels.variance_v.back() = kNan;
  const std::string path = folder_ / "flawed.ply";
  write_cloud(levels, path);
  EXPECT_THROW(LoadedCloud(path, {.columns = {.levels = true}, .may_stream = false}), Error);
  const LoadedCloud streamed(path, {.columns = {.levels = true}});
  const Scene scene;
  RenderOptions options;
  EXPECT_NO_THROW(
      picture(Renderer(streamed.store(), scene, options), view(streamed.surfels(), 0.1)));
  options.lod_error = 0.0;
  Renderer renderer(streamed.store(), scene, options);
  for (int i = 0; i < 2; ++i) {
    try {
      renderer.render(view(streamed.surfels(), 1));
      ADD_FAILURE() << "not refused";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(path), std::string::npos) << error.what();
    }
  }
}

TEST(CloudStream, RefusesBatchesSmallerThanACluster) {
  const SurfelCloud cloud = ordered("sphere", 1000);
  CloudSource source(cloud, "");
  EXPECT_THROW(CloudStream::make(source, {.batch = RenderCloud::kClusterSize - 1}), Error);
  EXPECT_NO_THROW(CloudStream::make(source, {.batch = RenderCloud::kClusterSize}));
}

}  // namespace
}  // namespace surfel
