#include <algorithm>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/view/packed_cluster.h>
#include <surfel/view/view_service.h>

#include "support/test_data.h"
#include "view/some_surfels.h"

namespace surfel::test {
namespace {

class ViewServices : public testing::Test {
 protected:
  ViewServices() {
    write_cloud(sphere(2000), folder_ / "ball.ply");
    write_cloud(build_hierarchy(sphere(3000), {}), folder_ / "levels.ply");
    plain_ = std::make_unique<ViewCloud>(folder_ / "ball.ply", ViewCloudOptions{});
    levels_ = std::make_unique<ViewCloud>(folder_ / "levels.ply", ViewCloudOptions{});
    service_ = std::make_unique<ViewService>(
        std::vector<const ViewCloud*>{plain_.get(), levels_.get()}, ViewPageOptions{}, "secret");
  }
  int status(const std::string& path, const std::string& query = "") const {
    return service_->answer(path, query).status;
  }
  TemporaryFolder folder_;
  std::unique_ptr<ViewCloud> plain_, levels_;
  std::unique_ptr<ViewService> service_;
};

TEST_F(ViewServices, AnswersNobodyWithoutTheToken) {
  for (const char* path : {"", "/", "/secre/", "/secret2/", "/SECRET/", "//secret/", "/favicon.ico",
                           "/0/clusters", "/../secret/"}) {
    EXPECT_EQ(status(path), 403) << path;
    EXPECT_EQ(service_->answer(path, "").body.find("secret"), std::string::npos) << path;
  }
  EXPECT_EQ(status("/secret"), 301);
  EXPECT_EQ(service_->answer("/secret", "").location, "/secret/");
  const ViewAnswer page = service_->answer("/secret/", "");
  EXPECT_EQ(page.status, 200);
  EXPECT_TRUE(page.body.starts_with("<!DOCTYPE html>"));
  EXPECT_NE(page.body.find("connect-src 'self'"), std::string::npos);
  EXPECT_EQ(page.body.find("secret"), std::string::npos);
}

TEST_F(ViewServices, TellsWhatIsWrongWithARequest) {
  for (const char* path :
       {"/secret/x", "/secret/2/clusters", "/secret/0", "/secret/0/", "/secret/0/../1/clusters",
        "/secret/-1/records", "/secret/0/etc/passwd"}) {
    EXPECT_EQ(status(path), 404) << path;
  }
  for (const char* query : {"", "list=", "list=1,", "list=a", "list=-1", "list=1,,2", "lists=1",
                            "list=99999999999999999999", "list=1.5"}) {
    EXPECT_EQ(status("/secret/0/clusters", query), 400) << query;
  }
  for (const char* query : {"", "first=0", "end=1", "first=2&end=1", "first=a&end=b"}) {
    EXPECT_EQ(status("/secret/0/records", query), 400) << query;
  }
  EXPECT_EQ(status("/secret/0/clusters", "list=0,8"), 416);
  EXPECT_EQ(status("/secret/0/clusters", "list=18446744073709551615"), 416);
  EXPECT_EQ(status("/secret/0/records", "first=0&end=9"), 416);
  std::string many = "list=0";
  for (std::size_t i = 0; i < ViewService::kMostClusters; ++i) many += ",0";
  EXPECT_EQ(status("/secret/0/clusters", many), 400);
}

TEST_F(ViewServices, HandsOutRecordsAndClusters) {
  const ViewAnswer records = service_->answer("/secret/0/records", "first=0&end=8");
  EXPECT_EQ(records.status, 200);
  EXPECT_EQ(records.body.size(), 8 * sizeof(ClusterRecord));
  std::string packed;
  pack_cluster(plain_->loaded().surfels(), 3, nullptr, packed);
  pack_cluster(plain_->loaded().surfels(), 1, nullptr, packed);
  EXPECT_TRUE(service_->answer("/secret/0/clusters", "list=3,1").body == packed);
}

TEST_F(ViewServices, ClustersOfLevelsBringTheRecordsOfTheirChildren) {
  const ClusterTree& tree = levels_->loaded().surfels().tree();
  ASSERT_FALSE(tree.empty());
  std::string expected;
  const std::uint32_t root[] = {0};
  levels_->append_clusters(root, expected);
  levels_->append_records(tree[0].first_child, tree[0].first_child + tree[0].child_count, expected);
  EXPECT_TRUE(service_->answer("/secret/1/clusters", "list=0").body == expected);
}

TEST_F(ViewServices, AnswersSeveralAtOnce) {
  const std::string alone = service_->answer("/secret/1/clusters", "list=0,1,2").body;
  std::vector<std::thread> threads;
  std::vector<int> same(8);
  for (std::size_t t = 0; t < same.size(); ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 20; ++i) {
        service_->answer("/secret/1/clusters", "list=" + std::to_string(i % 3));
        same[t] += service_->answer("/secret/1/clusters", "list=0,1,2").body == alone ? 1 : 0;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(std::count(same.begin(), same.end(), 20), 8);
}

TEST(ViewToken, IsAnotherOneEveryTime) {
  const std::string token = random_token();
  EXPECT_EQ(token.size(), 32U);
  EXPECT_EQ(token.find_first_not_of("0123456789abcdef"), std::string::npos);
  EXPECT_NE(token, random_token());
}

}  // namespace
}  // namespace surfel::test
