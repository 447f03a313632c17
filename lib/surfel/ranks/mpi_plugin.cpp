#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include <mpi.h>
#include <surfel/ranks/mpi_plugin.h>

namespace surfel {
namespace {

/// Errors of MPI end all processes with a message of MPI's, which is its default.
class MpiRanks final : public Ranks {
 public:
  MpiRanks() {
    // Threads of this process do not call MPI.
    int provided = 0;
    MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &count_);
  }
  ~MpiRanks() override { MPI_Finalize(); }

  int rank() const override { return rank_; }
  int count() const override { return count_; }

  std::vector<double> all(double value) override {
    std::vector<double> values(static_cast<std::size_t>(count_));
    MPI_Allgather(&value, 1, MPI_DOUBLE, values.data(), 1, MPI_DOUBLE, MPI_COMM_WORLD);
    return values;
  }

  std::vector<Bytes> exchange(std::vector<Bytes> to) override {
    const auto count = static_cast<std::size_t>(count_);
    std::vector<std::uint64_t> sent(count);
    std::vector<std::uint64_t> received(count);
    for (std::size_t i = 0; i < count; ++i) sent[i] = to[i].size();
    MPI_Alltoall(sent.data(), 1, MPI_UINT64_T, received.data(), 1, MPI_UINT64_T, MPI_COMM_WORLD);
    std::vector<Bytes> from(count);
    std::vector<MPI_Request> requests;
    const auto own = static_cast<std::size_t>(rank_);
    // Each begins with the rank after it, so that no rank is sent to by all at once.
    for (std::size_t step = 1; step < count; ++step) {
      const std::size_t source = (own + count - step) % count;
      from[source].resize(received[source]);
      for_each_message(from[source], [&](std::byte* bytes, int size) {
        MPI_Irecv(bytes, size, MPI_BYTE, static_cast<int>(source), 1, MPI_COMM_WORLD,
                  &requests.emplace_back());
      });
    }
    for (std::size_t step = 1; step < count; ++step) {
      const std::size_t target = (own + step) % count;
      for_each_message(to[target], [&](const std::byte* bytes, int size) {
        MPI_Isend(bytes, size, MPI_BYTE, static_cast<int>(target), 1, MPI_COMM_WORLD,
                  &requests.emplace_back());
      });
    }
    from[own] = std::move(to[own]);
    MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
    return from;
  }

  void gather(Image& picture, std::span<const RowRange> rows) override {
    for (int from = 1; from < count_; ++from) {
      const RowRange& range = rows[static_cast<std::size_t>(from)];
      if ((rank_ != 0 && rank_ != from) || range.begin == range.end) continue;
      const std::size_t stride = static_cast<std::size_t>(picture.width) * picture.channels.size();
      // A message holds a row or some: its length is an int.
      const int most = static_cast<int>(std::max<std::size_t>(1, kMostValues / stride));
      for (int y = range.begin; y < range.end; y += most) {
        const int values = static_cast<int>(stride) * std::min(most, range.end - y);
        if (rank_ == 0) {
          MPI_Recv(picture.pixel(0, y), values, MPI_FLOAT, from, 0, MPI_COMM_WORLD,
                   MPI_STATUS_IGNORE);
        } else {
          MPI_Send(picture.pixel(0, y), values, MPI_FLOAT, 0, 0, MPI_COMM_WORLD);
        }
      }
    }
  }

  [[noreturn]] void abort(int code) override {
    MPI_Abort(MPI_COMM_WORLD, code);
    std::abort();
  }

 private:
  static constexpr std::size_t kMostValues = std::size_t{1} << 24;

  /// Cuts bytes into messages, whose lengths are ints.
  template <class Send>
  static void for_each_message(Bytes& bytes, const Send& send) {
    constexpr std::size_t kMost = std::size_t{1} << 30;
    for (std::size_t begin = 0; begin < bytes.size(); begin += kMost) {
      send(bytes.data() + begin, static_cast<int>(std::min(kMost, bytes.size() - begin)));
    }
  }

  int rank_ = 0;
  int count_ = 1;
};

}  // namespace
}  // namespace surfel

extern "C" SURFEL_API void surfel_mpi_plugin_join(std::unique_ptr<surfel::Ranks>& ranks) {
  ranks = std::make_unique<surfel::MpiRanks>();
}
