// surfel-view --serve: how it begins, answers and ends.

#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A connection to a port of this machine.
class Connection {
 public:
  explicit Connection(int port) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    timeval patience{.tv_sec = 20, .tv_usec = 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    connected_ = connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~Connection() { close(socket_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool connected() const { return connected_; }
  void send_text(const std::string& text) const {
    EXPECT_GE(send(socket_, text.data(), text.size(), MSG_NOSIGNAL), 0);
  }
  /// All that comes until the other side closes.
  std::string answer() const {
    std::string text;
    char buffer[4096];
    for (ssize_t got = 0; (got = recv(socket_, buffer, sizeof(buffer), 0)) > 0;) {
      text.append(buffer, static_cast<std::size_t>(got));
    }
    return text;
  }

 private:
  int socket_;
  bool connected_ = false;
};

std::string get(int port, const std::string& path) {
  const Connection connection(port);
  connection.send_text("GET " + path + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  return connection.answer();
}

class Serve : public testing::Test {
 protected:
  void SetUp() override {
    const std::string ball = folder_ / "ball.ply";
    ASSERT_EQ(run({tool("surfel-generate"), "sphere", "--count", "3000", "--quiet", "-o", ball})
                  .exit_code,
              0);
    ASSERT_EQ(run({tool("surfel-lod"), ball, "--quiet", "-o", folder_ / "levels.ply"}).exit_code,
              0);
  }
  /// Serves a file with levels, calls visit(port, "/TOKEN/"), and ends the server by a signal.
  template <class Visit>
  void serve(int signal, const Visit& visit) const {
    const std::string told = folder_ / "address";
    const RunSetup setup{.input = {}, .meanwhile = [&](pid_t process) {
                           std::string address;
                           wait_until([&] {
                             std::ifstream(told) >> address;
                             return address.ends_with("/");
                           });
                           const std::string begin = "http://127.0.0.1:";
                           ASSERT_TRUE(address.starts_with(begin)) << address;
                           const std::string rest = address.substr(begin.size());
                           visit(std::stoi(rest), rest.substr(rest.find('/')));
                           kill(process, signal);
                         }};
    const RunResult result =
        run({"/bin/sh", "-c",
             "exec " + tool("surfel-view") + " " + (folder_ / "levels.ply") + " --serve > " + told},
            setup);
    EXPECT_EQ(result.exit_code, 0) << result.signal << result.errors;
    EXPECT_FALSE(contains(result.errors, "error")) << result.errors;
  }
  TemporaryFolder folder_;
};

TEST_F(Serve, AnswersWhoKnowsTheTokenUntilASignal) {
  serve(SIGINT, [](int port, const std::string& root) {
    EXPECT_TRUE(contains(get(port, root), "200 OK"));
    EXPECT_TRUE(contains(get(port, root), "<!DOCTYPE html>"));
    EXPECT_TRUE(contains(get(port, root + "0/clusters?list=0,1"), "200 OK"));
    EXPECT_TRUE(contains(get(port, root + "0/clusters?list=99999"), " 416 "));
    EXPECT_TRUE(contains(get(port, root + "nothing"), " 404 "));
    EXPECT_TRUE(contains(get(port, "/"), " 403 "));
    EXPECT_TRUE(contains(get(port, "/0123456789abcdef0123456789abcdef/"), " 403 "));
  });
}

TEST_F(Serve, OutlivesBadRequestsAndLostClients) {
  serve(SIGTERM, [](int port, const std::string& root) {
    for (const std::string& request :
         {std::string("garbage\r\n\r\n"), "GET " + root + "0/clusters?list=0 HTTP/1.1\r\n",
          std::string("POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n"),
          std::string(100000, 'A'), std::string("\0\0\0\0", 4)}) {
      Connection(port).send_text(request);  // And is gone.
    }
    const Connection idle(port);
    EXPECT_TRUE(idle.connected());
    std::vector<std::thread> threads;
    std::vector<int> answered(12);
    for (std::size_t i = 0; i < answered.size(); ++i) {
      threads.emplace_back([&, i] {
        answered[i] = contains(get(port, root + "0/clusters?list=0,1,2,3"), "200 OK") ? 1 : 0;
      });
    }
    for (std::thread& thread : threads) thread.join();
    for (const int each : answered) EXPECT_EQ(each, 1);
  });
}

}  // namespace
}  // namespace surfel::test
