#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/gaussian/gaussian_cut.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/lod/gaussian_hierarchy.h>
#include <surfel/truth/image_error.h>

#include "gaussian/random_gaussians.h"
#include "support/message_of.h"

namespace surfel::test {
namespace {

/// The Gaussians of some clusters.
GaussianCloud part(const GaussianCloud& cloud, const std::vector<std::uint32_t>& clusters) {
  GaussianCloud out = cloud.without_gaussians();
  std::size_t size = 0;
  for (const std::uint32_t c : clusters) size += cloud.tree[c].end - cloud.tree[c].begin;
  out.resize(size);
  std::size_t to = 0;
  for (const std::uint32_t c : clusters) {
    for (std::uint32_t i = cloud.tree[c].begin; i < cloud.tree[c].end; ++i)
      out.assign(to++, cloud, i);
  }
  return out;
}

Image picture(const GaussianCloud& cloud, const Camera& camera, const GaussianOptions& options) {
  return GaussianRenderer(cloud, options).render(camera);
}

std::vector<std::uint32_t> leaves(const ClusterTree& tree) {
  std::vector<std::uint32_t> out;
  for (std::size_t c = first_leaf(tree); c < tree.size(); ++c) {
    out.push_back(static_cast<std::uint32_t>(c));
  }
  return out;
}

TEST(GaussianCut, WhatIsCulledChangesNoBit) {
  // Many small Gaussians and some as large as the scene, before, beside and behind the eye.
  GaussianCloud cloud = random_gaussians(40000, 3, 0, 0.003);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (i % 3 == 0) cloud.position[i].z() -= 3;
    if (i % 4999 == 0) cloud.scale[i] *= 60;
  }
  const GaussianCloud levels = build_gaussian_hierarchy(cloud);
  const GaussianCloud all = part(levels, leaves(levels.tree));
  for (const GaussianProfile profile :
       {GaussianProfile::kInria, GaussianProfile::kGsplat, GaussianProfile::kMip,
        GaussianProfile::k2dgs, GaussianProfile::kExact, GaussianProfile::kSurfel}) {
    const GaussianOptions options{.profile = profile};
    for (const double zoom : {0.3, 1.0, 15.0, -1.0, -15.0}) {
      // Negative: by parallel rays, as large as what is 5 units away.
      Camera camera = camera_before(cloud, 72, 56);
      camera.orthographic = zoom < 0;
      camera.focal_x *= zoom < 0 ? -zoom / 5 : zoom;
      camera.focal_y *= zoom < 0 ? -zoom / 5 : zoom;
      const std::vector<std::uint32_t> cut = gaussian_cut(levels, camera, options, 0);
      const GaussianCloud seen = part(levels, cut);
      if (std::abs(zoom) > 1) {
        EXPECT_LT(seen.size(), all.size() / 2);
      }
      EXPECT_LT(seen.size(), all.size());
      EXPECT_EQ(picture(seen, camera, options).data, picture(all, camera, options).data)
          << static_cast<int>(profile) << " " << zoom;
    }
  }
}

TEST(GaussianCut, DrawsFewerFromAfarWithinTheError) {
  GaussianCloud cloud = random_gaussians(20000, 5, 1, 0.02);
  for (Vec3f& p : cloud.position) p.z() += 20;
  const GaussianCloud levels = build_gaussian_hierarchy(cloud);
  const GaussianOptions options;
  Camera camera = camera_before(cloud, 96, 96);
  const Image truth = picture(part(levels, leaves(levels.tree)), camera, options);
  std::size_t before = levels.size();
  double worst = 100;
  for (const double error : {0.5, 1.0, 2.0, 4.0}) {
    const GaussianCloud seen = part(levels, gaussian_cut(levels, camera, options, error));
    EXPECT_LE(seen.size(), before);
    before = seen.size();
    worst = image_error(picture(seen, camera, options), truth).psnr;
    if (error <= 1) {
      EXPECT_GT(worst, 38) << error;
    }
  }
  EXPECT_LT(before, cloud.size() / 5);
  EXPECT_LT(worst, 60) << "no other levels were drawn";
}

TEST(GaussianCut, SkipsWhatLiesBehind) {
  const GaussianCloud levels = build_gaussian_hierarchy(random_gaussians(1000, 5));
  Camera camera = camera_before(levels, 32, 32);
  camera.eye.z() += 10;
  EXPECT_TRUE(gaussian_cut(levels, camera, {}, 1).empty());
}

TEST(GaussianCut, AllLevelsAtOnceAreNotDrawn) {
  const GaussianCloud levels = build_gaussian_hierarchy(random_gaussians(1000, 5));
  EXPECT_NE(message_of([&] { GaussianRenderer(levels, {}); }).find("levels of detail"),
            std::string::npos);
}

TEST(GaussianMemory, CountsColumnsAndWhatPicturesKeep) {
  GaussianCloud cloud;
  EXPECT_EQ(gaussian_memory(1000, cloud, GaussianProfile::kInria), 1000U * (56 + 68 + 25));
  cloud.degree = 3;
  EXPECT_EQ(gaussian_memory(10, cloud, GaussianProfile::kExact), 10U * (44 + 192 + 100 + 25));
}

}  // namespace
}  // namespace surfel::test
