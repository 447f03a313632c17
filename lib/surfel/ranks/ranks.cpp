#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/plugin.h>
#include <surfel/ranks/mpi_plugin.h>
#include <surfel/ranks/ranks.h>

namespace surfel {
namespace {

std::optional<int> number_in_environment(const char* name) {
  const char* const value = std::getenv(name);
  if (!value) return std::nullopt;
  const std::string_view text(value);
  int number = 0;
  const auto [end, error] = std::from_chars(text.begin(), text.end(), number);
  if (error != std::errc() || end != text.end() || number < 0) return std::nullopt;
  return number;
}

}  // namespace

StartedRank started_rank() {
  struct Names {
    const char* rank;
    const char* count;
  };
  for (const Names& names :
       {Names{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"}, Names{"PMI_RANK", "PMI_SIZE"}}) {
    const std::optional<int> rank = number_in_environment(names.rank);
    const std::optional<int> count = number_in_environment(names.count);
    if (rank && count && *rank < *count) return {*rank, *count};
  }
  return {};
}

std::unique_ptr<Ranks> Ranks::join() {
  const StartedRank started = started_rank();
  if (started.count == 1) return nullptr;
  const auto join = reinterpret_cast<JoinRanksFunction*>(plugin_symbol("mpi", kJoinRanksSymbol));
  std::unique_ptr<Ranks> ranks;
  join(ranks);
  if (ranks->count() != started.count) {
    throw_usage(
        fmt::format("{} processes were started and MPI joins {}; start them by the mpirun "
                    "of the MPI that Surfelkit is built with",
                    started.count, ranks->count()));
  }
  return ranks;
}

std::vector<RowRange> RowBalance::rows(int height) const {
  const int together = (height + kRowsTogether - 1) / kRowsTogether;
  const auto first = [&](int rank) {
    if (rank == 0) return 0;
    if (rank == ranks_) return height;
    const double share = begin_.empty() ? static_cast<double>(rank) / ranks_
                                        : begin_[static_cast<std::size_t>(rank)];
    const long before = std::max(1L, std::lround(share * together));
    return std::min(height, static_cast<int>(before) * kRowsTogether);
  };
  std::vector<RowRange> ranges;
  for (int rank = 0; rank < ranks_; ++rank) ranges.push_back({first(rank), first(rank + 1)});
  return ranges;
}

void RowBalance::learn(std::span<const RowRange> rows, std::span<const double> times) {
  const double height = rows.back().end;
  double whole = 0;
  for (const double time : times) whole += std::max(time, 0.0);
  if (!(whole > 0)) return;
  // Within a rank's rows all cost the same; rank k begins where k of the parts are done.
  begin_.assign(static_cast<std::size_t>(ranks_), 0);
  double done = 0;
  std::size_t next = 1;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double time = std::max(times[i], 0.0);
    for (; next < begin_.size(); ++next) {
      const double wanted = whole * static_cast<double>(next) / ranks_;
      if (done + time < wanted) break;
      const double part = time > 0 ? (wanted - done) / time : 0;
      begin_[next] = (rows[i].begin + part * (rows[i].end - rows[i].begin)) / height;
    }
    done += time;
  }
  for (; next < begin_.size(); ++next) begin_[next] = 1;
}

}  // namespace surfel
