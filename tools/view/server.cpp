#include "tools/view/server.h"

#include <chrono>
#include <cstddef>
#include <string_view>
#include <thread>

#include <httplib.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>

namespace surfel::view_tool {
namespace {

constexpr const char* kLoopback = "127.0.0.1";
/// Connections that are answered at once; a browser opens six.
constexpr std::size_t kConnections = 16;
constexpr auto kLook = std::chrono::milliseconds(50);

/// The part of an address behind the "?".
std::string_view query_of(const std::string& target) {
  const std::size_t at = target.find('?');
  return at == std::string::npos ? std::string_view() : std::string_view(target).substr(at + 1);
}

void answer(const ViewService& service, const httplib::Request& request,
            httplib::Response& response) {
  const ViewAnswer made = service.answer(request.path, query_of(request.target));
  response.status = made.status;
  if (!made.location.empty()) response.set_header("Location", made.location);
  response.set_header("Cache-Control", "no-store");
  response.set_header("X-Content-Type-Options", "nosniff");
  response.set_header("Referrer-Policy", "no-referrer");
  response.set_content(made.body, made.type.c_str());
}

}  // namespace

void serve(const ViewService& service, FunctionRef<void(int port)> ready) {
  httplib::Server server;
  server.new_task_queue = [] { return new httplib::ThreadPool(kConnections); };
  // Nobody sends anything but requests, and idle connections do not keep the process.
  server.set_payload_max_length(1024);
  server.set_read_timeout(5);
  server.set_write_timeout(30);
  server.set_keep_alive_timeout(1);
  server.Get(".*", [&](const httplib::Request& request, httplib::Response& response) {
    answer(service, request, response);
  });
  const int port = server.bind_to_any_port(kLoopback);
  if (port <= 0) throw_io("", "no port of 127.0.0.1 is free");
  std::thread listener([&] { server.listen_after_bind(); });
  ready(port);
  while (!interrupt_requested()) std::this_thread::sleep_for(kLook);
  server.stop();
  listener.join();
}

}  // namespace surfel::view_tool
