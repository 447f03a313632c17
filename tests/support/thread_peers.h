#pragma once

// Threads of one process that stand for processes: what each does, the others wait for.

#include <barrier>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include <surfel/base/peers.h>

namespace surfel::test {

/// What the peers of a group have sent to one another and not taken yet.
class PeerGroup {
 public:
  explicit PeerGroup(int count)
      : mail_(static_cast<std::size_t>(count), std::vector<Bytes>(static_cast<std::size_t>(count))),
        barrier_(count) {}

  std::vector<Bytes> exchange(std::size_t rank, std::vector<Bytes> to) {
    for (std::size_t i = 0; i < to.size(); ++i) mail_[i][rank] = std::move(to[i]);
    barrier_.arrive_and_wait();
    std::vector<Bytes> from = std::move(mail_[rank]);
    mail_[rank].assign(from.size(), {});
    barrier_.arrive_and_wait();
    return from;
  }

 private:
  std::vector<std::vector<Bytes>> mail_;  ///< By receiver and sender.
  std::barrier<> barrier_;
};

class ThreadPeers final : public Peers {
 public:
  ThreadPeers(PeerGroup& group, int rank, int count) : group_(group), rank_(rank), count_(count) {}

  int rank() const override { return rank_; }
  int count() const override { return count_; }
  std::vector<Bytes> exchange(std::vector<Bytes> to) override {
    for (std::size_t i = 0; i < to.size(); ++i) {
      if (static_cast<int>(i) != rank_) sent += to[i].size();
    }
    return group_.exchange(static_cast<std::size_t>(rank_), std::move(to));
  }

  std::size_t sent = 0;  ///< Bytes, to others.

 private:
  PeerGroup& group_;
  int rank_, count_;
};

/// Runs a function for each of so many peers, which it must not throw out of: the others would
/// wait.
inline void run_peers(int count, const std::function<void(ThreadPeers&)>& run) {
  PeerGroup group(count);
  std::vector<std::thread> threads;
  for (int rank = 0; rank < count; ++rank) {
    threads.emplace_back([&, rank] {
      ThreadPeers peers(group, rank, count);
      run(peers);
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace surfel::test
