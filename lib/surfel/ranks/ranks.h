#pragma once

// Processes of one or several machines that draw pictures together (MPI).

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/peers.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>

namespace surfel {

/// The number of this process among the processes that mpirun (Open MPI, MPICH) has started
/// together, as its environment says, and how many they are; 0 of 1 for a process alone.
struct StartedRank {
  int rank = 0;
  int count = 1;
};
SURFEL_API StartedRank started_rank();

/// The processes that run together, one of which this is. All of them call the functions below in
/// the same order.
class SURFEL_API Ranks : public Peers {
 public:
  /// Joins the processes that were started with this one; null for a process alone. Throws
  /// Error(kIo) where the plug-in of MPI is not there, and Error(kUsage) where MPI joins fewer
  /// processes than were started, as happens by the mpirun of another MPI than the plug-in's.
  static std::unique_ptr<Ranks> join();

  /// The values of all processes, by rank.
  virtual std::vector<double> all(double value) = 0;
  /// Completes the picture of rank 0 by the rows of the other processes.
  /// \param rows  of each rank, which follow one another and are all rows of the picture.
  virtual void gather(Image& picture, std::span<const RowRange> rows) = 0;
  /// Ends all processes at once: this one has failed, and the others would wait for it.
  /// \param code  exit code of the run.
  [[noreturn]] virtual void abort(int code) = 0;
};

/// Shares the rows of pictures among ranks, so that all take as long as each other.
class SURFEL_API RowBalance {
 public:
  explicit RowBalance(int ranks) : ranks_(ranks) {}

  /// The rows of each rank in a picture of so many rows; all but rank 0 may have none.
  std::vector<RowRange> rows(int height) const;
  /// Learns from a picture that was drawn in these rows, and how long each rank took, any unit:
  /// rows of a share of the height are expected to cost what they did. Times may be zero.
  void learn(std::span<const RowRange> rows, std::span<const double> times);

 private:
  int ranks_;
  /// Where each rank's rows begin, as a share of the height; empty before the first picture.
  std::vector<double> begin_;
};

}  // namespace surfel
