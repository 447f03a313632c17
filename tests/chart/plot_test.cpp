#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/process.h>
#include <surfel/chart/plot.h>

#include "support/test_data.h"

namespace surfel {
namespace {

struct Box {
  double x0, y0, x1, y1;
  bool meets(const Box& other) const {
    return x0 < other.x1 && other.x0 < x1 && y0 < other.y1 && other.y0 < y1;
  }
};

TEST(PlaceLabels, KeepsThemApartAndInside) {
  std::mt19937 random(7);
  for (int round = 0; round < 20; ++round) {
    // A plot's worth of points, half of them in one corner as those of like settings are.
    std::vector<LabelPlace> points;
    std::vector<double> widths;
    std::uniform_real_distribution<double> unit(0, 1);
    for (int i = 0; i < 12; ++i) {
      const double spread = i % 2 ? 1 : 0.05;
      points.push_back({80 + 690 * spread * unit(random), 50 + 360 * spread * unit(random)});
      widths.push_back(20 + 100 * unit(random));
    }
    const auto labels = place_labels(points, widths, {}, {70, 40, 785, 425});
    ASSERT_EQ(labels.size(), points.size());
    std::vector<Box> boxes;
    for (std::size_t i = 0; i < labels.size(); ++i) {
      // The text itself, without the space around it.
      const Box box{labels[i].x, labels[i].y - 6, labels[i].x + widths[i], labels[i].y + 6};
      EXPECT_GE(box.x0, 70);
      EXPECT_GE(box.y0, 40);
      EXPECT_LE(box.x1, 785);
      EXPECT_LE(box.y1, 425);
      for (const Box& other : boxes) EXPECT_FALSE(box.meets(other)) << round << " label " << i;
      boxes.push_back(box);
    }
  }
}

TEST(PlaceLabels, PutsALoneOneBesideItsPoint) {
  const auto labels = place_labels({{200, 200}}, {50}, {}, {70, 40, 785, 425});
  EXPECT_NEAR(labels[0].x, 210, 5);
  EXPECT_NEAR(labels[0].y, 200, 1);
  EXPECT_FALSE(labels[0].leader);
  // At the right border to the left of it.
  EXPECT_LT(place_labels({{780, 200}}, {50}, {}, {70, 40, 785, 425})[0].x, 725);
}

TEST(PlotSvg, HoldsLabelsAxesAndUnits) {
  SURFEL_REQUIRE_PROGRAM("gnuplot");
  const test::TemporaryFolder folder;
  const Plot plot{"time of the picture",
                  {{"it's <1> & \"two\"", 3, 31.5, true, false},
                   {"2", 30, 40, true, true},
                   {"slow", 300, 35, false, false}}};
  const std::string svg = plot_svg(plot, folder / "");
  for (const char* part :
       {"<svg", "width=\"800\"", "time of the picture, ms (logarithmic)", "PSNR", "dB",
        "Pareto front", "default", "off the front", "it's &lt;1", "&amp; \"two\"", "slow"}) {
    EXPECT_NE(svg.find(part), std::string::npos) << part;
  }
}

TEST(PlotSvg, IsLinearWhereTimesAreNear) {
  SURFEL_REQUIRE_PROGRAM("gnuplot");
  const test::TemporaryFolder folder;
  const std::string svg = plot_svg({"time", {{"one", 3, 31.5, true, true}}}, folder / "");
  EXPECT_EQ(svg.find("logarithmic"), std::string::npos);
  EXPECT_EQ(svg.find("off the front"), std::string::npos);
  EXPECT_THROW(plot_svg({"time", {}}, folder / ""), Error);
}

TEST(PlotSvg, TellsWhichPackageIsMissing) {
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/no/such/folder", 1);
  std::string message;
  try {
    require_gnuplot();
  } catch (const Error& error) {
    message = error.what();
  }
  setenv("PATH", path.c_str(), 1);
  EXPECT_NE(message.find("gnuplot-nox"), std::string::npos) << message;
}

}  // namespace
}  // namespace surfel
