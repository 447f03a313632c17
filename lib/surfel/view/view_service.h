#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/view/view_cloud.h>
#include <surfel/view/view_page.h>

namespace surfel {

/// The answer to a request of HTTP.
struct ViewAnswer {
  int status = 200;
  std::string type;
  std::string body;
  std::string location{};  ///< Of a status 301.
};

/// Answers what a page of served_view_page() asks for. It knows nothing of connections. All
/// addresses begin with a token, which only who started the server knows:
///
///   /TOKEN/                           the page
///   /TOKEN/N/records?first=A&end=B    ClusterRecord of clusters [A, B) of file N, from 0 on
///   /TOKEN/N/clusters?list=I,J,...    packed clusters of file N, each followed by the records of
///                                     its children
///
/// The status is 403 without the token, 404 for other addresses, 400 for a query that is not
/// understood, 416 for clusters that there are not, and 500 where the file cannot be read.
class SURFEL_API ViewService {
 public:
  /// Keeps references to the clouds.
  /// \param clouds   Clouds of the page, one at least.
  /// \param options  The first view, and what the head of the page says.
  /// \param token    Letters and digits.
  ViewService(std::vector<const ViewCloud*> clouds, const ViewPageOptions& options,
              std::string token);

  /// Answers a request; callable from several threads at once.
  /// \param path   of the address, without the query, e.g. "/TOKEN/0/clusters".
  /// \param query  what follows the "?", e.g. "list=1,2".
  ViewAnswer answer(std::string_view path, std::string_view query) const;

  /// Most clusters that a request may name.
  static constexpr std::size_t kMostClusters = 1024;
  /// Most records that a request may name.
  static constexpr std::size_t kMostRecords = std::size_t{1} << 20;

 private:
  static ViewAnswer answer_part(const ViewCloud& cloud, std::string_view what,
                                std::string_view query);

  std::vector<const ViewCloud*> clouds_;
  std::string token_;
  std::string page_;
};

/// A token of 128 random bits, in hexadecimal digits.
SURFEL_API std::string random_token();

}  // namespace surfel
