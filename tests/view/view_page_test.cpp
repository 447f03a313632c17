#include <filesystem>
#include <memory>
#include <regex>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/view/view_cloud.h>
#include <surfel/view/view_page.h>
#include <zlib.h>

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
  std::unique_ptr<ViewCloud> new_cloud(const std::string& name) const {
    return std::make_unique<ViewCloud>(file(sphere(300), name), ViewCloudOptions());
  }
  /// The JSON that the page begins with.
  static nlohmann::json facts(const std::string& page) {
    const std::string mark = "id=\"page\">";
    const std::size_t at = page.find(mark) + mark.size();
    return nlohmann::json::parse(page.substr(at, page.find("</script>", at) - at));
  }
  /// The texts of the page's modules by their names.
  static nlohmann::json modules(const std::string& page) {
    const std::string mark = "id=\"modules\">";
    const std::size_t at = page.find(mark) + mark.size();
    const std::string packed = bytes_of_base64(page.substr(at, page.find('<', at) - at));
    std::string text(1U << 20U, '\0');
    uLongf size = text.size();
    EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(text.data()), &size,
                         reinterpret_cast<const Bytef*>(packed.data()), packed.size()),
              Z_OK);
    return nlohmann::json::parse(text.substr(0, size));
  }
  static std::string bytes_of_base64(const std::string& text) {
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string bytes;
    unsigned group = 0;
    int bits = 0;
    for (const char c : text.substr(0, text.find('='))) {
      group = (group << 6U | static_cast<unsigned>(digits.find(c))) & 0xffffffU;
      bits += 6;
      if (bits < 8) continue;
      bits -= 8;
      bytes += static_cast<char>(group >> bits & 255U);
    }
    return bytes;
  }
  TemporaryFolder folder_;
};

TEST_F(ViewPage, NamesOfFilesAreNotFilledIn) {
  const std::string plain = page_of({new_cloud("ball.ply").get()});
  for (const std::string name : {"@page@.ply", "@data@.ply", "@style@@title@.ply"}) {
    const std::string page = page_of({new_cloud(name).get()});
    EXPECT_EQ(facts(page)["files"][0]["name"], name);
    EXPECT_NE(page.find("<title>" + name), std::string::npos);
    EXPECT_EQ(modules(page), modules(plain));
  }
  const std::string page = page_of({new_cloud("@data@\n.ply").get()});
  EXPECT_EQ(modules(page), modules(plain));
}

TEST_F(ViewPage, AsksForNothingBesideItself) {
  const ViewCloud cloud(file(sphere(1000)), {});
  const std::string page = page_of({&cloud});
  for (const char* outside : {"http:", "https:", "//cdn", "src=", "href=", "@import", "url("}) {
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
  }
  EXPECT_NE(page.find("connect-src 'none'"), std::string::npos);
  EXPECT_EQ(page.find('@'), std::string::npos) << "a mark is not filled in";
  // Every module that another one imports is in the page.
  const nlohmann::json texts = modules(page);
  EXPECT_TRUE(texts.contains("main.js"));
  const std::regex import("from 'surfel/([a-z]+\\.js)'");
  int imports = 0;
  for (const auto& [name, text] : texts.items()) {
    const auto module = text.get<std::string>();
    for (std::sregex_iterator i(module.begin(), module.end(), import), end; i != end; ++i) {
      EXPECT_TRUE(texts.contains((*i)[1].str())) << name << " imports " << (*i)[1];
      ++imports;
    }
  }
  EXPECT_GE(imports, 15);
}

TEST_F(ViewPage, IsSmallerThanItsFile) {
  for (const auto& [count, elliptic] :
       {std::pair{40000, false}, {40000, true}, {3000, false}, {3000, true}}) {
    const std::string path = file(sphere(static_cast<std::size_t>(count), elliptic));
    const ViewCloud cloud(path, {});
    const std::size_t program = served_view_page({&cloud}, {}).size();
    EXPECT_LT(program, 60000U);
    const double bytes = static_cast<double>(std::filesystem::file_size(path));
    EXPECT_LT(static_cast<double>(page_of({&cloud}).size()), 1.3 * bytes);
    EXPECT_LE(page_of({&cloud}).size() - program, cloud.most_bytes() + 4096);
  }
}

TEST_F(ViewPage, OfCutSurfelsIsSmallerThanItsFile) {
  SurfelCloud cloud = sphere(3000);
  cloud.clip1_distance.assign(3000, 0.01F);
  cloud.clip2_distance.assign(3000, 0.02F);
  for (std::size_t i = 0; i < 3000; ++i) {
    const Vec3f across = cloud.normal[i].cross(Vec3f(0.1F, 0.9F, 0.2F)).normalized();
    cloud.clip1.push_back(across);
    cloud.clip2.push_back(-across);
  }
  const std::string path = file(cloud);
  const ViewCloud cut(path, {});
  EXPECT_EQ(cut.not_shown(), "");
  const std::string page = page_of({&cut});
  EXPECT_EQ(facts(page)["files"][0]["clips"], true);
  const double bytes = static_cast<double>(std::filesystem::file_size(path));
  EXPECT_LT(static_cast<double>(page.size()), 1.3 * bytes);
  EXPECT_LE(page.size() - served_view_page({&cut}, {}).size(), cut.most_bytes() + 4096);
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
  EXPECT_EQ(json["camera"]["ortho"], 0);
  EXPECT_EQ(json["files"][0]["hidden"], "");
  EXPECT_EQ(json["files"][0]["clips"], false);
  EXPECT_EQ(json["served"], false);
}

TEST_F(ViewPage, SaysWhatItDoesNotShow) {
  SurfelCloud cloud = sphere(300);
  cloud.material.assign(300, 1);
  const ViewCloud of_materials(file(cloud), {});
  EXPECT_NE(of_materials.not_shown().find("materials"), std::string::npos);
  const nlohmann::json json = facts(page_of({&of_materials}, {.ortho = 2.5}));
  EXPECT_EQ(json["files"][0]["hidden"], of_materials.not_shown());
  EXPECT_EQ(json["camera"]["ortho"], 2.5);
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
