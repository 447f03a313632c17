#include <filesystem>
#include <regex>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/view/view_cloud.h>
#include <surfel/view/view_page.h>

#include "support/message_of.h"
#include "support/test_data.h"
#include "view/some_surfels.h"

namespace surfel::test {
namespace {

class ViewPage : public testing::Test {
 protected:
  std::string file(const SurfelCloud& cloud, const std::string& name = "ball.ply") const {
    write_cloud(cloud, folder_ / name);
    return folder_ / name;
  }
  static std::string page_of(const std::vector<const ViewCloud*>& clouds,
                             const ViewPageOptions& options = {}) {
    std::string page;
    write_view_page(clouds, options, [&](std::string_view text) { page += text; });
    return page;
  }
  /// The JSON that the page begins with.
  static nlohmann::json facts(const std::string& page) {
    const std::string mark = "id=\"page\">";
    const std::size_t at = page.find(mark) + mark.size();
    return nlohmann::json::parse(page.substr(at, page.find("</script>", at) - at));
  }
  TemporaryFolder folder_;
};

TEST_F(ViewPage, AsksForNothingBesideItself) {
  const ViewCloud cloud(file(sphere(1000)), {});
  const std::string page = page_of({&cloud});
  for (const char* outside : {"http:", "https:", "//cdn", "src=", "href=", "@import", "url("}) {
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
  }
  EXPECT_NE(page.find("connect-src 'none'"), std::string::npos);
  EXPECT_EQ(page.find('@'), std::string::npos) << "a mark is not filled in";
  // Every module that another one imports is in the map.
  const std::string mark = "<script type=\"importmap\">";
  const std::size_t at = page.find(mark) + mark.size();
  const auto map = nlohmann::json::parse(page.substr(at, page.find("</script>", at) - at));
  EXPECT_GE(map["imports"].size(), 10U);
  EXPECT_TRUE(map["imports"].contains("surfel/main.js"));
}

TEST_F(ViewPage, IsSmallerThanItsFile) {
  for (const bool elliptic : {false, true}) {
    const std::string path = file(sphere(40000, elliptic));
    const ViewCloud cloud(path, {});
    const std::size_t program = served_view_page({&cloud}, {}).size();
    EXPECT_LT(program, 150000U);
    const double bytes = static_cast<double>(std::filesystem::file_size(path));
    EXPECT_LT(static_cast<double>(page_of({&cloud}).size()), 1.3 * bytes);
    EXPECT_LE(page_of({&cloud}).size() - program, cloud.most_bytes() + 4096);
  }
}

TEST_F(ViewPage, SaysWhatItHolds) {
  SurfelCloud cloud = sphere(500);
  cloud.color.clear();
  const ViewCloud grey(file(cloud, "a b<c>.ply"), {});
  const ViewCloud colored(file(sphere(600)), {});
  const nlohmann::json json =
      facts(page_of({&grey, &colored}, {.eye = {1, 2, 3}, .up = {0, 0, 2}, .fov = 30}));
  ASSERT_EQ(json["files"].size(), 2U);
  EXPECT_EQ(json["files"][0]["name"], "a b<c>.ply");
  EXPECT_EQ(json["files"][0]["colored"], false);
  EXPECT_EQ(json["files"][1]["colored"], true);
  EXPECT_EQ(json["files"][1]["surfels"], 600);
  EXPECT_EQ(json["files"][1]["levels"], 1);
  EXPECT_EQ(json["files"][1]["attribute"], "");
  EXPECT_EQ(json["camera"]["eye"], nlohmann::json({1, 2, 3}));
  EXPECT_EQ(json["camera"]["up"], nlohmann::json({0, 0, 1}));
  EXPECT_EQ(json["served"], false);
}

TEST_F(ViewPage, RefusesWhatItCannotShow) {
  SurfelCloud bare = sphere(300);
  bare.normal.clear();
  const std::string path = file(bare);
  const std::string message = message_of([&] { ViewCloud(path, {}); });
  EXPECT_NE(message.find("surfel-estimate"), std::string::npos) << message;

  const ViewCloud cloud(file(sphere(3000)), {});
  std::string page;
  const std::string large = message_of([&] {
    write_view_page({&cloud}, {.most_bytes = 1000}, [&](std::string_view text) { page += text; });
  });
  EXPECT_NE(large.find("surfel-lod"), std::string::npos) << large;
  EXPECT_NE(large.find("--serve"), std::string::npos) << large;
  EXPECT_EQ(page, "");
}

TEST_F(ViewPage, EncodesBytesInBase64) {
  for (const auto& [bytes, text] : {std::pair{"", ""},
                                    {"f", "Zg=="},
                                    {"fo", "Zm8="},
                                    {"foo", "Zm9v"},
                                    {"foobar", "Zm9vYmFy"},
                                    {"\xff\xfe", "//4="}}) {
    std::string encoded;
    append_base64(bytes, encoded);
    EXPECT_EQ(encoded, text);
  }
}

}  // namespace
}  // namespace surfel::test
