// surfel-view --serve: how it begins, answers and ends.

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
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
  /// Whether the other side still takes bytes.
  bool takes(const std::string& text) const {
    return send(socket_, text.data(), text.size(), MSG_NOSIGNAL) >= 0;
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
  void serve(int signal, const Visit& visit) {
    const std::string told = folder_ / "address";
    const RunSetup setup{.input = {}, .meanwhile = [&](pid_t process) {
                           process_ = process;
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
  /// Most memory that the server has had, in MB.
  double most_memory() const {
    std::ifstream status("/proc/" + std::to_string(process_) + "/status");
    std::string word;
    double kilobytes = 0;
    while (status >> word && word != "VmHWM:") continue;
    status >> kilobytes;
    return kilobytes / 1024;
  }
  TemporaryFolder folder_;
  pid_t process_ = 0;
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

std::string status_of(int port, const std::string& request) {
  const Connection connection(port);
  connection.send_text(request);
  return connection.answer().substr(0, 12);
}

TEST_F(Serve, RefusesOtherMethodsBodiesAndRanges) {
  serve(SIGTERM, [](int port, const std::string& root) {
    const std::string head = root + " HTTP/1.1\r\nHost: x\r\n";
    for (const char* method : {"POST", "PUT", "PATCH", "DELETE", "OPTIONS", "HEAD"}) {
      EXPECT_EQ(status_of(port, std::string(method) + " " + head + "\r\n"), "HTTP/1.1 405")
          << method;
    }
    EXPECT_EQ(status_of(port, "GET " + head + "Content-Length: 3\r\n\r\nabc"), "HTTP/1.1 413");
    EXPECT_EQ(status_of(port, "GET " + head + "Transfer-Encoding: chunked\r\n\r\n"),
              "HTTP/1.1 413");
    std::string ranges = "0-1";
    while (ranges.size() < 7000) ranges += ",0-";
    for (const std::string& range : {std::string("0-9"), std::string("5-2"), ranges}) {
      EXPECT_EQ(status_of(port, "GET " + head + "Range: bytes=" + range + "\r\n\r\n"),
                "HTTP/1.1 416");
    }
    // Bodies that a client sends all the same do not cost it the answer.
    EXPECT_EQ(status_of(port, "POST " + head + "\r\n" + std::string(100000, 'a')), "HTTP/1.1 405");
    EXPECT_EQ(status_of(port, "GET " + head + "Content-Length: 0\r\n\r\n"), "HTTP/1.1 200");
  });
}

TEST_F(Serve, FloodsHoldNoMemoryAndGiveWay) {
  serve(SIGTERM, [this](int port, const std::string& root) {
    // Bodies without a length, lines without an end, headers without number.
    const double before = most_memory();
    std::string headers;
    while (headers.size() < 1 << 20) headers += "X: a\r\n";
    const std::string line(1 << 20, 'a');
    for (const auto& [begin, more] :
         {std::pair("POST " + root + " HTTP/1.1\r\nHost: x\r\n\r\n", line),
          std::pair("GET /" + line, line), std::pair("GET / HTTP/1.1\r\nX: " + line, line),
          std::pair("GET / HTTP/1.1\r\n" + headers, headers)}) {
      const Connection connection(port);
      connection.send_text(begin);
      int megabytes = 0;
      while (megabytes < 64 && connection.takes(more)) ++megabytes;
      EXPECT_LT(megabytes, 40);
    }
    EXPECT_GT(before, 1);
    EXPECT_LT(most_memory() - before, 8);
    // As many connections as are held, which send a header byte by byte.
    std::vector<std::unique_ptr<Connection>> slow;
    for (int i = 0; i < 36; ++i) slow.push_back(std::make_unique<Connection>(port));
    std::atomic<bool> done{false};
    std::thread trickle([&] {
      while (!done) {
        for (const auto& connection : slow) connection->takes("a");
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
    });
    EXPECT_TRUE(contains(get(port, root), "200 OK"));
    done = true;
    trickle.join();
  });
}

}  // namespace
}  // namespace surfel::test
