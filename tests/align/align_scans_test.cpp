#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/align/align_scans.h>
#include <surfel/align/scan.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/scene/transform.h>

#include "align/partial_scans.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

std::vector<std::string> names_of(std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t k = 0; k < count; ++k) names.push_back("scan" + std::to_string(k));
  return names;
}

TEST(AlignScans, FindsThePosesOfALionsScansAgain) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::vector<SurfelCloud> right = lion_scans();
  const double spacing = make_scan(right[0], "lion").spacing;
  const Perturbed moved = perturbed(right, 3, 4 * spacing);
  const AlignReport report = align_scans(moved.scans, {}, names_of(right.size()));
  EXPECT_TRUE(report.converged);
  ASSERT_EQ(report.scans.size(), right.size());
  EXPECT_EQ(report.scans[0].pose.translation, Vec3d(0, 0, 0));
  for (std::size_t k = 1; k < right.size(); ++k) {
    const PoseError error = pose_error(right[k], report.scans[k].pose, moved.by[k]);
    EXPECT_LT(error.degrees, 0.1) << k;
    EXPECT_LT(error.distance, 0.2 * spacing) << k;
    EXPECT_GT(report.scans[k].matched, report.scans[k].points / 5);
  }
}

TEST(AlignScans, FindsARangeScanOnTheMeshOfAllScans) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::vector<SurfelCloud> right = bunny_scans();
  const double spacing = make_scan(right[1], "bunny").spacing;
  const Perturbed moved = perturbed(right, 4, 6 * spacing);
  const AlignReport report = align_scans(moved.scans, {}, names_of(2));
  const PoseError error = pose_error(right[1], report.scans[1].pose, moved.by[1]);
  EXPECT_LT(error.degrees, 0.1);
  EXPECT_LT(error.distance, 0.3 * spacing);
  EXPECT_LT(report.rms, 0.5 * spacing);
}

TEST(AlignScans, KeepsItsPrecisionFarFromTheOrigin) {
  SURFEL_REQUIRE_TEST_DATA();
  std::vector<SurfelCloud> right = lion_scans();
  const double spacing = make_scan(right[0], "lion").spacing;
  for (SurfelCloud& scan : right) transform_cloud(scan, {.translation = Vec3d(6e6, -4e5, 3e6)});
  const Perturbed moved = perturbed(right, 2, 2 * spacing);
  const AlignReport report = align_scans(moved.scans, {}, names_of(right.size()));
  for (std::size_t k = 1; k < right.size(); ++k) {
    const PoseError error = pose_error(right[k], report.scans[k].pose, moved.by[k]);
    EXPECT_LT(error.degrees, 0.1) << k;
    EXPECT_LT(error.distance, 0.2 * spacing) << k;
  }
}

/// A bumpy sheet seen from above, from x = `begin` on.
SurfelCloud sheet(double begin, std::uint64_t seed) {
  SurfelCloud cloud;
  for (std::uint64_t i = 0; i < 4000; ++i) {
    const double x = begin + random_uniform(seed, i, 0);
    const double y = random_uniform(seed, i, 1);
    cloud.position.push_back(
        Vec3d(x, y, 0.1 * std::sin(9 * x + 2 * y) + 0.1 * std::cos(8 * y)).cast<float>());
  }
  return cloud;
}

TEST(AlignScans, DoesNotDependOnThreads) {
  const std::vector<SurfelCloud> scans = {sheet(0, 1), sheet(0.3, 2), sheet(0.6, 3)};
  const int before = thread_count();
  set_thread_count(1);
  const AlignReport one = align_scans(scans, {}, names_of(3));
  set_thread_count(3);
  const AlignReport three = align_scans(scans, {}, names_of(3));
  set_thread_count(before);
  for (std::size_t k = 0; k < scans.size(); ++k) {
    EXPECT_EQ(one.scans[k].pose.rotation.coeffs(), three.scans[k].pose.rotation.coeffs());
    EXPECT_EQ(one.scans[k].pose.translation, three.scans[k].pose.translation);
    EXPECT_EQ(one.scans[k].rms, three.scans[k].rms);
  }
}

TEST(AlignScans, ScansThatLieRightTakeFewRoundsWhateverTheirSpacing) {
  // Sheets of which each is a hundredth of the next one: the median spacing is far below the reach.
  SurfelCloud sheets = sheet(0, 1);
  float scale = 1;
  for (Vec3f& p : sheets.position) {
    p *= scale;
    scale = scale < 1e-6F ? 1 : 0.01F * scale;
  }
  const std::vector<SurfelCloud> scans = {sheets, sheets};
  const AlignReport report = align_scans(scans, {}, names_of(2));
  EXPECT_TRUE(report.converged);
  EXPECT_LE(report.rounds, 4);
}

TEST(AlignScans, RefusesWhatCannotBeAligned) {
  const auto refused = [](const std::vector<SurfelCloud>& scans, const std::string& part) {
    try {
      align_scans(scans, {}, names_of(scans.size()));
      ADD_FAILURE() << "no error: " << part;
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(part), std::string::npos) << e.what();
    }
  };
  refused({sheet(0, 1)}, "one scan alone");
  refused({sheet(0, 1), sheet(5, 2)}, "scan1: does not overlap");
  refused({sheet(0, 1), sheet(0.5, 2), sheet(4, 3)}, "scan2: does not overlap");
  SurfelCloud few;
  few.position.assign(99, Vec3f(0, 0, 0));
  refused({sheet(0, 1), few}, "scan1: 99 finite points are too few");
  few.position.resize(300, Vec3f(0, 0, 0));
  refused({sheet(0, 1), few}, "scan1: half of the points lie on others");
  EXPECT_EQ(AlignOptions{.reach = -1}.problems().size(), 1U);
}

}  // namespace
}  // namespace surfel::test
