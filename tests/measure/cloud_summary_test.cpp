#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/measure/cloud_summary.h>
#include <surfel/measure/rank_selection.h>
#include <surfel/scene/cloud_rows.h>

namespace surfel {
namespace {

TEST(RankSelection, FindsTheValuesThatSortingFinds) {
  std::vector<float> values;
  for (std::uint64_t i = 0; i < 5000; ++i) {
    const auto u = static_cast<float>(random_uniform(1, i));
    values.push_back(i % 3 == 0 ? u : i % 3 == 1 ? -1e-20F * u : 1e20F * u);
  }
  for (int i = 0; i < 300; ++i) values.push_back(0.25F);
  values.push_back(std::numeric_limits<float>::infinity());
  RankSelection selection;
  for (const float v : values) selection.count(v);
  const std::vector<std::uint64_t> ranks{0, 7, 7, 2500, values.size() / 2, values.size() - 1};
  selection.choose(ranks);
  for (const float v : values) selection.look(v);
  std::sort(values.begin(), values.end());
  for (std::size_t i = 0; i < ranks.size(); ++i) EXPECT_EQ(selection.value(i), values[ranks[i]]);
}

/// A wavy surface with all that may be odd about surfels.
SurfelCloud wavy(std::size_t count, bool ellipses, float spread) {
  SurfelCloud cloud;
  cloud.origin = {1e6, 2e6, 0};
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto x = static_cast<float>(random_uniform(1, i, 0));
    const auto y = static_cast<float>(random_uniform(1, i, 1));
    cloud.position.emplace_back(x, y, 0.05F * std::sin(9 * x));
    cloud.normal.push_back(Vec3f(-0.45F * std::cos(9 * x), 0, 1).normalized());
    const float size =
        (1 + spread * static_cast<float>(i % 97 == 0 ? 40 : random_uniform(1, i, 2))) /
        static_cast<float>(count);
    if (ellipses) {
      cloud.tangent.push_back(Vec3f(1, 0, 0.45F * std::cos(9 * x)).normalized());
      cloud.variance_u.push_back(size);
      cloud.variance_v.push_back(size * 1.01F);
    } else {
      cloud.variance.push_back(size);
    }
    cloud.area.push_back(2 / static_cast<float>(count));
    cloud.color.emplace_back(x, y, 0.5F);
    cloud.alpha.push_back(i % 50 == 0 ? 0.5F : 1.0F);
    cloud.material.push_back(static_cast<std::uint16_t>(i % 5));
  }
  ExtraProperty extra{"intensity", ScalarType::kFloat32, {}};
  extra.data.resize(4 * count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = static_cast<float>(random_uniform(2, i));
    std::memcpy(extra.data.data() + 4 * i, &value, 4);
  }
  cloud.extra.push_back(extra);
  cloud.position[count / 2].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.position[count / 3] = cloud.position[count / 3 + 700];
  cloud.normal[5].setZero();
  cloud.normal[8] *= 2;
  return cloud;
}

/// Points of a lattice, each several times: neighbours at equal distances, of many a place.
SurfelCloud lattice(int side, int times, float variance) {
  SurfelCloud cloud;
  for (int t = 0; t < times; ++t) {
    for (int i = 0; i < side * side; ++i) {
      cloud.position.emplace_back(static_cast<float>(i % side), static_cast<float>(i / side), 0.0F);
      cloud.normal.push_back(Vec3f::UnitZ());
      cloud.variance.push_back(variance);
    }
  }
  return cloud;
}

void add(std::vector<double>& figures, const std::optional<Distribution>& d) {
  figures.push_back(d ? 1 : 0);
  if (!d) return;
  figures.insert(figures.end(),
                 {d->mean, d->min, d->percentile_5, d->median, d->percentile_95, d->max});
}

/// All figures of a summary, but for those that are words.
std::vector<double> figures_of(const CloudSummary& summary) {
  const CloudStatistics& s = summary.statistics;
  std::vector<double> out;
  for (const std::size_t count :
       {s.count, s.nonfinite_positions, s.nonfinite_normals, s.zero_normals, s.non_unit_normals,
        s.nonfinite_values, s.negative_variances, summary.by_lines[0], summary.by_lines[1],
        summary.cut_off}) {
    out.push_back(static_cast<double>(count));
  }
  out.insert(out.end(), s.bounds.min.begin(), s.bounds.min.end());
  out.insert(out.end(), s.bounds.max.begin(), s.bounds.max.end());
  add(out, s.spacing);
  add(out, s.radius);
  if (s.neighbors) {
    out.insert(out.end(), s.neighbors->surfels.begin(), s.neighbors->surfels.end());
  }
  out.push_back(s.coincident_share);
  out.push_back(s.coverage ? 1 : 0);
  if (s.coverage) {
    out.insert(out.end(), {static_cast<double>(s.coverage->cells), s.coverage->hole_share,
                           s.coverage->overlap, s.coverage->cell_area_mean});
  }
  out.push_back(summary.strays ? static_cast<double>(summary.strays->count) : -1);
  if (summary.strays) {
    out.push_back(static_cast<double>(summary.strays->first));
    out.insert(out.end(), summary.strays->place.begin(), summary.strays->place.end());
  }
  out.insert(out.end(), summary.view.up.begin(), summary.view.up.end());
  out.insert(out.end(), summary.view.front.begin(), summary.view.front.end());
  for (const auto& [name, a] : summary.attributes) {
    out.insert(out.end(), {static_cast<double>(a.count), static_cast<double>(a.missing), a.min,
                           a.percentile_1, a.median, a.percentile_99, a.max});
  }
  return out;
}

std::string words_of(const CloudSummary& summary) {
  std::string out;
  for (const CloudNeed& need : summary.needs) {
    out += need.topic + ": " + need.measure + "; " + need.command + "\n";
  }
  for (const auto& [name, a] : summary.attributes) out += name + "\n";
  for (const auto& [name, type] : cloud_properties(summary.like)) out += name + " " + type + "\n";
  return out;
}

CloudPasses pieces_of(const SurfelCloud& cloud, std::size_t most) {
  return [&cloud, most](FunctionRef<void(const SurfelCloud&)> visit) {
    for (std::size_t begin = 0; begin < cloud.size(); begin += most) {
      SurfelCloud piece = cloud_of_rows(cloud, std::min(most, cloud.size() - begin));
      copy_rows(cloud, begin, begin + piece.size(), piece, 0);
      visit(piece);
    }
  };
}

TEST(CloudSummary, PiecesTellWhatTheWholeCloudTells) {
  SurfelCloud bare = wavy(1500, false, 1);
  bare.normal = {};
  bare.variance = {};
  bare.area = {};
  SurfelCloud holes = wavy(3000, false, 1);
  for (float& variance : holes.variance) variance /= 8;
  SurfelCloud strays = wavy(3000, false, 1);
  strays.position[700] = Vec3f(-1e6F, -2e6F, 0);
  strays.position[2900] = Vec3f(0, 0, 300);
  const std::vector<SurfelCloud> clouds{
      std::move(strays),     wavy(4000, false, 1), wavy(3000, true, 0), wavy(3000, false, 30),
      lattice(20, 3, 0.5F),  lattice(12, 40, 3),   lattice(1, 3000, 1), lattice(1, 1, 1),
      lattice(30, 1, 1e-3F), std::move(bare),      std::move(holes)};
  for (std::size_t c = 0; c < clouds.size(); ++c) {
    const SurfelCloud& cloud = clouds[c];
    const CloudStatisticsOptions options{.samples = 400};
    const CloudSummary whole = summarize_cloud(cloud, options, "a.ply");
    for (const std::size_t most : {cloud.size(), std::size_t{1000}, std::size_t{211}}) {
      for (const std::uint64_t memory : {std::uint64_t{2} << 20, std::uint64_t{1} << 30}) {
        set_thread_count(most == 211 ? 1 : 3);
        const CloudSummary parts =
            summarize_cloud(pieces_of(cloud, most), options, "a.ply", memory);
        EXPECT_EQ(figures_of(parts), figures_of(whole)) << c << " " << most;
        EXPECT_EQ(words_of(parts), words_of(whole)) << c << " " << most;
      }
    }
  }
  set_thread_count(0);
}

TEST(CloudSummary, StraysAreCountedAndTheFirstIsNamed) {
  SurfelCloud cloud;
  cloud.origin = {1e6, 2e6, 0};
  for (int i = 0; i < 3000; ++i) {
    const auto x = static_cast<float>(1 + i % 16) / 16;
    const auto y = static_cast<float>(1 + i / 16 % 16) / 16;
    cloud.position.emplace_back(x, y, 0.25F);
  }
  EXPECT_FALSE(summarize_cloud(cloud, {}, "a.ply").strays);
  cloud.position[700] = Vec3f(-1e6F, -2e6F, 0.25F);
  cloud.position[2900].z() = 300;
  const CloudSummary summary = summarize_cloud(cloud, {}, "a b.ply");
  ASSERT_TRUE(summary.strays);
  EXPECT_EQ(summary.strays->count, 2U);
  EXPECT_EQ(summary.strays->first, 700U);
  EXPECT_EQ(summary.strays->place, Vec3d(0, 0, 0.25));
  EXPECT_EQ(summary.needs.front().topic, "strays");
  EXPECT_EQ(summary.needs.front().measure,
            "2 of 3000 points lie far from all others; the first is point 700 (counted from 0) at "
            "0, 0, 0.25");
  // x and y are 0.0625 to 1 from the origin on.
  EXPECT_EQ(summary.needs.front().command,
            "surfel-convert 'a b.ply' "
            "--bounds=1000000.061,2000000.061,0.249,1000001.001,2000001.001,0.251 -o OUT");
}

TEST(CloudSummary, RefusesSamplesThatDoNotFit) {
  const SurfelCloud cloud = wavy(3000, false, 1);
  try {
    summarize_cloud(pieces_of(cloud, 500), {.samples = 2000}, "a.ply", std::uint64_t{1} << 20);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUsage);
    EXPECT_NE(std::string(error.what()).find("lower `samples` to 327"), std::string::npos)
        << error.what();
  }
  EXPECT_THROW(summarize_cloud(pieces_of(cloud, 500), {.cutoff = 0}, "a.ply", 1 << 30), Error);
}

}  // namespace
}  // namespace surfel
