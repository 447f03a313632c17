#include <set>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/chart/sweeps.h>

namespace surfel {
namespace {

std::string refusal(const std::vector<std::string>& names, const SweepContext& context) {
  try {
    choose_sweeps(names, context);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUsage);
    return error.what();
  }
  return "";
}

std::vector<SweepContext> contexts() {
  std::vector<SweepContext> all;
  for (const bool mesh : {false, true}) {
    for (const bool transparent : {false, true}) {
      all.push_back({.mesh = mesh,
                     .texture = mesh,
                     .outside_truth = mesh,
                     .transparent = transparent,
                     .surfels = mesh ? 20000U : 50000U,
                     .cutoff = 1,
                     .cores = 4});
    }
  }
  return all;
}

TEST(Sweeps, PointsChangeTheChainAndAreTold) {
  for (const SweepContext& context : contexts()) {
    for (const Sweep& sweep : all_sweeps(context)) {
      std::set<std::string> labels{sweep.standard};
      bool quick = false;
      ToolChain base;
      base.apply(sweep.base);
      std::vector<ToolChain> chains{base};
      for (const SweepPoint& point : sweep.points) {
        EXPECT_TRUE(labels.insert(point.label).second) << sweep.name << ": " << point.label;
        ToolChain chain = base;
        chain.apply(point.changes);
        EXPECT_EQ(std::count(chains.begin(), chains.end(), chain), 0)
            << sweep.name << ": " << point.label;
        chains.push_back(chain);
        quick = quick || point.quick;
      }
      EXPECT_TRUE(quick) << sweep.name;
      EXPECT_FALSE(sweep.title.empty() || sweep.about.empty()) << sweep.name;
      ToolChain truth;
      truth.apply(sweep.truth);
    }
  }
}

TEST(Sweeps, UnknownNamesListTheKnownOnes) {
  const std::string message = refusal({"cutoff", "colour"}, contexts()[0]);
  EXPECT_NE(message.find("'colour'"), std::string::npos);
  for (const Sweep& sweep : all_sweeps(contexts()[0])) {
    EXPECT_NE(message.find(sweep.name), std::string::npos) << sweep.name;
  }
}

TEST(Sweeps, RefuseInputsAndTellWhatTheyNeed) {
  SweepContext cloud{.surfels = 1999, .cores = 1};
  EXPECT_NE(refusal({"spacing"}, cloud).find("needs a mesh"), std::string::npos);
  EXPECT_NE(refusal({"sigma"}, cloud).find("needs a mesh"), std::string::npos);
  EXPECT_NE(refusal({"fit"}, cloud).find("needs a texture"), std::string::npos);
  EXPECT_NE(refusal({"lod"}, cloud).find("2000 surfels"), std::string::npos);
  EXPECT_NE(refusal({"threads"}, cloud).find("two cores"), std::string::npos);
  cloud.texture = true;
  EXPECT_NE(refusal({"fit"}, cloud).find("another truth"), std::string::npos);
  cloud = {.texture = true, .outside_truth = true, .surfels = 2000, .cores = 2};
  EXPECT_EQ(refusal({"fit", "lod", "threads"}, cloud), "");
}

TEST(Sweeps, OfNoNameAreAllThatMakeSense) {
  const SweepContext cloud{.surfels = 100, .cores = 1};
  std::set<std::string> names;
  for (const Sweep& sweep : choose_sweeps({}, cloud)) names.insert(sweep.name);
  EXPECT_EQ(names.count("cutoff"), 1U);
  EXPECT_EQ(names.count("spacing") + names.count("lod") + names.count("fit"), 0U);
  ASSERT_EQ(choose_sweeps({"layers"}, cloud).size(), 1U);
  EXPECT_EQ(choose_sweeps({"layers"}, cloud)[0].name, "layers");
}

TEST(Sweeps, CeresIsForSmallSystems) {
  const auto solvers = [](std::size_t surfels) {
    std::size_t count = 0;
    for (const Sweep& sweep : all_sweeps({.mesh = true, .surfels = surfels})) {
      for (const SweepPoint& p : sweep.points)
        count += p.changes.find("--solver") != std::string::npos;
    }
    return count;
  };
  EXPECT_EQ(solvers(20000), 1U);
  EXPECT_EQ(solvers(1000000), 0U);
}

TEST(RecommendationCandidates, AreDifferentSettings) {
  for (const SweepContext& context : contexts()) {
    std::vector<ToolChain> chains;
    for (const SweepPoint& point : recommendation_candidates(context)) {
      ToolChain chain;
      chain.apply(point.changes);
      EXPECT_EQ(std::count(chains.begin(), chains.end(), chain), 0) << point.label;
      chains.push_back(chain);
    }
    EXPECT_GE(chains.size(), 6U);
  }
}

}  // namespace
}  // namespace surfel
