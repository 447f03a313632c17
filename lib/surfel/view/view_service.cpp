#include <charconv>
#include <optional>
#include <random>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/view/view_service.h>

namespace surfel {
namespace {

constexpr const char* kText = "text/plain; charset=utf-8";
constexpr const char* kBytes = "application/octet-stream";

/// A whole number that is all of a text.
std::optional<std::uint64_t> number_of(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

/// The text after "name=" in a query.
std::optional<std::string_view> value_of(std::string_view query, std::string_view name) {
  while (!query.empty()) {
    const std::size_t end = std::min(query.find('&'), query.size());
    const std::string_view word = query.substr(0, end);
    if (word.starts_with(name) && word.substr(name.size()).starts_with('=')) {
      return word.substr(name.size() + 1);
    }
    query.remove_prefix(std::min(end + 1, query.size()));
  }
  return {};
}

/// Numbers parted by commas; nullopt where some are none, or where they are too many.
std::optional<std::vector<std::uint64_t>> list_of(std::string_view text, std::size_t most) {
  std::vector<std::uint64_t> numbers;
  while (true) {
    const std::size_t end = std::min(text.find(','), text.size());
    const auto number = number_of(text.substr(0, end));
    if (!number || numbers.size() == most) return {};
    numbers.push_back(*number);
    if (end == text.size()) return numbers;
    text.remove_prefix(end + 1);
  }
}

/// Takes as long whatever differs.
bool same_token(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  }
  return difference == 0;
}

ViewAnswer records(const ViewCloud& cloud, std::string_view query) {
  const auto first = number_of(value_of(query, "first").value_or(""));
  const auto end = number_of(value_of(query, "end").value_or(""));
  if (!first || !end || *first > *end) return {400, kText, "first=A&end=B is needed\n"};
  if (*end > cloud.clusters() || *end - *first > ViewService::kMostRecords) {
    return {416, kText, fmt::format("there are {} clusters\n", cloud.clusters())};
  }
  ViewAnswer answer{200, kBytes, {}};
  cloud.append_records(*first, *end, answer.body);
  return answer;
}

ViewAnswer clusters(const ViewCloud& cloud, std::string_view query) {
  const auto list = list_of(value_of(query, "list").value_or(""), ViewService::kMostClusters);
  if (!list) {
    return {
        400, kText,
        fmt::format("list=I,J,... of 1 to {} clusters is needed\n", ViewService::kMostClusters)};
  }
  ViewAnswer answer{200, kBytes, {}};
  const ClusterTree& tree = cloud.loaded().surfels().tree();
  for (const std::uint64_t cluster : *list) {
    if (cluster >= cloud.clusters()) {
      return {416, kText, fmt::format("there are {} clusters\n", cloud.clusters())};
    }
  }
  for (const std::uint64_t cluster : *list) {
    const std::uint32_t one[] = {static_cast<std::uint32_t>(cluster)};
    cloud.append_clusters(one, answer.body);
    if (tree.empty()) continue;
    const TreeCluster& at = tree[cluster];
    cloud.append_records(at.first_child, at.first_child + at.child_count, answer.body);
  }
  return answer;
}

}  // namespace

ViewService::ViewService(std::vector<const ViewCloud*> clouds, const ViewPageOptions& options,
                         std::string token)
    : clouds_(std::move(clouds)),
      token_(std::move(token)),
      page_(served_view_page(clouds_, options)) {}

ViewAnswer ViewService::answer(std::string_view path, std::string_view query) const {
  const std::string_view after_slash = path.starts_with('/') ? path.substr(1) : path;
  const std::size_t slash = after_slash.find('/');
  if (!same_token(after_slash.substr(0, slash), token_)) {
    return {403, kText, "the address lacks the token that surfel-view printed\n"};
  }
  if (slash == std::string_view::npos) return {301, kText, {}, fmt::format("/{}/", token_)};
  const std::string_view rest = after_slash.substr(slash + 1);
  if (rest.empty()) return {200, "text/html; charset=utf-8", page_};
  const std::size_t second = rest.find('/');
  const auto file = number_of(rest.substr(0, second));
  if (!file || *file >= clouds_.size() || second == std::string_view::npos) {
    return {404, kText, "there is nothing at this address\n"};
  }
  return answer_part(*clouds_[*file], rest.substr(second + 1), query);
}

ViewAnswer ViewService::answer_part(const ViewCloud& cloud, std::string_view what,
                                    std::string_view query) {
  try {
    if (what == "records") return records(cloud, query);
    if (what == "clusters") return clusters(cloud, query);
  } catch (const Error& error) {
    return {500, kText, fmt::format("{}\n", error.what())};
  }
  return {404, kText, "there is nothing at this address\n"};
}

std::string random_token() {
  std::random_device device;
  std::string token;
  for (int i = 0; i < 4; ++i) token += fmt::format("{:08x}", static_cast<std::uint32_t>(device()));
  return token;
}

}  // namespace surfel
