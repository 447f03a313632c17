#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <surfel/io/cloud_io.h>
#include <surfel/view/view_service.h>
#include <sys/socket.h>
#include <unistd.h>

#include "fuzz/checks.h"
#include "support/test_data.h"
#include "tools/view/server.h"
#include "view/some_surfels.h"

namespace surfel::fuzz {
namespace {

constexpr std::string_view kToken = "token";

/// Five surfels in three clusters, a root and its two children: to pack clusters of hundreds of
/// surfels would take most of the time.
std::string text_of_levels() {
  std::string text = "ply\nformat ascii 1.0\nelement vertex 5\n";
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "variance"}) {
    text += std::string("property float ") + name + '\n';
  }
  text += "property uchar level\nelement surfel_cluster 3\n";
  for (const char* name : {"begin", "count", "first_child", "child_count"}) {
    text += std::string("property uint ") + name + '\n';
  }
  text += "property uchar level\n";
  for (const char* name :
       {"x", "y", "z", "radius", "spacing", "max_deviation", "cone_x", "cone_y", "cone_z",
        "cone_cosine", "min_x", "min_y", "min_z", "max_x", "max_y", "max_z"}) {
    text += std::string("property float ") + name + '\n';
  }
  return text +
         "end_header\n"
         "0 0 0 0 0 1 4 1\n0 0 0 0 0 1 1 0\n1 0 0 0 0 1 1 0\n0 1 0 0 0 1 1 0\n1 1 0 0 0 1 1 0\n"
         "0 1 1 2 1 0.5 0.5 0 4 2 2 0 0 1 0.9 -4 -4 -4 4 4 4\n"
         "1 2 0 0 0 0.5 0 0 2 1 1 0 0 1 0.9 -4 -4 -4 4 4 4\n"
         "3 2 0 0 0 0.5 1 0 2 1 1 0 0 1 0.9 -4 -4 -4 4 4 4\n";
}

/// The service of two files, one of them with levels of detail.
class SomeService {
 public:
  const ViewService& service() const { return service_; }

 private:
  std::string plain_file() const {
    write_cloud(test::sphere(20), folder_ / "plain.ply");
    return folder_ / "plain.ply";
  }
  std::string levels_file() const {
    std::ofstream(folder_ / "levels.ply") << text_of_levels();
    return folder_ / "levels.ply";
  }

  test::TemporaryFolder folder_;
  ViewCloud plain_{plain_file(), {}};
  ViewCloud levels_{levels_file(), {}};
  ViewService service_{{&plain_, &levels_}, {}, std::string(kToken)};
};

std::string received(int socket) {
  std::string answer;
  std::array<char, 8192> part;
  ssize_t got = 0;
  while ((got = recv(socket, part.data(), part.size(), 0)) > 0) {
    answer.append(part.data(), static_cast<std::size_t>(got));
  }
  return answer;
}

/// The answer that a client gets which sends these bytes.
std::string answer_to(const ViewService& service, Bytes bytes) {
  // The clusters of longer lists do not fit into the buffer of a socket. Another thread reads them
  // while the server writes; to start one for each request would take most of the time.
  constexpr std::ptrdiff_t kFewClusters = 16;
  std::array<int, 2> ends{};
  require(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) == 0, "no sockets");
  const auto sent = send(ends[0], bytes.data(), bytes.size(), MSG_NOSIGNAL);
  require(sent == static_cast<ssize_t>(bytes.size()), "a request is not sent");
  shutdown(ends[0], SHUT_WR);
  const std::string_view text = as_text(bytes);
  std::string answer;
  if (std::count(text.begin(), text.end(), ',') > kFewClusters) {
    std::thread client([&] { answer = received(ends[0]); });
    view_tool::answer_connection(service, ends[1]);
    client.join();
  } else {
    view_tool::answer_connection(service, ends[1]);
    answer = received(ends[0]);
  }
  close(ends[0]);
  return answer;
}

void require_refused_without_token(int status, std::string_view request) {
  // Addresses may have %74 for a t.
  const bool has_token =
      request.find(kToken) != std::string_view::npos || request.find('%') != std::string_view::npos;
  require(status != 200 || has_token, "a request without the token is answered");
}

}  // namespace

/// Sends the bytes to surfel-view's server as a request, and gives them to its service as an
/// address: each answer has a status that the server knows, and without the token nothing is
/// handed out.
void requests(Bytes bytes) {
  static const SomeService some;
  const std::string_view text = as_text(bytes);
  const std::size_t mark = std::min(text.find('?'), text.size());
  const std::string_view query = text.substr(std::min(mark + 1, text.size()));
  const int status = some.service().answer(text.substr(0, mark), query).status;
  require_refused_without_token(status, text);

  const std::string answer = answer_to(some.service(), bytes);
  constexpr std::string_view kStart = "HTTP/1.1 ";
  if (answer.empty()) return;
  require(answer.starts_with(kStart), "an answer is not one of HTTP");
  const int sent_status = std::atoi(answer.c_str() + kStart.size());
  constexpr std::array kKnown{100, 200, 301, 400, 403, 404, 405, 413, 414, 416, 417, 431};
  require(std::find(kKnown.begin(), kKnown.end(), sent_status) != kKnown.end(),
          "an answer has status " + std::to_string(sent_status));
  require_refused_without_token(sent_status, text);
}

}  // namespace surfel::fuzz
