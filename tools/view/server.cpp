#include "tools/view/server.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstring>
#include <optional>
#include <semaphore>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include <httplib.h>
#include <poll.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <sys/socket.h>
#include <unistd.h>

namespace surfel::view_tool {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kLoopback = "127.0.0.1";
/// Connections that are held and answered at once; a browser opens six.
constexpr std::size_t kConnections = 32;
/// The time in which a request has to arrive: clients of this machine send it at once.
constexpr auto kRequestTime = std::chrono::seconds(2);
/// The bytes of a request: the addresses of a page are shorter than 8192.
constexpr std::size_t kRequestBytes = std::size_t{1} << 14;
/// The time in which a client has to read an answer, which is of a few megabytes at most: one that
/// reads a byte now and then would hold its connection for ever.
constexpr auto kWriteTime = std::chrono::seconds(30);
/// The bytes that are read and dropped behind a request.
constexpr std::size_t kDroppedBytes = std::size_t{1} << 24;
constexpr auto kLook = std::chrono::milliseconds(50);

/// A connection that reads kRequestBytes in kRequestTime at most, however slowly they come, and
/// writes for kWriteTime at most. cpp-httplib limits the time of each read and write, and lets
/// lines and bodies grow without bound.
class LimitedStream final : public httplib::Stream {
 public:
  explicit LimitedStream(int socket) : socket_(socket) {}

  bool is_readable() const override { return wait(POLLIN, end_ - Clock::now()); }
  bool is_writable() const override {
    const Clock::duration left = write_end_.value_or(Clock::now() + kWriteTime) - Clock::now();
    return left > Clock::duration::zero() && wait(POLLOUT, left);
  }

  ssize_t read(char* to, std::size_t size) override {
    if (at_ == held_) {
      at_ = 0;
      held_ = receive(bytes_.data(), std::min(left_, bytes_.size()));
      left_ -= held_;
      if (held_ == 0) return 0;
    }
    const std::size_t taken = std::min(size, held_ - at_);
    std::memcpy(to, bytes_.data() + at_, taken);
    at_ += taken;
    return static_cast<ssize_t>(taken);
  }

  ssize_t write(const char* from, std::size_t size) override {
    if (!write_end_) write_end_ = Clock::now() + kWriteTime;
    // A call that waits until all bytes are taken would know nothing of the end.
    return is_writable() ? send(socket_, from, size, MSG_NOSIGNAL | MSG_DONTWAIT) : -1;
  }

  /// Lets the client read the answer: a socket that is closed before all has been read from it
  /// drops what was sent.
  void finish() {
    shutdown(socket_, SHUT_WR);
    for (std::size_t dropped = 0; dropped < kDroppedBytes;) {
      const std::size_t got = receive(bytes_.data(), bytes_.size());
      if (got == 0) break;
      dropped += got;
    }
  }

  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip = kLoopback;
    port = 0;
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    get_remote_ip_and_port(ip, port);
  }
  socket_t socket() const override { return socket_; }

 private:
  bool wait(short event, Clock::duration time) const {
    pollfd polled{.fd = socket_, .events = event, .revents = 0};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(time).count();
    return poll(&polled, 1, static_cast<int>(std::max(left, decltype(left){0}))) > 0;
  }
  std::size_t receive(char* to, std::size_t size) const {
    const ssize_t got = Clock::now() < end_ && is_readable() ? recv(socket_, to, size, 0) : 0;
    return got > 0 ? static_cast<std::size_t>(got) : 0;
  }

  int socket_;
  Clock::time_point end_ = Clock::now() + kRequestTime;
  std::optional<Clock::time_point> write_end_;  ///< Set by the first write.
  std::size_t left_ = kRequestBytes;
  std::array<char, 4096> bytes_{};
  std::size_t held_ = 0;
  std::size_t at_ = 0;
};

/// Takes as many connections as there are threads; the system holds or refuses the others.
class LimitedTasks final : public httplib::TaskQueue {
 public:
  void enqueue(std::function<void()> task) override {
    free_.acquire();
    threads_.enqueue([this, task = std::move(task)] {
      task();
      free_.release();
    });
  }
  void shutdown() override { threads_.shutdown(); }

 private:
  std::counting_semaphore<kConnections> free_{kConnections};
  httplib::ThreadPool threads_{kConnections};
};

/// The part of an address behind the "?".
std::string_view query_of(const std::string& target) {
  const std::size_t at = target.find('?');
  return at == std::string::npos ? std::string_view() : std::string_view(target).substr(at + 1);
}

/// An answer to what no page of this server asks: another method, a body, a part of an answer.
std::optional<ViewAnswer> refusal(const httplib::Request& request) {
  const auto refused = [](int status, const char* why) {
    return ViewAnswer{status, "text/plain; charset=utf-8", why};
  };
  if (request.method != "GET") return refused(405, "only GET is answered\n");
  if (request.has_header("Transfer-Encoding") ||
      (request.has_header("Content-Length") && request.get_header_value("Content-Length") != "0")) {
    return refused(413, "a request has no body\n");
  }
  // cpp-httplib would cut the body of any answer, once for each range of a list.
  if (request.has_header("Range")) return refused(416, "answers are sent whole, without Range\n");
  return {};
}

void answer(const ViewService& service, const httplib::Request& request,
            httplib::Response& response) {
  const std::optional<ViewAnswer> refused = refusal(request);
  const ViewAnswer made =
      refused ? *refused : service.answer(request.path, query_of(request.target));
  response.status = made.status;
  if (made.status == 405) response.set_header("Allow", "GET");
  if (!made.location.empty()) response.set_header("Location", made.location);
  response.set_header("Cache-Control", "no-store");
  response.set_header("X-Content-Type-Options", "nosniff");
  response.set_header("Referrer-Policy", "no-referrer");
  if (request.ranges.empty()) response.set_content(made.body, made.type.c_str());
}

/// Answers one request a connection.
class LimitedServer final : public httplib::Server {
 public:
  explicit LimitedServer(const ViewService& service) {
    // Before routing, since cpp-httplib reads the bodies of requests before it calls other
    // handlers.
    set_pre_routing_handler([&](const httplib::Request& request, httplib::Response& response) {
      answer(service, request, response);
      return HandlerResponse::Handled;
    });
  }

  bool process_and_close_socket(socket_t socket) override {
    LimitedStream stream(socket);
    bool closed = false;
    const bool done = process_request(stream, true, closed, nullptr);
    stream.finish();
    close(socket);
    return done;
  }
};

}  // namespace

void answer_connection(const ViewService& service, int socket) {
  LimitedServer(service).process_and_close_socket(socket);
}

void serve(const ViewService& service, FunctionRef<void(int port)> ready) {
  LimitedServer server(service);
  server.new_task_queue = [] { return new LimitedTasks; };
  const int port = server.bind_to_any_port(kLoopback);
  if (port <= 0) throw_io("", "no port of 127.0.0.1 is free");
  std::thread listener([&] { server.listen_after_bind(); });
  ready(port);
  while (!interrupt_requested()) std::this_thread::sleep_for(kLook);
  server.stop();
  listener.join();
}

}  // namespace surfel::view_tool
